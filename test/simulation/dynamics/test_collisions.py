from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_episode import rotate

from siren_ros.base.numerics.geometry import footprint_corners, separation_m
from siren_ros.simulation.dynamics.collisions import (
    SEPARATION_GAP_M,
    Footprints,
    any_close,
    collide,
    find_contacts,
    overlapping,
)
from siren_ros.simulation.dynamics.vehicle_model import BodyState, ParameterTable, load_vehicle_parameters
from siren_ros.simulation.world.actors import ActorClass

LENGTH_M, WIDTH_M = 4.0, 2.0


def placed_boxes(place, turn, *rows):
    """Rows of x, y, yaw, vx, vy, yaw rate of vehicles with ids 1, 2, …, all turned about the origin and moved."""
    x, y, yaw, vx, vy, rate = np.array(rows, dtype=float).reshape(-1, 6).T
    at = rotate(np.stack((x, y), axis=-1), turn) + place
    velocity = rotate(np.stack((vx, vy), axis=-1), turn)
    n = len(rows)
    ids, sizes = np.arange(1, n + 1, dtype=np.uint32), (np.full(n, LENGTH_M), np.full(n, WIDTH_M))
    return Footprints(ids, *at.T, yaw + turn, *velocity.T, rate, *sizes, np.zeros(n, bool))


def _boxes(*rows: tuple[float, float, float, float, float]) -> Footprints:
    """Rows of x, y, yaw, vx, vy."""
    return placed_boxes((0.0, 0.0), 0.0, *((*row, 0.0) for row in rows))


@pytest.mark.parametrize(
    ("rear", "front", "speed_mps"),
    [
        ((0.0, 0.0, 0.0, 12.0, 0.0), (3.5, 1.9, 0.0, 2.0, 0.0), 10.0),
        ((0.0, 0.0, 0.0, 10.0, 0.5), (0.5, 1.98, 0.0, 8.0, 0.0), 0.5),
    ],
    ids=["longitudinal at the rear with small sideways overlap", "lateral of a side swipe"],
)
def test_the_impact_speed_is_along_the_normal(rear: Any, front: Any, speed_mps: float) -> None:
    (contact,), _ = find_contacts(_boxes(rear, front), ())
    assert contact.impact_speed_mps == pytest.approx(speed_mps)


@pytest.mark.parametrize("turn", [0.0, 1.0, -2.5])
def test_who_turns_a_corner_into_a_neighbour_is_pushed_aside_and_not_along(turn: float) -> None:
    """They stand side by side, and one creeps ahead: only along their sides do they close in."""
    table = ParameterTable.of([ActorClass.SEDAN, ActorClass.SEDAN], load_vehicle_parameters())
    place = rotate(np.array([[0.0, 0.0], [0.3, 2.3]]), turn)
    start = BodyState.moving(place[:, 0], place[:, 1], np.array([turn, turn + 0.23]), np.array([0.5, 0.0]))
    boxes = boxes_of(start, table)
    corners = footprint_corners(boxes.x_m, boxes.y_m, boxes.yaw_rad, boxes.length_m, boxes.width_m)
    assert -0.2 < float(separation_m(corners[[0]], corners[[1]])[0]) < 0.0
    after = collide(start, boxes, table, ((0, 1),), 0.05)
    assert np.hypot(after.x_m - start.x_m, after.y_m - start.y_m).max() < 0.2


def test_a_lasting_contact_is_one_event_until_it_ends() -> None:
    touching: tuple[tuple[int, int], ...] = ()
    distances = [4.2, 3.99, 3.8, 4.0 + 0.5 * SEPARATION_GAP_M, 3.99, 4.0 + 2.0 * SEPARATION_GAP_M, 3.99]
    counts = []
    for distance in distances:
        contacts, touching = find_contacts(_boxes((0.0, 0.0, 0.0, 0.0, 0.0), (distance, 0.0, 0.0, 0.0, 0.0)), touching)
        counts.append(len(contacts))
    assert counts == [0, 1, 0, 0, 0, 0, 1]


