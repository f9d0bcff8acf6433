"""One step of the model against its equations, term by term, and their parameters."""

import shutil
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import GRAVITY_MPS2, STEP_S
from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.parameters import InputFile, RecordedFiles
from siren_ros.errors import InputError
from siren_ros.simulation.dynamics.vehicle_model import (
    BodyState,
    Controls,
    ParameterTable,
    VehicleParameters,
    load_vehicle_parameters,
    read_vehicle_parameters,
    step_bodies,
)
from siren_ros.simulation.world.actors import TWO_WHEELED, VEHICLE_CLASSES, ActorClass

PARAMETERS = load_vehicle_parameters()
H_S = 0.01
"""One substep."""


@dataclass(frozen=True)
class Case:
    """Motion and actuators before a substep, and what the driver asks for."""

    u: float
    v: float = 0.0
    w: float = 0.0
    accel: float = 0.0
    steer: float = 0.0
    throttle: float = 0.0
    brake: float = 0.0
    asked: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Throttle, brake, steering angle."""
    hand: bool = False
    quickness: float = 1.0
    drive_factor: float = 1.0


def loads_n(p: VehicleParameters, accel: float) -> tuple[float, float]:
    """Axle loads of a rigid body on two axles; neither axle lifts off altogether."""
    a, b = p.cg_to_front_axle_m, p.wheelbase_m - p.cg_to_front_axle_m
    shift = p.mass_kg * accel * p.cg_height_m / p.wheelbase_m
    weight = p.mass_kg * GRAVITY_MPS2 / p.wheelbase_m
    return max(weight * b - shift, 0.1 * p.mass_kg), max(weight * a + shift, 0.1 * p.mass_kg)


def secant_npr(stiffness: float, limit_n: float, tangent: float, cos: float) -> float:
    """Fiala's force (Rajamani 2012, eq. 13.47) over the slip; of a steered axle along the vehicle's side."""
    if tangent == 0.0:
        return stiffness * cos**3
    slip = tangent * cos**2
    z = stiffness * slip / (3.0 * limit_n)
    force = stiffness * slip * (1.0 - z + z * z / 3.0) if z < 1.0 else limit_n
    return force * cos / tangent


def substep(p: VehicleParameters, case: Case) -> dict[str, float]:
    """Actuators, forces, and the implicit equations solved as a matrix."""
    h, m, inertia = H_S, p.mass_kg, p.yaw_inertia_kgm2
    a, b = p.cg_to_front_axle_m, p.wheelbase_m - p.cg_to_front_axle_m
    u, v, w = case.u, case.v, case.w
    pedal, brake, steer = np.clip(case.asked[0], 0, 1), np.clip(case.asked[1], 0, 1), case.asked[2]
    q = case.quickness
    throttle = pedal + (case.throttle - pedal) * np.exp(-h * q / p.throttle_lag_s)
    brake = brake + (case.brake - brake) * np.exp(-h * q / p.brake_lag_s)
    most = p.max_steer_rate_radps * h * q
    target = np.clip(steer, -p.max_steer_rad, p.max_steer_rad)
    steer = case.steer + np.clip((target - case.steer) * (1.0 - np.exp(-h * q / p.steer_lag_s)), -most, most)
    front_load, rear_load = loads_n(p, case.accel)
    drive = throttle * case.drive_factor * min(m * p.max_drive_accel_mps2, p.drive_power_w / max(u, 0.1))
    braking = brake * m * p.max_brake_decel_mps2
    braking_rear = 0.7 * braking * rear_load / (front_load + rear_load)
    grip = p.friction_coefficient * np.array([front_load, rear_load])
    along_front = p.drive_front_share * drive - braking + braking_rear
    along_rear = (1.0 - p.drive_front_share) * drive - braking_rear - case.hand * m * p.hand_brake_decel_mps2
    along = np.clip([along_front, along_rear], -0.95 * grip, 0.95 * grip)
    limit = np.sqrt(grip**2 - along**2)
    cos, sin, tan = np.cos(steer), np.sin(steer), np.tan(steer)
    total = along[0] * cos + along[1]
    left = along[0] * sin * np.clip(u / 0.1, -1.0, 1.0)
    speed = np.sqrt(u * u + v * v + (a * w) ** 2) + 1e-9
    front = secant_npr(p.cornering_stiffness_front_npr, limit[0], abs(u * tan - v - a * w) / speed, cos)
    rear = secant_npr(p.cornering_stiffness_rear_npr, limit[1], abs(v - b * w) / speed, 1.0)
    first_row = [speed * m / h + front + rear, speed * m * u + front * a - rear * b]
    second_row = [front * a - rear * b, speed * inertia / h + front * a * a + rear * b * b]
    right_v = speed * (m / h * v + left) + front * u * tan
    right_w = speed * (inertia / h * w + a * left) + a * front * u * tan
    v_free, w_free = np.linalg.solve([first_row, second_row], [right_v, right_w])
    front_n = np.clip(front * (u * tan - v_free - a * w_free) / speed, -limit[0] * cos, limit[0] * cos)
    rear_n = np.clip(rear * (b * w_free - v_free) / speed, -limit[1], limit[1])
    new_w = w + h * ((front_n + left) * a - rear_n * b) / inertia
    new_v = v + h * (front_n + rear_n + left) / m - h * u * new_w
    pushed = u + h * (max(total, 0.0) - front_n * tan) / m + h * new_v * new_w
    drag = 0.5 * 1.225 * p.drag_area_m2 * u * u + p.rolling_resistance * GRAVITY_MPS2 * m
    opposed = h * (drag - min(total, 0.0)) / m
    new_u = np.sign(pushed) * max(abs(pushed) - opposed, 0.0)
    return {
        "forward_mps": new_u,
        "lateral_mps": new_v,
        "yaw_rate_radps": new_w,
        "accel_mps2": (new_u - u) / h - 0.5 * (v * w + new_v * new_w),
        "lateral_accel_mps2": (new_v - v) / h + 0.5 * (u * w + new_u * new_w),
        "steer_rad": steer,
        "throttle": throttle,
        "brake": brake,
    }


def stepped(kind: ActorClass, case: Case, yaw: float = 0.3, count: int = 1) -> BodyState:
    columns = (5.0, -7.0, yaw, case.u, case.v, case.w, case.accel, 0.0, case.steer, case.throttle, case.brake)
    body = BodyState(*(np.full(1, value) for value in columns))
    drive = np.full(1, case.quickness), np.full(1, case.drive_factor)
    controls = Controls(*(np.full(1, value) for value in case.asked), np.full(1, case.hand), *drive)
    return step_bodies(body, controls, ParameterTable.of([kind], PARAMETERS), count * H_S)


CASES = {
    "coasts": Case(12.0),
    "turns left": Case(9.0, 0.1, 0.2, 0.5, 0.06, 0.2, 0.0, (0.3, 0.0, 0.07)),
    "turns right": Case(9.0, -0.1, -0.2, 0.5, -0.06, 0.2, 0.0, (0.3, 0.0, -0.07)),
    "steers as fast as it can": Case(7.0, steer=-0.1, asked=(0.0, 0.0, 0.5)),
    "steers no farther than to its lock": Case(3.0, steer=0.605, asked=(0.0, 0.0, 2.0)),
    "steers back as fast as it can": Case(7.0, steer=0.1, asked=(0.0, 0.0, -2.0), quickness=3.0),
    "front tyres slide": Case(18.0, 0.0, 0.1, -1.0, 0.45, 0.0, 0.1, (0.0, 0.1, 0.45)),
    "front tyres slide to the right": Case(18.0, 0.0, -0.1, -1.0, -0.45, 0.0, 0.1, (0.0, 0.1, -0.45)),
    "rear tyres slide": Case(14.0, -4.0, 1.2, 0.0, -0.1, 0.1, 0.0, (0.1, 0.0, -0.1)),
    "rear tyres slide to the left": Case(14.0, 4.0, -1.2, 0.0, 0.1, 0.1, 0.0, (0.1, 0.0, 0.1)),
    "brakes in a bend": Case(15.0, 0.1, 0.3, -4.0, 0.08, 0.0, 0.5, (0.0, 0.7, 0.08)),
    "brakes with all tyres at their limit": Case(25.0, 0.3, 0.1, -8.0, 0.02, 0.0, 1.0, (0.0, 1.0, 0.02)),
    "throttle at the limit of grip": Case(1.0, 0.02, 0.05, 2.0, 0.2, 1.0, 0.0, (1.0, 0.0, 0.2), drive_factor=6.0),
    "full throttle": Case(26.0, 0.0, 0.0, 0.4, 0.0, 1.0, 0.0, (1.0, 0.0, 0.0), drive_factor=1.5, quickness=3.0),
    "both pedals": Case(8.0, 0.0, 0.1, 0.0, 0.05, 0.6, 0.3, (0.7, 0.2, 0.05)),
    "pulls away with wheels turned": Case(0.04, 0.001, 0.002, 0.3, 0.4, 0.5, 0.0, (0.6, 0.0, 0.4)),
    "pedals beyond their ends": Case(8.0, 0.0, 0.1, 0.0, 0.02, 0.5, 0.3, (1.4, -0.4, 0.02)),
    "hand brake": Case(6.0, 0.05, 0.15, -1.0, 0.07, 0.0, 0.0, (0.0, 0.0, 0.07), hand=True),
    "rolls backwards after a spin": Case(-2.0, 0.3, 0.4, 0.0, 0.05, 0.0, 0.1, (0.0, 0.2, 0.05)),
    "front axle lifts": Case(3.0, 0.1, 0.1, 40.0, 0.1, 0.3, 0.0, (0.3, 0.0, 0.1)),
    "rear axle lifts": Case(11.0, 0.1, 0.1, -40.0, 0.1, 0.0, 0.4, (0.0, 0.4, 0.1)),
}


@pytest.mark.parametrize("kind", [ActorClass.SEDAN, ActorClass.FIRE_TRUCK])
@pytest.mark.parametrize("name", list(CASES))
def test_a_substep_solves_the_equations_of_motion(name: str, kind: ActorClass) -> None:
    case = CASES[name]
    after = stepped(kind, case)
    for field, value in substep(PARAMETERS[kind], case).items():
        assert getattr(after, field)[0] == pytest.approx(value, rel=1e-9, abs=1e-9), field


@pytest.mark.parametrize("yaw", [0.3, 1.9, -2.6])
@pytest.mark.parametrize("case", [CASES["turns left"], CASES["turns right"]], ids=["left", "right"])
def test_the_centre_moves_with_its_own_velocity_along_the_mean_heading(case: Case, yaw: float) -> None:
    p = PARAMETERS[ActorClass.FIRE_TRUCK]
    after = stepped(ActorClass.FIRE_TRUCK, case, yaw)
    u, v, w = (float(getattr(after, name)[0]) for name in ("forward_mps", "lateral_mps", "yaw_rate_radps"))
    middle, left = yaw + 0.5 * H_S * w, v + p.centre_ahead_of_cg_m * w
    along, across = np.array([np.cos(middle), np.sin(middle)]), np.array([-np.sin(middle), np.cos(middle)])
    assert np.array([after.x_m[0] - 5.0, after.y_m[0] + 7.0]) == pytest.approx(H_S * (u * along + left * across))
    assert after.yaw_rad[0] == pytest.approx(yaw + H_S * w)


@pytest.mark.parametrize(
    ("yaw", "rate", "expected"), [(3.14, 0.5, 3.145 - 2 * np.pi), (-3.14, -0.5, 2 * np.pi - 3.145)]
)
def test_a_heading_stays_within_half_a_turn(yaw: float, rate: float, expected: float) -> None:
    after = stepped(ActorClass.SEDAN, Case(8.0, 0.0, rate), yaw)
    assert after.yaw_rad[0] == pytest.approx(expected, abs=0.001)


def test_five_substeps_are_five_substeps_with_the_pedals_lag_counted_from_the_first() -> None:
    """Axle loads and the power that full throttle gives are those of the step's beginning."""
    case = CASES["turns left"]
    p = PARAMETERS[ActorClass.SEDAN]
    after = stepped(ActorClass.SEDAN, case, count=5)
    state, turned, moved = case, 0.3, np.array([5.0, -7.0])
    for _ in range(5):
        after_h = substep(p, state)
        names = {"u": "forward_mps", "v": "lateral_mps", "w": "yaw_rate_radps", "steer": "steer_rad"}
        names |= {"throttle": "throttle", "brake": "brake"}
        state = replace(state, **{name: after_h[column] for name, column in names.items()})
        turned += H_S * state.w
        middle, left = turned - 0.5 * H_S * state.w, state.v + p.centre_ahead_of_cg_m * state.w
        cos, sin = np.cos(middle), np.sin(middle)
        moved += H_S * np.array([state.u * cos - left * sin, state.u * sin + left * cos])
    # The drag is that of the first speed: 1e-4 m/s off after five substeps.
    assert (after.forward_mps[0], after.lateral_mps[0]) == pytest.approx((state.u, state.v), abs=5e-4)
    assert after.yaw_rate_radps[0] == pytest.approx(state.w, abs=1e-4)
    assert (after.x_m[0], after.y_m[0], after.yaw_rad[0]) == pytest.approx((*moved, turned), abs=1e-5)
    assert after.throttle[0] == pytest.approx(state.throttle, abs=1e-12)
    assert after.accel_mps2[0] == pytest.approx(
        (after.forward_mps[0] - case.u) / 0.05
        - 0.5 * (case.v * case.w + after.lateral_mps[0] * after.yaw_rate_radps[0])
    )


