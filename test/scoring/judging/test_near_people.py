"""Contacts with people, and speeds near people on crossings, in records made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import NORTHBOUND, RIGHT_X_M, Driven, at_speed, crossing, hand_made, line

from siren_ros.scoring.judging.near_people import check_people, contacts_with_people, near_passes
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.traffic_state import Event, EventKind

CAR, WALKER = 2, 3
HALF_WIDTH_M = 0.9
STRIPES = line((0.0, 20.0), (10.0, 20.0), (10.0, 24.0), (0.0, 24.0))
"""A crossing over the exit to the north, 140 to 144 m along the way of the car."""


def record_of(car_m, walker_xy, actor_class=ActorClass.PEDESTRIAN):
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
    record = record_of(passing(), (RIGHT_X_M + side * (HALF_WIDTH_M + beside_m), 22.0))
    assert [(item.actor_id, item.walker_id) for item in near_passes(record)] == [(CAR, WALKER)] * near


@pytest.mark.parametrize("place", [(RIGHT_X_M, 19.9), (RIGHT_X_M, 24.1), (10.1, 22.0)])
def test_people_beside_the_crossing_do_not_count(place):
    assert near_passes(record_of(passing(), place)) == ()


def test_the_fastest_step_on_the_crossing_counts():
    speeds = np.full(120, 4.0)
    speeds[60:] = 6.0  # on the crossing from step 41 on: its front comes there after 8 m
    car_m = 130.0 + np.concatenate(([0.0], np.cumsum(0.05 * speeds[1:])))
    (found,) = near_passes(record_of(car_m, (RIGHT_X_M - 1.0, 22.0)))
    assert found.speed_mps == pytest.approx(6.0)
    assert found.step >= 60


def test_only_steps_count_at_which_somebody_is_on_the_crossing():
    record = record_of(passing(), (RIGHT_X_M, 22.0))
    early = replace(record, states=tuple(s.select(s.actor_id != WALKER) if s.step > 10 else s for s in record.states))
    assert near_passes(early) == ()


@pytest.mark.parametrize(("speed_mps", "holds"), [(1.9, True), (2.1, False)])
def test_vehicles_pass_people_at_walking_pace(speed_mps, holds):
    record = record_of(at_speed(136.0, speed_mps, 150), (RIGHT_X_M, 22.0))
    _, part = check_people(record)
    assert part.holds is holds
    assert part.value == pytest.approx(speed_mps, abs=1e-6)
    assert f"actor {CAR} near {WALKER}" in part.detail


def test_records_without_people_have_nothing_near():
    record = record_of(passing(), (RIGHT_X_M, 22.0), ActorClass.SEDAN)
    assert near_passes(record) == ()
    assert all(part.holds and part.value == 0.0 for part in check_people(record))


@pytest.mark.parametrize("actor_class", [ActorClass.PEDESTRIAN, ActorClass.BICYCLE, ActorClass.MOTORCYCLE])
def test_contacts_count_with_those_whom_nothing_protects(actor_class):
    record = record_of(passing(), (50.0, 50.0), actor_class)
    hit = Event(4, EventKind.COLLISION, CAR, WALKER, detail={"impact_speed_mps": 1.0})
    among = replace(hit, other_id=99)
    record = replace(record, events=(hit, among, replace(hit, kind=EventKind.TELEPORT)))
    assert contacts_with_people(record) == (hit,)
    assert not check_people(record)[0].holds
    drawn = replace(record, description=replace(record.description, preset="realistic"))
    assert check_people(drawn)[0].holds
