"""One step of the model against its equations, term by term: a change of any of them shows in the last digits."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from siren_ros.dynamics.parameters import ParameterTable, VehicleParameters, load_vehicle_parameters
from siren_ros.dynamics.vehicle_model import BodyState, Controls, step_bodies
from siren_ros.numerics.units import GRAVITY_MPS2
from siren_ros.world.actors import ActorClass

PARAMETERS = load_vehicle_parameters()
STEP_S = 0.01
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
    wanted: tuple[float, float, float] = (0.0, 0.0, 0.0)
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
    h, m, inertia = STEP_S, p.mass_kg, p.yaw_inertia_kgm2
    a, b = p.cg_to_front_axle_m, p.wheelbase_m - p.cg_to_front_axle_m
    u, v, w = case.u, case.v, case.w
    pedal, brake, steer = (np.clip(case.wanted[0], 0, 1), np.clip(case.wanted[1], 0, 1), case.wanted[2])
    q = case.quickness
    throttle = pedal + (case.throttle - pedal) * np.exp(-h * q / p.throttle_lag_s)
    brake = brake + (case.brake - brake) * np.exp(-h * q / p.brake_lag_s)
    most = p.max_steer_rate_radps * h * q
    wanted = np.clip(steer, -p.max_steer_rad, p.max_steer_rad)
    steer = case.steer + np.clip((wanted - case.steer) * (1.0 - np.exp(-h * q / p.steer_lag_s)), -most, most)
    front_load, rear_load = loads_n(p, case.accel)
    drive = throttle * case.drive_factor * min(m * p.max_drive_accel_mps2, p.drive_power_w / max(u, 0.1))
    braking = brake * m * p.max_brake_decel_mps2
    braking_rear = 0.7 * braking * rear_load / (front_load + rear_load)
    grip = p.friction_coefficient * np.array([front_load, rear_load])
    along = np.array(
        [
            p.drive_front_share * drive - braking + braking_rear,
            (1.0 - p.drive_front_share) * drive - braking_rear - case.hand * m * p.hand_brake_decel_mps2,
        ]
    )
    along = np.clip(along, -0.95 * grip, 0.95 * grip)
    limit = np.sqrt(grip**2 - along**2)
    cos, sin, tan = np.cos(steer), np.sin(steer), np.tan(steer)
    total = along[0] * cos + along[1]
    left = along[0] * sin * np.clip(u / 0.1, -1.0, 1.0)
    speed = np.sqrt(u * u + v * v + (a * w) ** 2) + 1e-9
    front = secant_npr(p.cornering_stiffness_front_npr, limit[0], abs(u * tan - v - a * w) / speed, cos)
    rear = secant_npr(p.cornering_stiffness_rear_npr, limit[1], abs(v - b * w) / speed, 1.0)
    matrix = np.array(
        [
            [speed * m / h + front + rear, speed * m * u + front * a - rear * b],
            [front * a - rear * b, speed * inertia / h + front * a * a + rear * b * b],
        ]
    )
    right = np.array(
        [
            speed * (m / h * v + left) + front * u * tan,
            speed * (inertia / h * w + a * left) + a * front * u * tan,
        ]
    )
    v_free, w_free = np.linalg.solve(matrix, right)
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
    one = np.ones(1)
    body = replace(
        BodyState.moving(5.0 * one, -7.0 * one, yaw * one, case.u * one),
        lateral_mps=case.v * one,
        yaw_rate_radps=case.w * one,
        accel_mps2=case.accel * one,
        steer_rad=case.steer * one,
        throttle=case.throttle * one,
        brake=case.brake * one,
    )
    throttle, brake, steer = case.wanted
    controls = Controls(
        throttle * one,
        brake * one,
        steer * one,
        np.full(1, case.hand),
        case.quickness * one,
        case.drive_factor * one,
    )
    return step_bodies(body, controls, ParameterTable.of([kind], PARAMETERS), count * STEP_S)


CASES = {
    "coasts": Case(12.0),
    "turns left": Case(9.0, 0.1, 0.2, 0.5, 0.06, 0.2, 0.0, (0.3, 0.0, 0.07)),
    "turns right": Case(9.0, -0.1, -0.2, 0.5, -0.06, 0.2, 0.0, (0.3, 0.0, -0.07)),
    "steers as fast as it can": Case(7.0, steer=-0.1, wanted=(0.0, 0.0, 0.5)),
    "steers back as fast as it can": Case(7.0, steer=0.1, wanted=(0.0, 0.0, -2.0), quickness=3.0),
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
    middle, left = yaw + 0.5 * STEP_S * w, v + p.centre_ahead_of_cg_m * w
    along, across = np.array([np.cos(middle), np.sin(middle)]), np.array([-np.sin(middle), np.cos(middle)])
    assert np.array([after.x_m[0] - 5.0, after.y_m[0] + 7.0]) == pytest.approx(STEP_S * (u * along + left * across))
    assert after.yaw_rad[0] == pytest.approx(yaw + STEP_S * w)


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
        found = substep(p, state)
        state = replace(
            state,
            u=found["forward_mps"],
            v=found["lateral_mps"],
            w=found["yaw_rate_radps"],
            steer=found["steer_rad"],
            throttle=found["throttle"],
            brake=found["brake"],
        )
        turned += STEP_S * state.w
        middle, left = turned - 0.5 * STEP_S * state.w, state.v + p.centre_ahead_of_cg_m * state.w
        cos, sin = np.cos(middle), np.sin(middle)
        moved += STEP_S * np.array([state.u * cos - left * sin, state.u * sin + left * cos])
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
    one = np.ones(1)
    body = replace(
        BodyState.moving(0.0 * one, 0.0 * one, 0.0 * one, 0.0 * one), lateral_mps=v * one, yaw_rate_radps=w * one
    )
    after = step_bodies(body, Controls(0 * one, 0 * one, 0 * one, np.ones(1, bool), one, one), table, 0.001)
    assert ((after.lateral_mps[0], after.yaw_rate_radps[0]) == (0.0, 0.0)) is still