@pytest.mark.parametrize(
    ("v", "w", "still"), [(0.009, 0.0, True), (0.0, 0.009, True), (0.03, 0.0, False), (0.0, 0.03, False)]
)
def test_who_has_stopped_and_hardly_drifts_stands_still(v: float, w: float, still: bool) -> None:
    """Wheels locked by the hand brake let a body turn on; the drift that is left after a substep decides."""
    slippery = replace(PARAMETERS[ActorClass.SEDAN], friction_coefficient=0.05)
    table = ParameterTable.of([ActorClass.SEDAN], {**PARAMETERS, ActorClass.SEDAN: slippery})
    body = BodyState(*(np.full(1, value) for value in (0.0, 0.0, 0.0, 0.0, v, w, 0.0, 0.0, 0.0, 0.0, 0.0)))
    off, unit = np.zeros(1), np.ones(1)
    after = step_bodies(body, Controls(off, off, off, np.ones(1, bool), unit, unit), table, 0.001)
    assert ((after.lateral_mps[0], after.yaw_rate_radps[0]) == (0.0, 0.0)) is still


FOUR_WHEELED = [kind for kind in VEHICLE_CLASSES if kind not in TWO_WHEELED]
TABLE = ParameterTable.of(FOUR_WHEELED, load_vehicle_parameters())
COUNT = len(TABLE)


