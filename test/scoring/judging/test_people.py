"""Encounters with people on foot: who is near, and who waits."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from evaluation.made_records import Track, moving, record_with
from hand_made_record import NORTHBOUND, RIGHT_X_M, Driven, at_speed, crossing, hand_made, line, with_states

from siren_ros.data.interfaces.episode_conversions import EpisodeClosing
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.judging.near_people import check_people, contacts_with_people, near_passes
from siren_ros.scoring.judging.outcome import outcome_of
from siren_ros.scoring.judging.people import PeopleOfClass, people_measures, people_of
from siren_ros.simulation.world.actors import ActorClass, Mode
from siren_ros.simulation.world.traffic_state import Event, EventKind

WALKS, CYCLES, RIDES = ActorClass.PEDESTRIAN, ActorClass.BICYCLE, ActorClass.MOTORCYCLE
NORTH = np.pi / 2.0


def record_of(others: dict[int, Track], emv: Track | None = None) -> EpisodeRecord:
    """With an EMV of 4.6 m that drives east at 10 m/s from the origin for 10 s."""
    emv = emv or moving(0.0, 0.0, 10.0, is_emv=True)
    record = record_with({1: emv, **others}, crossing())
    return replace(record, description=replace(record.description, emv_ids=(1,)))


def walker(x_m: float, y_m: float, speed_mps: float = 1.0, kind: ActorClass = WALKS, **more: Any) -> Track:
    """Goes north; its footprint is 0.6 m by 1.8 m."""
    return moving(x_m, y_m, speed_mps, yaw_rad=NORTH, actor_class=kind, length_m=0.6, **more)


def with_emv(record: EpisodeRecord) -> dict[ActorClass, int]:
    return {kind: own.with_emv for kind, own in people_of(record).items()}


def test_an_episode_without_people_has_no_numbers() -> None:
    assert people_measures(record_of({2: moving(20.0, 8.0, 5.0)})) == {}
    described_only = record_of({2: walker(0.0, 50.0, without=frozenset(range(201)))})
    assert people_measures(described_only) == {}


@pytest.mark.parametrize(("late_m", "meets"), [(0.0, 1), (0.1, 0)])
def test_ways_that_cross_within_five_seconds_are_a_meeting(late_m: float, meets: int) -> None:
    """The EMV's rear leaves the walker's strip at x = 20 + 0.9 m after 2.32 s: the last place of its in it is at 2.30.

    The walker reaches the EMV's strip, whose edge is 0.9 m off, when its front, 0.3 m ahead, is there.
    """
    reached_s = 2.3 + 5.0
    record = record_of({2: walker(20.0, -1.2 - reached_s + 0.01 - late_m)})
    assert with_emv(record) == {WALKS: meets, CYCLES: 0, RIDES: 0}


def test_people_who_walk_along_the_way_are_no_meeting() -> None:
    along = moving(30.0, 2.0, 1.4, actor_class=WALKS, length_m=0.6)
    assert with_emv(record_of({2: along}))[WALKS] == 0


@pytest.mark.parametrize(("gap_s", "meets"), [(1.4, 1), (1.6, 0)])
def test_a_course_that_ends_in_a_contact_soon_is_a_meeting(gap_s: float, meets: int) -> None:
    """An EMV at 10 m/s behind a cyclist at 4 m/s, both for one step: no way crosses another."""
    cyclist = moving(4.6 + 6.0 * gap_s, 0.0, 4.0, actor_class=CYCLES, steps=2)
    record = record_of({2: cyclist}, moving(0.0, 0.0, 10.0, is_emv=True, steps=2))
    assert with_emv(record) == {WALKS: 0, CYCLES: meets, RIDES: 0}


def yielding(record: EpisodeRecord, actor_id: int, steps: range) -> EpisodeRecord:
    def modes(state: Any) -> Any:
        return np.where(state.actor_id == actor_id, np.uint8(Mode.YIELD_HOLD), state.mode)

    return with_states(record, lambda step: step in steps, mode=modes)


def test_a_civilian_counts_while_it_makes_way() -> None:
    """A car stands across a walker's way for the first second, and is gone when the walker is there, 2 s later."""
    car = moving(20.0, 40.0, 0.0, steps=21)
    record = record_of({2: car, 3: walker(20.0, 40.0 - 1.2 - 3.0)})
    assert people_of(record)[WALKS].met == 0, "a driver who does not make way"
    assert people_of(yielding(record, 2, range(21)))[WALKS] == PeopleOfClass(1, 1, 0, 1, 1)
    ridden = replace(record, actors={**record.actors, 2: replace(record.actors[2], actor_class=RIDES)})
    found = people_of(yielding(ridden, 2, range(21)))
    assert (found[WALKS].with_yielding, found[RIDES].with_yielding) == (1, 0), "nobody meets oneself"