def test_boxes_that_touch_exactly_have_a_place() -> None:
    (contact,), touching = find_contacts(_boxes((0.0, 0.0, 0.0, 1.0, 0.0), (4.0, 0.0, 0.0, 0.0, 0.0)), ())
    assert (contact.x_m, contact.y_m) == pytest.approx((2.0, 0.0))
    assert contact.impact_speed_mps == pytest.approx(1.0)
    assert touching == ((1, 2),)


@pytest.mark.parametrize("ahead", [1.0, -1.0])
def test_several_contacts_come_sorted_whichever_way_the_queue_stands(ahead: float) -> None:
    """More than there is space for at first."""
    pairs = tuple((k, k + 1) for k in range(1, 12))
    contacts, touching = find_contacts(_boxes(*((3.0 * ahead * k, 0.0, 0.0, 0.0, 0.0) for k in range(12))), ())
    assert tuple(contact[:2] for contact in contacts) == touching == pairs
    assert [contact.x_m for contact in contacts] == pytest.approx([ahead * (3.0 * k - 1.5) for k in range(1, 12)])


@pytest.mark.parametrize("count", [0, 1])
def test_few_vehicles_touch_nobody(count: int) -> None:
    assert find_contacts(_boxes(*[(0.0,) * 5] * count), ()) == ((), ())


VEHICLES = load_vehicle_parameters()
TURNS = np.radians([0.0, 30.0, 45.0, 60.0, -160.0])


class Car(NamedTuple):
    x: float
    y: float
    yaw: float
    speed: float
    kind: ActorClass = ActorClass.SEDAN


def boxes_of(bodies: BodyState, table: ParameterTable) -> Footprints:
    vx, vy = bodies.velocity_mps(table)
    ids = np.arange(1, len(bodies) + 1, dtype=np.uint32)
    pose = bodies.x_m, bodies.y_m, bodies.yaw_rad
    walks = np.zeros(len(bodies), bool)
    return Footprints(ids, *pose, vx, vy, bodies.yaw_rate_radps, table.length_m, table.width_m, walks)


def struck(cars: Sequence[Car], turn: float = 0.0) -> tuple[BodyState, BodyState, ParameterTable]:
    """Bodies before and after the impacts of one step, and their parameters; all turned about the origin."""
    table = ParameterTable.of([car.kind for car in cars], VEHICLES)
    yaw, speed = np.array([(car.yaw + turn, car.speed) for car in cars]).T.copy()
    bodies = BodyState.moving(*rotate(np.array([car[:2] for car in cars]), turn).T.copy(), yaw, speed)
    boxes = boxes_of(bodies, table)
    _, touching = find_contacts(boxes, ())
    return bodies, collide(bodies, boxes, table, overlapping(boxes, touching), 0.05), table


def depth_m(bodies: BodyState, table: ParameterTable, a: int = 0, b: int = 1) -> float:
    corners = footprint_corners(bodies.x_m, bodies.y_m, bodies.yaw_rad, table.length_m, table.width_m)
    return -float(separation_m(corners[[a]], corners[[b]])[0])


def momentum(bodies: BodyState, table: ParameterTable) -> np.ndarray:
    return np.array([(table.mass_kg * part).sum() for part in bodies.velocity_mps(table)])


@pytest.mark.parametrize("turn", TURNS)
def test_a_rear_end_impact_gives_both_the_common_velocity(turn: float) -> None:
    before, after, table = struck([Car(0.0, 0.0, 0.0, 12.0), Car(8.0, 0.0, 0.0, 2.0, ActorClass.BUS)], turn)
    common = (table.mass_kg @ before.forward_mps) / table.mass_kg.sum()
    assert after.forward_mps == pytest.approx([common, common])
    assert after.lateral_mps == pytest.approx([0.0, 0.0], abs=1e-9)
    assert after.accel_mps2[0] == pytest.approx((common - 12.0) / 0.05)
    assert depth_m(after, table) < 0.01