def _rolling(speed_mps: float) -> BodyState:
    zero = np.zeros(COUNT)
    return BodyState.moving(zero, zero, zero, np.full(COUNT, speed_mps))


def _controls(
    throttle: Floats | float = 0.0,
    brake: Floats | float = 0.0,
    steer_rad: Floats | float = 0.0,
    hand_brake: bool = False,
) -> Controls:
    def wide(value: Floats | float) -> Floats:
        return np.broadcast_to(np.asarray(value, dtype=np.float64), (COUNT,)).copy()

    return Controls(
        wide(throttle), wide(brake), wide(steer_rad), np.full(COUNT, hand_brake), np.ones(COUNT), np.ones(COUNT)
    )


def _driven(state: BodyState, steps: int, *, table: ParameterTable = TABLE, **commands: Any) -> BodyState:
    controls = _controls(**commands)
    for _ in range(steps):
        state = step_bodies(state, controls, table, STEP_S)
    return state


@pytest.mark.parametrize(("throttle", "brake", "steer"), [(0.0, 0.0, 0.0), (0.0, 1.0, 0.4), (0.0, 0.0, -0.5)])
def test_rest_is_rest_to_the_last_bit(throttle: float, brake: float, steer: float) -> None:
    place = np.linspace(-1234.5678, 4321.1234, COUNT)
    yaw = np.linspace(-np.pi, np.pi, COUNT)
    start = BodyState.moving(place, place[::-1].copy(), yaw, np.zeros(COUNT))
    state = _driven(start, 200, throttle=throttle, brake=brake, steer_rad=steer)
    for name in ("x_m", "y_m", "yaw_rad", "forward_mps", "lateral_mps", "yaw_rate_radps"):
        np.testing.assert_array_equal(getattr(state, name), getattr(start, name), err_msg=name)


