"""The compiled loops against the equations that they stand for, integrated here in small explicit steps."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.base.numerics.units import GRAVITY_MPS2, STEP_S
from siren_ros.simulation.dynamics.parameters import (
    AIR_DENSITY_KGPM3,
    ParameterTable,
    VehicleParameters,
    load_vehicle_parameters,
)
from siren_ros.simulation.dynamics.vehicle_model import BodyState, Controls, step_bodies
from siren_ros.simulation.world.actors import VEHICLE_CLASSES, ActorClass

PARAMETERS = load_vehicle_parameters()
FINE_S = 5e-4


def fiala(stiffness: float, limit_n: float, slip: float) -> float:
    """Lateral force of an axle from the tangent of its slip angle (Rajamani 2012, eq. 13.47)."""
    z = stiffness * abs(slip) / (3.0 * limit_n)
    return np.sign(slip) * (stiffness * abs(slip) * (1.0 - z + z * z / 3.0) if z < 1.0 else limit_n)


class Reference:
    """One vehicle: Newton's equations of the single-track model, actuators and resistances, explicit Euler."""

    def __init__(self, vehicle: VehicleParameters, pose: tuple[float, float, float], speed_mps: float) -> None:
        self.vehicle = vehicle
        self.yaw = pose[2]
        ahead = vehicle.centre_ahead_of_cg_m
        self.xy = np.array(pose[:2]) - ahead * np.array([np.cos(self.yaw), np.sin(self.yaw)])
        self.u, self.v, self.w = speed_mps, 0.0, 0.0
        self.steer = self.throttle = self.brake = 0.0
        self.accel = 0.0

    @property
    def centre(self) -> np.ndarray:
        ahead = self.vehicle.centre_ahead_of_cg_m
        return self.xy + ahead * np.array([np.cos(self.yaw), np.sin(self.yaw)])

    def step(self, throttle: float, brake: float, steer_rad: float) -> None:
        """One step of the simulation; the axle loads follow the mean acceleration of the step before."""
        before, loads = self.u, self.accel
        cross = self.v * self.w
        for _ in range(round(STEP_S / FINE_S)):
            self._advance(throttle, brake, steer_rad, loads)
        self.accel = (self.u - before) / STEP_S - 0.5 * (cross + self.v * self.w)

    def _advance(self, throttle: float, brake: float, steer_rad: float, loads: float) -> None:
        p, h = self.vehicle, FINE_S
        self.throttle += h / p.throttle_lag_s * (throttle - self.throttle)
        self.brake += h / p.brake_lag_s * (brake - self.brake)
        rate = (steer_rad - self.steer) / p.steer_lag_s
        self.steer += h * max(-p.max_steer_rate_radps, min(p.max_steer_rate_radps, rate))
        a, b, m = p.cg_to_front_axle_m, p.wheelbase_m - p.cg_to_front_axle_m, p.mass_kg
        load_f = m * (GRAVITY_MPS2 * b - loads * p.cg_height_m) / p.wheelbase_m
        load_r = m * (GRAVITY_MPS2 * a + loads * p.cg_height_m) / p.wheelbase_m
        drive = self.throttle * min(m * p.max_drive_accel_mps2, p.drive_power_w / max(self.u, 0.1))
        braking = self.brake * m * p.max_brake_decel_mps2
        braking_r = 0.7 * braking * load_r / (load_f + load_r)
        fx_f = drive * p.drive_front_share - (braking - braking_r)
        fx_r = drive * (1.0 - p.drive_front_share) - braking_r
        limit_f = np.sqrt((p.friction_coefficient * load_f) ** 2 - fx_f**2)
        limit_r = np.sqrt((p.friction_coefficient * load_r) ** 2 - fx_r**2)
        cos, sin = np.cos(self.steer), np.sin(self.steer)
        speed = np.sqrt(self.u**2 + self.v**2 + (a * self.w) ** 2)
        slip_f = (self.u * np.tan(self.steer) - self.v - a * self.w) / speed * cos * cos
        slip_r = (-self.v + b * self.w) / speed
        fy_f = fiala(p.cornering_stiffness_front_npr, limit_f, slip_f)
        fy_r = fiala(p.cornering_stiffness_rear_npr, limit_r, slip_r)
        drag = 0.5 * AIR_DENSITY_KGPM3 * p.drag_area_m2 * self.u**2 + p.rolling_resistance * GRAVITY_MPS2 * m
        du = (fx_f * cos + fx_r - fy_f * sin - drag) / m + self.v * self.w
        dv = (fy_f * cos + fx_f * sin + fy_r) / m - self.u * self.w
        dw = (a * (fy_f * cos + fx_f * sin) - b * fy_r) / p.yaw_inertia_kgm2
        along, left = np.array([np.cos(self.yaw), np.sin(self.yaw)]), np.array([-np.sin(self.yaw), np.cos(self.yaw)])
        self.xy += h * (self.u * along + self.v * left)
        self.yaw += h * self.w
        self.u, self.v, self.w = self.u + h * du, self.v + h * dv, self.w + h * dw