@pytest.mark.parametrize("turn", TURNS)
def test_an_impact_from_the_side_leaves_the_sliding_along_the_side(turn: float) -> None:
    _, after, table = struck([Car(0.0, 0.0, 0.0, 8.0), Car(2.9, 0.0, np.pi / 2.0, 5.0)], turn)
    assert after.forward_mps == pytest.approx([4.0, 5.0])
    assert after.lateral_mps == pytest.approx([0.0, -4.0])
    assert after.accel_mps2 == pytest.approx([-4.0 / 0.05, 0.0])
    assert after.lateral_accel_mps2 == pytest.approx([0.0, -4.0 / 0.05])
    assert depth_m(after, table) < 0.01


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("ahead", [True, False])
def test_bodies_are_moved_apart_along_the_normal_the_lighter_one_farther(turn: float, ahead: bool) -> None:
    """The truck stands ahead of the car or behind it; 5 mm of a contact of 0.5 m may be left."""
    lengths = [VEHICLES[kind].length_m for kind in (ActorClass.SEDAN, ActorClass.TRUCK)]
    place = (0.5 * sum(lengths) - 0.5) * (1.0 if ahead else -1.0)
    cars = [Car(0.0, 0.0, 0.0, 1.0 if ahead else -1.0), Car(place, 0.0, 0.0, 0.0, ActorClass.TRUCK)]
    before, after, table = struck(cars, turn)
    moved = np.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
    assert moved @ np.ones(2) == pytest.approx(0.5, abs=0.005)
    assert moved[0] * table.mass_kg[0] == pytest.approx(moved[1] * table.mass_kg[1])
    car = (after.x_m[0] - before.x_m[0]) * np.cos(turn) + (after.y_m[0] - before.y_m[0]) * np.sin(turn)
    assert np.sign(car) == -np.sign(place)


def test_bodies_that_do_not_touch_are_left_alone() -> None:
    before, after, _ = struck([Car(0.0, 0.0, 0.0, 8.0), Car(6.0, 0.0, 0.0, 0.0)])
    assert np.array_equal(before.x_m, after.x_m)
    assert np.array_equal(before.forward_mps, after.forward_mps)


def test_who_is_pushed_into_another_one_comes_apart_from_both() -> None:
    """Three in a row, and two elsewhere, which are apart after the first push."""
    _, after, table = struck([Car(x, 0.0, 0.0, 0.0) for x in (0.0, 4.5, 9.0, 50.0, 54.5)])
    assert max(depth_m(after, table, a, b) for a, b in ((0, 1), (1, 2), (3, 4))) < 0.01


def test_bodies_that_part_keep_their_velocities() -> None:
    _, after, table = struck([Car(0.0, 0.0, 0.0, 2.0), Car(4.6, 0.0, 0.0, 6.0)])
    assert after.forward_mps == pytest.approx([2.0, 6.0])
    assert depth_m(after, table) < 0.01


@given(
    angle=st.floats(-np.pi, np.pi),
    yaw=st.floats(-np.pi, np.pi),
    aside=st.floats(-1.5, 1.5),
    speeds=st.tuples(st.floats(0.0, 14.0), st.floats(0.0, 14.0)),
)
def test_momentum_is_kept_energy_is_not_gained_and_bodies_come_apart(
    angle: float, yaw: float, aside: float, speeds: tuple[float, float]
) -> None:
    cars = [Car(0.0, 0.0, 0.0, speeds[0]), Car(2.2, aside, yaw, speeds[1], ActorClass.VAN)]
    before, after, table = struck(cars, angle)
    assert momentum(after, table) == pytest.approx(momentum(before, table), abs=1e-6)
    energies = [(table.mass_kg * (b.forward_mps**2 + b.lateral_mps**2)).sum() for b in (before, after)]
    assert energies[1] <= energies[0] + 1e-6
    assert depth_m(after, table) < 0.01


