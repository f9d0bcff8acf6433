"""How each civilian driver responds to a siren: one draw per driver from the episode's seed."""

from dataclasses import dataclass
from enum import StrEnum

from siren_ros.numerics.random_streams import random_stream
from siren_ros.scenario.presets import DriverPreset


class Compliance(StrEnum):
    """Whether a driver yields."""

    COMPLIES = "complies"
    LATE = "late"
    NEVER = "never"


@dataclass(frozen=True)
class Driver:
    """One driver's response."""

    compliance: Compliance
    delay_s: float
    """From noticing the siren to the start of the manoeuvre, the extra delay of late drivers included."""
    response_distance_m: float
    """Free way between the EMV's front and the vehicle's rear at which the driver notices the siren."""


def draw_driver(preset: DriverPreset, seed: int, actor_id: int) -> Driver:
    """The driver of one actor; the same for the same preset, seed and actor whatever else is drawn."""
    rng = random_stream(seed, "driver", actor_id)
    delay = preset.reaction_delay_s.draw(rng)
    late = preset.late_delay_s.draw(rng)
    distance = preset.response_distance_m.draw(rng)
    share = float(rng.random())
    if share < preset.compliance.complies:
        return Driver(Compliance.COMPLIES, delay, distance)
    if share < preset.compliance.complies + preset.compliance.late:
        return Driver(Compliance.LATE, delay + late, distance)
    return Driver(Compliance.NEVER, delay, distance)
