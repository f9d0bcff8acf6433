"""The verdicts and numbers of an episode do not depend on where x and y point."""

from dataclasses import replace

import hand_made_record as hand
import numpy as np
import pytest

from siren_ros.base.numerics.geometry import Polyline, rotate, wrap_angle
from siren_ros.scoring.judging.junction_templates import red_crossing, red_same_direction, shoulder_turn, stop_crossing
from siren_ros.scoring.judging.lane_clearance import lane_cleared
from siren_ros.scoring.judging.outcome import av_response
from siren_ros.scoring.judging.physics import summarise_physics
from siren_ros.scoring.judging.queue_splitting import queues_split
from siren_ros.scoring.judging.verify import VerifyLimits, check_states
from siren_ros.simulation.roads.road_network import JunctionKind, RoadNetwork
from siren_ros.simulation.world.actors import Mode

ANGLES = np.radians([33.0, 118.0, -76.0])
SHIFT = np.array([12.0, -7.0])


def turned(record, angle):
    network = record.network
    lanes = tuple(
        replace(lane, centre=Polyline.through(rotate(lane.centre.points, angle) + SHIFT)) for lane in network.lanes
    )

    def state_of(state):
        x, y = (rotate(np.stack((state.x_m, state.y_m), axis=-1), angle) + SHIFT).T
        vx, vy = rotate(np.stack((state.vx_mps, state.vy_mps), axis=-1), angle).T
        return replace(state, x_m=x, y_m=y, vx_mps=vx, vy_mps=vy, yaw_rad=wrap_angle(state.yaw_rad + angle))

    return replace(
        record,
        network=RoadNetwork(lanes, network.edges, network.connections, network.junctions, (0.0, 0.0), "!"),
        states=tuple(state_of(state) for state in record.states),
    )


def queues():
    mode = np.where(np.arange(300) < 40, Mode.YIELD_PULL_OVER, Mode.YIELD_HOLD).astype(np.uint8)
    vehicles = {hand.EMV: hand.Driven(hand.line((3.7, -120.0), (3.7, 110.0)), hand.at_speed(5.12, 7.0, 300))}
    for first, x in ((10, hand.LEFT_X_M - 0.7), (20, hand.RIGHT_X_M + 0.7)):
        for number in range(3):
            vehicles[first + number] = hand.Driven(
                hand.line((x, -120.0), (x, -20.0)), np.full(300, 30.0 + 8.0 * number), mode
            )
    record = hand.hand_made(hand.crossing(), vehicles)
    return replace(record, description=replace(record.description, site={"stretch": ["s_in"]}))


def at_junction(kind=JunctionKind.SIGNAL):
    vehicles = {
        hand.EMV: hand.Driven(hand.NORTHBOUND, hand.at_speed(60.0, 10.0, 180)),
        2: hand.Driven(hand.EASTBOUND, hand.at_speed(75.0, 8.0, 180)),
        3: hand.Driven(hand.line((hand.LEFT_X_M, -120.0), (hand.LEFT_X_M, 110.0)), hand.at_speed(80.0, 8.0, 180)),
    }
    return hand.hand_made(hand.crossing(kind), vehicles, lambda _: "rrrrGrr")


def on_shoulder():
    return hand.hand_made(hand.crossing(), {hand.EMV: hand.Driven(hand.ON_SHOULDER, hand.at_speed(40.0, 8.0, 300))})


def measures_of(verdict):
    return {name: pytest.approx(value, abs=0.06) for name, value in verdict.measures().items()}


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize(
    ("record", "predicate", "thresholds"),
    [
        (queues(), queues_split, {"holding_min": 6, "overtaken_min": 6, "lateral_max_m": 1.0}),
        (at_junction(), red_same_direction, {}),
        (at_junction(), red_crossing, {}),
        (at_junction(JunctionKind.PRIORITY_STOP), stop_crossing, {"speed_min_mps": 1.0}),
        (on_shoulder(), shoulder_turn, {"shoulder_min_s": 2.0}),
    ],
    ids=["S1", "S3", "S4", "S6", "S7"],
)
def test_a_predicate_finds_the_same_in_a_turned_record(record, predicate, thresholds, angle):
    plain, other = predicate(record, thresholds), predicate(turned(record, angle), thresholds)
    assert plain.holds
    assert other.holds
    assert other.measures() == measures_of(plain)


@pytest.mark.parametrize("angle", ANGLES)
def test_lane_changes_are_the_same_in_a_turned_record(record_of, angle):
    record = record_of(duration_s=12.0)
    thresholds = {"lane_changes_min": 3, "passed_min": 3}
    assert lane_cleared(turned(record, angle), thresholds).measures() == lane_cleared(record, thresholds).measures()


@pytest.mark.parametrize("angle", ANGLES)
def test_checks_and_numbers_are_the_same_in_a_turned_record(record_of, angle):
    record = record_of(duration_s=9.0)
    other = turned(record, angle)
    values, expected = ([part.value for part in check_states(either, VerifyLimits())] for either in (other, record))
    assert values == pytest.approx(expected, abs=1e-6)
    assert vars(summarise_physics(other)) == pytest.approx(vars(summarise_physics(record)), abs=1e-6)
    parameters = {**record.description.parameters, "av": {"actor_id": 2, "sensors": "none"}}
    description = replace(record.description, parameters=parameters)
    responses = [av_response(replace(either, description=description)) for either in (record, other)]
    # A step more or less: the two are exactly abreast at a step.
    assert vars(responses[1]) == pytest.approx(vars(responses[0]), abs=0.051)