PLACES = [(0.0, 0.0), (40.0, -70.0)]
PLACE_TURNS = np.radians([35.0, -140.0])


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("turn", PLACE_TURNS)
@pytest.mark.parametrize(("side", "rate", "speed"), [(1, 2.0, 3.0), (-1, -2.0, 3.0), (-1, 2.0, 0.0), (1, -2.0, 0.0)])
def test_a_spinning_vehicle_meets_another_one_with_the_speed_of_the_point_of_contact(place, turn, side, rate, speed):
    """The bodies overlap by 1 m along and 5 cm across; the middle of that is 1.5 m ahead of who spins."""
    rows = [(0.0, 0.0, 0.0, 0.0, 0.0, rate), (3.0, side * 1.95, 0.0, 0.0, 0.0, 0.0)]
    (contact,), _ = find_contacts(placed_boxes(place, turn, *rows), frozenset())
    at = rotate(np.array([contact.x_m, contact.y_m]) - place, -turn)
    assert at == pytest.approx([1.5, side * 0.975])
    assert contact.impact_speed_mps == pytest.approx(speed)


@pytest.mark.parametrize("turn", PLACE_TURNS)
@pytest.mark.parametrize(
    ("x", "y", "touches"),
    [
        *[(3.99, 0.0, True), (4.3, 0.0, False), (0.0, 1.99, True), (0.0, 2.3, False), (3.9, 1.9, True)],
        *[(3.9, -1.9, True), (4.3, 2.3, False)],
    ],
)
def test_bodies_touch_or_not(turn, x, y, touches):
    pair = placed_boxes((7.0, 9.0), turn, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0), (x, y, 0.0, 0.0, 0.0, 0.0))
    contacts, touching = find_contacts(pair, frozenset())
    assert bool(contacts) is touches
    assert bool(touching) is touches


def test_of_pairs_that_touch_those_that_overlap_are_told_by_their_rows():
    """Actors 1 and 2 touch with a gap, 2 and 3 overlap, 1 and 4 are far apart."""
    rows = [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (4.01, 0.0, 0.0, 0.0, 0.0, 0.0)]
    rows += [(7.9, 0.5, 0.0, 0.0, 0.0, 0.0), (50.0, 50.0, 0.0, 0.0, 0.0, 0.0)]
    assert overlapping(placed_boxes((3.0, -4.0), 0.6, *rows), ((1, 2), (1, 4), (2, 3))) == ((1, 2),)
    assert overlapping(placed_boxes((3.0, -4.0), 0.6, *rows), ()) == ()


@pytest.mark.parametrize(("apart_m", "close"), [(SEPARATION_GAP_M - 0.01, True), (SEPARATION_GAP_M + 0.01, False)])
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_boxes_are_close_within_the_gap_wherever_the_others_are(apart_m, close, yaw):
    """Three in a row with a far one between them in the order of x; only the last two may be close."""
    along = np.array([np.cos(yaw), np.sin(yaw)])
    places = np.stack((0.0 * along, 30.0 * along, (34.0 + apart_m) * along, np.array([5.0, 400.0])))
    sizes = np.full(4, 4.0), np.full(4, 2.0)
    assert any_close(places[:, 0].copy(), places[:, 1].copy(), np.full(4, yaw), *sizes, np.zeros(4, bool)) is close


def test_two_who_walk_touch_nobody() -> None:
    pair = _boxes((0.0, 0.0, 0.0, 1.0, 0.0), (1.0, 0.0, 0.0, 0.0, 0.0))
    for walks, count in (((True, True), 0), ((True, False), 1), ((False, False), 1)):
        contacts, touching = find_contacts(replace(pair, walks=np.array(walks)), ())
        assert len(contacts) == len(touching) == count