@pytest.mark.parametrize(
    ("kind", "speed_mps"), [(ActorClass.BICYCLE, 6.0), (ActorClass.MOTORCYCLE, 12.0), (ActorClass.FIRE_TRUCK, 8.0)]
)
def test_vehicles_turn_steadily_at_their_speeds(kind: ActorClass, speed_mps: float) -> None:
    """They follow the single-track model's circle, and finer substeps change little."""
    table = ParameterTable.of([kind], load_vehicle_parameters())
    coarse = fine = BodyState.moving(*(np.array([value]) for value in (0.0, 0.0, 0.0, speed_mps)))
    throttle, brake, steer_rad, one = (np.array([value]) for value in (0.1, 0.0, 0.06, 1.0))
    turning = Controls(throttle, brake, steer_rad, np.array([False]), one, one)
    for _ in range(60):
        coarse = step_bodies(coarse, turning, table, STEP_S)
        for _ in range(10):
            fine = step_bodies(fine, turning, table, STEP_S / 10.0)
    assert np.hypot(coarse.x_m - fine.x_m, coarse.y_m - fine.y_m)[0] < 0.15
    speed, rate = float(coarse.forward_mps[0]), float(coarse.yaw_rate_radps[0])
    slip_rad = 0.06 - float(table.understeer_gradient_s2pm[0]) * speed * rate
    assert speed / rate == pytest.approx(float(table.wheelbase_m[0]) / np.tan(slip_rad), rel=0.06)


