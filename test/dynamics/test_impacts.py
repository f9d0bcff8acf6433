"""Impacts of two bodies against the conservation of momentum, each case also turned in the plane."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.dynamics.collisions import Footprints, find_contacts, overlapping
from siren_ros.dynamics.impacts import collide
from siren_ros.dynamics.parameters import ParameterTable, load_vehicle_parameters
from siren_ros.dynamics.vehicle_model import BodyState
from siren_ros.numerics.geometry import footprint_corners, rotate, separation_m
from siren_ros.world.actors import ActorClass

VEHICLES = load_vehicle_parameters()
TURNS = np.radians([0.0, 30.0, 45.0, 60.0, -160.0])


@dataclass(frozen=True)
class Car:
    x: float
    y: float
    yaw: float
    speed: float
    kind: ActorClass = ActorClass.SEDAN


def table_of(cars: Sequence[Car]) -> ParameterTable:
    return ParameterTable.of([car.kind for car in cars], VEHICLES)


def turned(cars: Sequence[Car], angle: float) -> list[Car]:
    moved = []
    for car in cars:
        x, y = rotate(np.array([car.x, car.y]), angle)
        moved.append(replace(car, x=float(x), y=float(y), yaw=car.yaw + angle))
    return moved


def boxes_of(bodies: BodyState, table: ParameterTable) -> Footprints:
    vx, vy = bodies.velocity_mps(table)
    n = len(bodies)
    ids = np.arange(1, n + 1, dtype=np.uint32)
    pose = bodies.x_m, bodies.y_m, bodies.yaw_rad
    return Footprints(ids, *pose, vx, vy, bodies.yaw_rate_radps, table.length_m, table.width_m)


def struck(cars: Sequence[Car]) -> tuple[BodyState, BodyState, ParameterTable]:
    """Bodies before and after the impacts of one step, and their parameters."""
    table = table_of(cars)
    columns = np.array([(car.x, car.y, car.yaw, car.speed) for car in cars]).T
    bodies = BodyState.moving(*(column.copy() for column in columns))
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
    cars = turned([Car(0.0, 0.0, 0.0, 12.0), Car(4.5, 0.0, 0.0, 2.0, ActorClass.BUS)], turn)
    cars[1] = replace(cars[1], **dict(zip("xy", rotate(np.array([8.0, 0.0]), turn), strict=True)))
    before, after, table = struck(cars)
    common = (table.mass_kg @ before.forward_mps) / table.mass_kg.sum()
    assert after.forward_mps == pytest.approx([common, common])
    assert after.lateral_mps == pytest.approx([0.0, 0.0], abs=1e-9)
    assert after.accel_mps2[0] == pytest.approx((common - 12.0) / 0.05)
    assert depth_m(after, table) < 0.01


@pytest.mark.parametrize("turn", TURNS)
def test_an_impact_from_the_side_leaves_the_sliding_along_the_side(turn: float) -> None:
    cars = turned([Car(0.0, 0.0, 0.0, 8.0), Car(2.9, 0.0, np.pi / 2.0, 5.0)], turn)
    _, after, table = struck(cars)
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
    speed = 1.0 if ahead else -1.0
    x, y = rotate(np.array([place, 0.0]), turn)
    before, after, table = struck([Car(0.0, 0.0, turn, speed), Car(float(x), float(y), turn, 0.0, ActorClass.TRUCK)])
    moved = np.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
    assert moved @ np.ones(2) == pytest.approx(0.5, abs=0.005)
    assert moved[0] * table.mass_kg[0] == pytest.approx(moved[1] * table.mass_kg[1])
    car = (after.x_m[0] - before.x_m[0]) * np.cos(turn) + (after.y_m[0] - before.y_m[0]) * np.sin(turn)
    assert np.sign(car) == -np.sign(place)


def test_bodies_that_do_not_touch_are_left_alone() -> None:
    before, after, _ = struck([Car(0.0, 0.0, 0.0, 8.0), Car(6.0, 0.0, 0.0, 0.0)])
    assert np.array_equal(before.x_m, after.x_m)
    assert np.array_equal(before.forward_mps, after.forward_mps)


def test_bodies_that_part_keep_their_velocities() -> None:
    _, after, table = struck([Car(0.0, 0.0, 0.0, 2.0), Car(4.6, 0.0, 0.0, 6.0)])
    assert after.forward_mps == pytest.approx([2.0, 6.0])
    assert depth_m(after, table) < 0.01


def test_a_column_that_is_run_into_does_not_overlap_either() -> None:
    cars = [Car(0.0, 0.0, 0.0, 10.0), Car(4.6, 0.0, 0.0, 0.0), Car(9.36, 0.0, 0.0, 0.0)]
    _, after, table = struck(cars)
    assert depth_m(after, table, 0, 1) < 0.3
    assert depth_m(after, table, 1, 2) < 0.3


@given(
    angle=st.floats(-np.pi, np.pi),
    yaw=st.floats(-np.pi, np.pi),
    aside=st.floats(-1.5, 1.5),
    speeds=st.tuples(st.floats(0.0, 14.0), st.floats(0.0, 14.0)),
)
def test_momentum_is_kept_energy_is_not_gained_and_bodies_come_apart(
    angle: float, yaw: float, aside: float, speeds: tuple[float, float]
) -> None:
    cars = turned([Car(0.0, 0.0, 0.0, speeds[0]), Car(2.2, aside, yaw, speeds[1], ActorClass.VAN)], angle)
    before, after, table = struck(cars)
    assert momentum(after, table) == pytest.approx(momentum(before, table), abs=1e-6)
    energies = [(table.mass_kg * (b.forward_mps**2 + b.lateral_mps**2)).sum() for b in (before, after)]
    assert energies[1] <= energies[0] + 1e-6
    assert depth_m(after, table) < 0.01
