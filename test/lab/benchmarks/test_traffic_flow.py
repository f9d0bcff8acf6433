"""How queues discharge, how drivers follow and how civilians accelerate, of records made by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from evaluation.made_records import moving, record_with
from hand_made_record import traffic_of

from siren_ros.lab.benchmarks.traffic_flow import (
    civilian_accelerations_mps2,
    discharge_headways,
    following_headways_s,
)
from siren_ros.simulation.roads.road_network import Connection
from siren_ros.simulation.world.actors import ActorClass, Owner

APPROACH, TURN, INSIDE, BEYOND = range(4)
LENGTH_M = 4.6


def network(direction: str = "s") -> Any:
    """An approach with a turning lane beside it, a way across the junction, and the road behind it."""
    lanes = [SimpleNamespace(edge=edge) for edge in (0, 0, 1, 2, 3)]
    across = Connection(APPROACH, BEYOND, (INSIDE,), direction, "J", 0, must_stop=False, junction="J")
    return SimpleNamespace(connections_from={APPROACH: (across,)}, lanes=lanes)


def record_of(lanes: dict[int, list[int]], speeds: dict[int, float], signal: str, direction: str = "s") -> Any:
    """Vehicles by id with their lane at each step (−1: gone), one letter of ``signal`` a step."""
    record = record_with({key: moving(0.0, 0.0, 1.0, steps=len(signal)) for key in lanes}, network(direction))
    traffic = []
    for step, letter in enumerate(signal):
        there = [key for key in sorted(lanes) if lanes[key][step] >= 0]
        columns = {
            "actor_id": np.array(there, np.uint32),
            "lane": np.array([lanes[key][step] for key in there], np.int32),
            "speed_mps": np.array([speeds[key] for key in there]),
        }
        traffic.append(replace(traffic_of(step, letter), **columns))
    return replace(record, traffic=tuple(traffic))


def leaves(step: int, steps: int, then: int = INSIDE) -> list[int]:
    return [APPROACH] * step + [then] * (steps - step)


def queue(steps: int = 300) -> dict[int, list[int]]:
    """Six vehicles: the first crosses 1 s after green at step 20, the others 2.5, 2, 1.9, 1.8 and 1.7 s later."""
    crossings = np.cumsum([40, 50, 40, 38, 36, 34]).tolist()
    return {key: leaves(crossing, steps) for key, crossing in enumerate(crossings, start=2)}


RED_THEN_GREEN = "r" * 20 + "G" * 280
STANDING = dict.fromkeys(range(2, 9), 0.0)


def test_headways_count_from_the_fourth_vehicle_on() -> None:
    assert discharge_headways(record_of(queue(), STANDING, RED_THEN_GREEN)).headway_s == pytest.approx([1.9, 1.8, 1.7])


@pytest.mark.parametrize(
    ("signal", "direction", "left"),
    [
        ("G" * 300, "s", 0),  # no green begins
        ("r" * 300, "s", 0),
        (RED_THEN_GREEN, "r", 0),  # a turning lane
        ("r" * 20 + "g" * 150 + "r" * 130, "s", 1),  # the last ones cross at red
    ],
)
def test_only_green_on_straight_lanes_counts(signal: str, direction: str, left: int) -> None:
    assert len(discharge_headways(record_of(queue(), STANDING, signal, direction)).headway_s) == left


def test_a_vehicle_that_did_not_stand_ends_the_queue() -> None:
    headways = discharge_headways(record_of(queue(), {**STANDING, 6: 7.0}, RED_THEN_GREEN)).headway_s
    assert headways == pytest.approx([1.9])


def test_a_vehicle_that_changes_lanes_is_no_part_of_the_queue() -> None:
    vehicles = queue() | {8: leaves(95, 300, TURN)}
    assert discharge_headways(record_of(vehicles, STANDING, RED_THEN_GREEN)).headway_s == pytest.approx([1.9, 1.8, 1.7])


def test_a_vehicle_that_turns_makes_its_headway_and_the_next_one_turning() -> None:
    vehicles = queue() | {5: leaves(int(np.cumsum([40, 50, 40, 38])[-1]), 300, BEYOND + 1)}
    record = record_of(vehicles, STANDING, RED_THEN_GREEN)
    right = Connection(APPROACH, BEYOND + 1, (), "r", "J", 0, must_stop=False, junction="J")
    (across,) = record.network.connections_from[APPROACH]
    record.network.connections_from[APPROACH] = (across, right)
    headways = discharge_headways(record)
    assert headways.headway_s == pytest.approx([1.9, 1.8, 1.7])
    assert headways.turns.tolist() == [True, True, False]


def test_a_heavy_vehicle_makes_its_headway_and_the_next_one_heavy() -> None:
    record = record_of(queue(), STANDING, RED_THEN_GREEN)
    kinds = {5: ActorClass.TRUCK, 4: ActorClass.VAN}
    actors = {key: replace(actor, actor_class=kinds.get(key, ActorClass.SEDAN)) for key, actor in record.actors.items()}
    headways = discharge_headways(replace(record, actors=actors))
    assert headways.headway_s == pytest.approx([1.9, 1.8, 1.7])
    assert headways.heavy.tolist() == [True, True, False]


def following(gap_m: float = 10.0, speed_mps: float = 8.0, lead_mps: float = 8.0, **columns: Any) -> list[float]:
    record = record_with({2: moving(0.0, 0.0, 1.0, steps=1), 3: moving(0.0, 0.0, 1.0, steps=1)}, network())
    values: dict[str, Any] = {
        "actor_id": np.array([2, 3], np.uint32),
        "lane": np.array([0, 0], np.int32),
        "lane_position_m": np.array([50.0 + LENGTH_M + gap_m, 50.0]),
        "speed_mps": np.array([lead_mps, speed_mps]),
        "owner": np.full(2, Owner.SUMO, np.uint8),
    }
    return following_headways_s(replace(record, traffic=(replace(traffic_of(0, ""), **(values | columns)),))).tolist()


def test_a_headway_is_from_front_to_front() -> None:
    assert following() == pytest.approx([(10.0 + LENGTH_M) / 8.0])


@pytest.mark.parametrize(
    "changed",
    [
        {"gap_m": 40.1},
        {"gap_m": -1.0},
        {"speed_mps": 2.9, "lead_mps": 2.9},
        {"lead_mps": 9.1},
        {"lead_mps": 6.9},
        {"lane": np.array([0, 1], np.int32)},
        {"lane": np.array([-1, -1], np.int32)},
        {"owner": np.array([Owner.SUMO, Owner.ROS], np.uint8)},
    ],
)
def test_who_does_not_follow_has_no_headway(changed: dict[str, Any]) -> None:
    assert following(**changed) == []


def test_accelerations_are_those_of_moving_civilians() -> None:
    tracks = {
        1: moving(0.0, 0.0, 10.0, accel_mps2=2.0, steps=3, is_emv=True),
        2: moving(0.0, 0.0, 10.0, accel_mps2=-1.0, steps=3),
        3: moving(0.0, 9.0, 0.0, steps=3),
    }
    record = record_with(tracks, network())
    emv_known = replace(record, description=replace(record.description, emv_ids=(1,)))
    assert civilian_accelerations_mps2(emv_known) == pytest.approx([-1.0] * 3)