def test_people_within_150_m_are_counted_over_the_episode_and_at_once() -> None:
    """The EMV goes from 0 to 100 m; one walker stands 150 m beyond its end, one 150.1 m before its start."""
    there = {2: walker(250.0, 0.0, 0.0), 3: walker(-150.1, 0.0, 0.0), 4: walker(50.0, 60.0, 0.0, RIDES)}
    found = people_of(record_of(there))
    assert (found[WALKS].near, found[WALKS].near_median) == (1, 0)
    assert (found[RIDES].near, found[RIDES].near_median) == (1, 1)
    assert found[CYCLES].near == 0


def test_the_outcome_has_the_numbers() -> None:
    record = record_of({2: walker(20.0, -4.0), 3: walker(30.0, -5.0, kind=CYCLES)})
    measures = outcome_of(record, EpisodeClosing("complete", "", 201)).measures
    assert {name: value for name, value in measures.items() if name.startswith("people.") and value} == {
        "people.pedestrians.near": 1,
        "people.pedestrians.near_median": 1,
        "people.pedestrians.with_emv": 1,
        "people.pedestrians.met": 1,
        "people.cyclists.near": 1,
        "people.cyclists.near_median": 1,
        "people.cyclists.with_emv": 1,
        "people.cyclists.met": 1,
        "people.met": 2,
    }


CAR, WALKER = 2, 3
HALF_WIDTH_M = 0.9
STRIPES = line((0.0, 20.0), (10.0, 20.0), (10.0, 24.0), (0.0, 24.0))
"""A crossing over the exit to the north, 140 to 144 m along the way of the car."""


def record_near(car_m, walker_xy, actor_class=ActorClass.PEDESTRIAN):
    """A car on its way to the north, and somebody at a place for as long."""
    x, y = walker_xy
    walker = Driven(line((x, y), (x, y + 1.0)), np.zeros(len(car_m)))
    record = hand_made(replace(crossing(), crossings=(STRIPES,)), {CAR: Driven(NORTHBOUND, car_m), WALKER: walker})
    actors = {**record.actors, WALKER: replace(record.actors[WALKER], actor_class=actor_class)}
    return replace(record, actors=actors)


def passing(speed_mps=8.0):
    return at_speed(130.0, speed_mps, 100)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("beside_m", "near"), [(1.99, True), (2.01, False), (-0.5, True)])
def test_somebody_on_the_crossing_is_near_within_two_metres_of_what_the_vehicle_sweeps(beside_m, near, side):
    record = record_near(passing(), (RIGHT_X_M + side * (HALF_WIDTH_M + beside_m), 22.0))
    assert [(item.actor_id, item.walker_id) for item in near_passes(record)] == [(CAR, WALKER)] * near


@pytest.mark.parametrize("place", [(RIGHT_X_M, 19.9), (RIGHT_X_M, 24.1), (10.1, 22.0)])
def test_people_beside_the_crossing_do_not_count(place):
    assert near_passes(record_near(passing(), place)) == ()


def test_the_fastest_step_on_the_crossing_counts():
    speeds = np.full(120, 4.0)
    speeds[60:] = 6.0  # on the crossing from step 41 on: its front comes there after 8 m
    car_m = 130.0 + np.concatenate(([0.0], np.cumsum(0.05 * speeds[1:])))
    (found,) = near_passes(record_near(car_m, (RIGHT_X_M - 1.0, 22.0)))
    assert found.speed_mps == pytest.approx(6.0)
    assert found.step >= 60


def test_only_steps_count_at_which_somebody_is_on_the_crossing():
    record = record_near(passing(), (RIGHT_X_M, 22.0))
    early = replace(record, states=tuple(s.select(s.actor_id != WALKER) if s.step > 10 else s for s in record.states))
    assert near_passes(early) == ()


@pytest.mark.parametrize(("speed_mps", "holds"), [(1.9, True), (2.1, False)])
def test_vehicles_pass_people_at_walking_pace(speed_mps, holds):
    record = record_near(at_speed(136.0, speed_mps, 150), (RIGHT_X_M, 22.0))
    _, part = check_people(record)
    assert part.holds is holds
    assert part.value == pytest.approx(speed_mps, abs=1e-6)
    assert f"actor {CAR} near {WALKER}" in part.detail


def test_records_without_people_have_nothing_near():
    record = record_near(passing(), (RIGHT_X_M, 22.0), ActorClass.SEDAN)
    assert near_passes(record) == ()
    assert all(part.holds and part.value == 0.0 for part in check_people(record))


@pytest.mark.parametrize("actor_class", [ActorClass.PEDESTRIAN, ActorClass.BICYCLE, ActorClass.MOTORCYCLE])
def test_contacts_count_with_those_whom_nothing_protects(actor_class):
    record = record_near(passing(), (50.0, 50.0), actor_class)
    hit = Event(4, EventKind.COLLISION, CAR, WALKER, detail={"impact_speed_mps": 1.0})
    among = replace(hit, other_id=99)
    record = replace(record, events=(hit, among, replace(hit, kind=EventKind.TELEPORT)))
    assert contacts_with_people(record) == (hit,)
    assert not check_people(record)[0].holds
    drawn = replace(record, description=replace(record.description, preset="realistic"))
    assert check_people(drawn)[0].holds