MANOEUVRES = {
    "accelerates to the left": (6.0, 0.9, 0.0, 0.12),
    "coasts to the right": (14.0, 0.0, 0.0, -0.05),
    "brakes in a bend": (15.0, 0.0, 0.5, 0.04),
    "at the limit of grip": (16.0, 0.3, 0.0, -0.2),
    "straight on at full throttle": (20.0, 1.0, 0.0, 0.0),
}


@pytest.mark.parametrize("kind", [ActorClass.SEDAN, ActorClass.AMBULANCE, ActorClass.BUS])
@pytest.mark.parametrize("manoeuvre", list(MANOEUVRES))
def test_a_manoeuvre_of_a_second_is_that_of_the_equations(kind: ActorClass, manoeuvre: str) -> None:
    speed, throttle, brake, steer = MANOEUVRES[manoeuvre]
    pose = (3.0, -2.0, 0.7)
    expected = Reference(PARAMETERS[kind], pose, speed)
    table = ParameterTable.of([kind], PARAMETERS)
    body = BodyState.moving(*(np.array([value]) for value in (*pose, speed)))
    pedals_and_wheels = (np.full(1, value) for value in (throttle, brake, steer))
    controls = Controls(*pedals_and_wheels, np.zeros(1, bool), np.ones(1), np.ones(1))
    for _ in range(20):
        expected.step(throttle, brake, steer)
        body = step_bodies(body, controls, table, STEP_S)
    assert (body.x_m[0], body.y_m[0]) == pytest.approx(tuple(expected.centre), abs=0.04)
    assert body.yaw_rad[0] == pytest.approx(expected.yaw, abs=0.012)
    assert body.forward_mps[0] == pytest.approx(expected.u, abs=0.04)
    assert body.lateral_mps[0] == pytest.approx(expected.v, abs=0.1)
    assert body.yaw_rate_radps[0] == pytest.approx(expected.w, abs=0.03)
    assert body.accel_mps2[0] == pytest.approx(expected.accel, abs=0.12)
    assert body.steer_rad[0] == pytest.approx(expected.steer, abs=0.003)
    assert (body.throttle[0], body.brake[0]) == pytest.approx((expected.throttle, expected.brake), abs=0.01)


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


@pytest.mark.parametrize("speed", [2.0, 14.0, 30.0])
def test_the_attainable_acceleration_is_that_of_full_throttle(speed: float) -> None:
    """Of the force balance, and of the model after the pedal's lag."""
    p = PARAMETERS[ActorClass.AMBULANCE]
    drive = min(p.max_drive_accel_mps2, p.drive_power_w / (p.mass_kg * speed))
    drag = 0.5 * 1.225 * p.drag_area_m2 * speed**2 / p.mass_kg
    expected = drive - drag - 9.80665 * p.rolling_resistance
    assert p.attainable_accel_mps2(speed) == pytest.approx(expected)
    table = ParameterTable.of([ActorClass.AMBULANCE], PARAMETERS)
    full, zero = np.ones(1), np.zeros(1)
    body = replace(BodyState.moving(zero, zero, zero, speed * full), throttle=full)
    after = step_bodies(body, Controls(full, zero, zero, np.zeros(1, bool), full, full), table, STEP_S)
    assert after.accel_mps2[0] == pytest.approx(expected, rel=0.02)
