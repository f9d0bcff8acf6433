"""Pedals that hold a wanted speed: proportional-integral control over the vehicle's own force limits."""

from dataclasses import dataclass
from typing import Final

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.dynamics.parameters import AIR_DENSITY_KGPM3, VehicleParameters
from siren_ros.numerics.units import GRAVITY_MPS2, STEP_S

_STANDSTILL_MPS: Final = 0.3
_STOP_TARGET_MPS: Final = 0.05
_HOLD_BRAKE: Final = 0.6
_INTEGRAL_LIMIT_MPS2: Final = 0.8
_INTEGRAL_BAND_MPS: Final = 1.0
_FIRM_BRAKING: Final = 1.3
"""Braking towards a lower speed, relative to the comfortable deceleration of the path's speed profile."""
_COAST_MPS2: Final = 0.05
"""Decelerations below it come from rolling alone."""


@dataclass(frozen=True)
class Pedals:
    """Throttle and brake, 0–1 each, and the integral to carry on, in m/s²."""

    throttle: float
    brake: float
    integral_mps2: float


def press_pedals(
    speed_mps: float,
    wanted_mps: float,
    must_brake_mps2: float,
    integral_mps2: float,
    vehicle: VehicleParameters,
    config: NavigatorConfig,
) -> Pedals:
    """Pedals for a wanted speed.

    Args:
        speed_mps: Present speed.
        wanted_mps: Speed to reach.
        must_brake_mps2: Deceleration that is needed at least (0: none), so as not to hit what is ahead.
        integral_mps2: Integral from the step before; it stands still outside a band around the wanted speed and
            while a limit is hit, so that it does not wind up.
        vehicle: For traction, power, drag, rolling resistance and brakes.
        config: Gains and the comfortable acceleration.
    """
    if wanted_mps <= _STOP_TARGET_MPS and speed_mps <= _STANDSTILL_MPS:
        return Pedals(0.0, _HOLD_BRAKE, 0.0)
    error = wanted_mps - speed_mps
    asked = config.speed_gain_1ps * error + integral_mps2
    accel = max(-_FIRM_BRAKING * config.comfort_brake_mps2, min(config.comfort_accel_mps2, asked))
    free = accel == asked
    if must_brake_mps2 > 0.0:
        accel, free = min(accel, -must_brake_mps2), False
    resistance = (
        0.5 * AIR_DENSITY_KGPM3 * vehicle.drag_area_m2 * speed_mps**2 / vehicle.mass_kg
        + vehicle.rolling_resistance * GRAVITY_MPS2
    )
    force = accel + resistance
    most = min(vehicle.max_drive_accel_mps2, vehicle.drive_power_w / (vehicle.mass_kg * max(speed_mps, 1.0)))
    throttle = min(max(force, 0.0) / most, 1.0)
    brake = min(-force / vehicle.max_brake_decel_mps2, 1.0) if force < -_COAST_MPS2 else 0.0
    integral = 0.0
    if abs(error) < _INTEGRAL_BAND_MPS:
        grown = integral_mps2 + config.speed_integral_1ps2 * error * STEP_S if free else integral_mps2
        integral = max(-_INTEGRAL_LIMIT_MPS2, min(_INTEGRAL_LIMIT_MPS2, grown))
    return Pedals(throttle, brake, integral)