def test_rows_do_not_influence_each_other() -> None:
    alone = ParameterTable.of([ActorClass.BUS], PARAMETERS)
    row = FOUR_WHEELED.index(ActorClass.BUS)
    many = _rolling(8.0)
    bus = many.select(np.array([row]))
    command = _controls(0.4, 0.0, 0.2)
    single = Controls(*(getattr(command, field.name)[[row]] for field in fields(Controls)))
    for _ in range(30):
        many, bus = step_bodies(many, command, TABLE, STEP_S), step_bodies(bus, single, alone, STEP_S)
    for field in fields(BodyState):
        np.testing.assert_allclose(getattr(bus, field.name)[0], getattr(many, field.name)[row], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("yaw", [0.4, 2.5, -1.9])
def test_the_centres_velocity_is_that_of_a_point_ahead_of_the_centre_of_gravity(yaw: float) -> None:
    table = ParameterTable.of([ActorClass.FIRE_TRUCK], PARAMETERS)
    body = replace(
        BodyState.moving(*(np.array([value]) for value in (0.0, 0.0, yaw, 9.0))),
        lateral_mps=np.array([0.4]),
        yaw_rate_radps=np.array([0.3]),
    )
    vx, vy = body.velocity_mps(table)
    along, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    ahead = PARAMETERS[ActorClass.FIRE_TRUCK].centre_ahead_of_cg_m
    assert (vx[0], vy[0]) == pytest.approx(tuple(9.0 * along + (0.4 + 0.3 * ahead) * left))


@pytest.mark.parametrize("kind", VEHICLE_CLASSES)
def test_distances_of_a_class_add_up(kind: ActorClass) -> None:
    p = PARAMETERS[kind]
    rear_axle = p.length_m - p.front_overhang_m - p.wheelbase_m
    assert p.length_m / 2.0 - rear_axle == pytest.approx(p.centre_ahead_of_rear_axle_m)
    cg = rear_axle + p.wheelbase_m - p.cg_to_front_axle_m
    assert p.length_m / 2.0 - cg == pytest.approx(p.centre_ahead_of_cg_m)


def attainable_accel_mps2(p: VehicleParameters, speed: float) -> float:
    """Of the force balance on a level road."""
    drive = min(p.max_drive_accel_mps2, p.drive_power_w / (p.mass_kg * speed))
    drag = 0.5 * 1.225 * p.drag_area_m2 * speed**2 / p.mass_kg
    return drive - drag - 9.80665 * p.rolling_resistance


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    copy = tmp_path / "vehicles"
    shutil.copytree(params_dir() / "vehicles", copy)
    return copy


def _edit(folder: Path, name: str, old: str, new: str) -> Path:
    file = folder / f"{name}.yaml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    return file


def test_a_record_needs_no_class_that_is_newer_than_it(folder: Path) -> None:
    def recorded(*without: str) -> RecordedFiles:
        files = (file for file in sorted(folder.glob("*.yaml")) if file.stem not in without)
        return RecordedFiles([InputFile("vehicles", file.stem, file.read_text(encoding="utf-8"), "") for file in files])

    earlier = load_vehicle_parameters(recorded("suv"))
    assert {*earlier} == {*ActorClass}
    assert earlier[ActorClass.SUV] == earlier[ActorClass.SEDAN]
    on_four_wheels = load_vehicle_parameters(recorded("bicycle", "motorcycle", "pedestrian"))
    assert set(on_four_wheels) == set(ActorClass) - TWO_WHEELED - {ActorClass.PEDESTRIAN}
    with pytest.raises(InputError, match="bus"):
        load_vehicle_parameters(recorded("bus"))


@pytest.mark.parametrize("kind", VEHICLE_CLASSES)
def test_classes_are_plausible(kind: ActorClass) -> None:
    vehicle = PARAMETERS[kind]
    radius_of_gyration_m = np.sqrt(vehicle.yaw_inertia_kgm2 / vehicle.mass_kg)
    assert 0.2 * vehicle.length_m < radius_of_gyration_m < 0.33 * vehicle.length_m
    understeer_deg_per_g = np.degrees(vehicle.understeer_gradient_s2pm * GRAVITY_MPS2)
    assert 0.5 < understeer_deg_per_g < 4.0
    assert vehicle.max_brake_decel_mps2 < vehicle.friction_coefficient * GRAVITY_MPS2
    cruise_kmph = 18.0 if kind is ActorClass.BICYCLE else 50.0
    assert attainable_accel_mps2(vehicle, cruise_kmph / 3.6) > 0.5
    assert 0.35 * vehicle.wheelbase_m < vehicle.centre_ahead_of_rear_axle_m < vehicle.wheelbase_m


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("mass_kg: 1560.0", "mass_kg: heavy", ("mass_kg", "heavy", "a number from 60 to 45000")),
        ("mass_kg: 1560.0", "mass_kg: -3.0", ("mass_kg", "-3.0", "a number from 60 to 45000")),
        ("mass_kg: 1560.0", "mass_kg: .nan", ("mass_kg", "nan", "a number from 60 to 45000")),
        ("mass_kg: 1560.0", "weight_kg: 1560.0", ("mass_kg", "None", "missing")),
        ("wheelbase_m: 2.8 ", "wheelbase_m: 4.5 ", ("wheelbase_m", "4.5", "less than length_m")),
        ("front_axle_m: 1.3 ", "front_axle_m: 2.9 ", ("cg_to_front_axle_m", "2.9", "less than wheelbase_m")),
        ("mass_kg: 1560.0", "colour: 1.0\nmass_kg: 1560.0", ("colour", "1.0", "keys brake_lag_s")),
    ],
)
def test_bad_values_are_refused(folder: Path, old: str, new: str, parts: tuple[str, str, str]) -> None:
    file = _edit(folder, "sedan", old, new)
    with pytest.raises(InputError) as caught:
        read_vehicle_parameters(folder)
    assert str(file) in str(caught.value)
    for part in parts:
        assert part in str(caught.value)


def test_missing_file_is_named(folder: Path) -> None:
    (folder / "bus.yaml").unlink()
    with pytest.raises(InputError, match=r"bus\.yaml"):
        read_vehicle_parameters(folder)


@pytest.mark.parametrize("kind", [ActorClass.SEDAN, ActorClass.BUS])
def test_a_longer_vehicle_has_its_axles_in_the_same_shares(kind: ActorClass) -> None:
    own = PARAMETERS[kind]
    assert own.sized(own.length_m, own.width_m, own.height_m) is own
    longer = own.sized(1.1 * own.length_m, own.width_m, 0.9 * own.height_m)
    assert (longer.length_m, longer.width_m, longer.height_m) == (1.1 * own.length_m, own.width_m, 0.9 * own.height_m)
    for name in ("wheelbase_m", "front_overhang_m", "cg_to_front_axle_m", "centre_ahead_of_rear_axle_m"):
        assert getattr(longer, name) == pytest.approx(1.1 * getattr(own, name))
    assert longer.yaw_inertia_kgm2 == pytest.approx(1.21 * own.yaw_inertia_kgm2)
    assert longer.understeer_gradient_s2pm == pytest.approx(own.understeer_gradient_s2pm)
