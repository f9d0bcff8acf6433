"""How drivers respond to a siren: presets of distributions, one draw per driver, and their other parameters."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.params.parameters import FILES_ON_DISK, InputFiles, StrictMapping
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.driver_parameters import DriverParameters, check_driver_value
from siren_ros.simulation.scenario.paper import PAPER_CONSTANTS

_SHARE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class TruncatedNormal:
    """A normal distribution cut off at ``minimum`` and ``maximum``; a constant where ``std`` is 0."""

    mean: float
    std: float
    minimum: float
    maximum: float

    def draw(self, rng: np.random.Generator) -> float:
        """One value; draws outside the limits are drawn again, at most 64 times, then clipped."""
        value = self.mean
        if self.std > 0.0:
            for _ in range(64):
                value = float(rng.normal(self.mean, self.std))
                if self.minimum <= value <= self.maximum:
                    break
        return min(max(value, self.minimum), self.maximum)

    def scaled(self, factor: float) -> "TruncatedNormal":
        """The distribution of ``factor`` times the value."""
        return TruncatedNormal(self.mean * factor, self.std * factor, self.minimum * factor, self.maximum * factor)

    def shifted(self, by: float) -> "TruncatedNormal":
        """The distribution of the value plus ``by``."""
        return TruncatedNormal(self.mean + by, self.std, self.minimum + by, self.maximum + by)


@dataclass(frozen=True)
class ComplianceShares:
    """Shares of drivers that comply at once, late, or never; they add up to 1."""

    complies: float
    late: float
    never: float


@dataclass(frozen=True)
class Attention:
    """Which drivers look out for others where ways cross; by default all of them, as far ahead as it matters."""

    civilians: float = 1.0
    """Share of the drivers who see an EMV that comes across their way against a signal or sign."""
    emv_horizon_s: float = 8.0
    """The EMV's driver counts with those who come to the crossing of the ways within this time."""
    emv_pet_s: float = 1.2
    """Time that the EMV's driver means to leave behind those who cross its way (post-encroachment time)."""
    emv_line_mps: TruncatedNormal = TruncatedNormal(5.556, 0.8, 4.0, 7.5)
    """Speed of EMVs at a line at which others have the right of way, one draw per driver."""


@dataclass(frozen=True)
class OncomingResponse:
    """What drivers do when an EMV with a siren comes towards them on a road that nothing divides."""

    share: float = 0.0
    """Share of drivers who react: they keep right and slow down."""
    speed_share: float = 1.0
    """Share of their wished speed to which they slow down."""


@dataclass(frozen=True)
class DriverPreset:
    """Distributions from which each civilian driver's response to a siren is drawn."""

    name: str
    title: str
    reaction_delay_s: TruncatedNormal
    """Time from noticing the siren to the start of the manoeuvre."""
    late_delay_s: TruncatedNormal
    """Time that is added to the reaction delay of drivers who comply late."""
    response_distance_m: TruncatedNormal
    """Distance between the two vehicles at which the driver notices the siren."""
    compliance: ComplianceShares
    attention: Attention = Attention()
    oncoming: OncomingResponse = OncomingResponse()
    pedestrian_distance_m: TruncatedNormal = TruncatedNormal(0.0, 0.0, 0.0, 0.0)
    """Distance to an EMV with a siren at which a pedestrian waits at the kerb, or hurries over a crossing."""
    rescue_at_once: float = 1.0
    """Share of the motorway's jams whose drivers form the rescue lane unasked."""
    rescue_late: float = 0.0
    """Share of those whose drivers form it only when an EMV with a siren comes; in the others they only yield to it."""
    rescue_near_m: TruncatedNormal = TruncatedNormal(0.0, 0.0, 0.0, 0.0)
    """Distance to that EMV at which they do."""
    filtering: float = 0.0
    """Share of the motorcyclists who follow an EMV through the rescue lane."""
    lane_change_log_s: TruncatedNormal | None = None
    """Logarithm of the time of a driver's lane changes that no EMV asks for; None where all change as fast as then."""
    drivers: Mapping[str, float] = field(default_factory=dict)
    """Parameters of drivers that differ from their defaults, by their names in ``DRIVER_PARAMETERS``."""
    fitted_to: tuple[str, ...] = ()
    """Lines of the ledger of published figures to which the preset was fitted."""

    def for_scenario(self, response_distance_m: float, extra_delay_s: float, compliance: float) -> "DriverPreset":
        """The preset with the values of a scenario.

        The response distance scales as the scenario's value over the radius of the paper's interaction region, 40 m and
        every template's default: a preset whose drivers respond at 20 m keeps them there unless another one is asked.
        The delay is added to every reaction delay. ``compliance`` is a factor 0–1 on the shares that comply at once or
        late.
        """
        complies, late = self.compliance.complies * compliance, self.compliance.late * compliance
        return replace(
            self,
            reaction_delay_s=self.reaction_delay_s.shifted(extra_delay_s),
            response_distance_m=self.response_distance_m.scaled(response_distance_m / PAPER_CONSTANTS.region_enter_m),
            compliance=ComplianceShares(complies, late, 1.0 - complies - late),
        )


def load_preset(name_or_path: str, files: InputFiles = FILES_ON_DISK, seed: int = 0) -> DriverPreset:
    """A preset by its name or from a YAML file.

    A preset that is known only up to a distribution lists draws from it under ``draws``: each has parts of the preset
    in place of the written ones. The seed chooses one of them.

    Raises:
        InputError: unknown preset, or a file with an unknown key or a value out of range (names file and line).
    """
    top = files.read("preset", "presets", name_or_path).mapping()
    parts = _parts(top, [key for key in _PARTS if key in _REQUIRED or top.has(key)])
    preset = DriverPreset(name=Path(name_or_path).stem, title=top.text("title"), **parts)
    if top.has("fitted_to"):
        preset = replace(preset, fitted_to=tuple(top.words("fitted_to")))
    draws = [_drawn(preset, each) for each in top.mappings("draws")] if top.has("draws") else []
    top.finish()
    return draws[int(random_stream(seed, "preset").integers(len(draws)))] if draws else preset


def _drawn(preset: DriverPreset, section: StrictMapping) -> DriverPreset:
    parts = _parts(section, [key for key in _PARTS if section.has(key)])
    section.finish()
    drivers = {**preset.drivers, **parts.pop("drivers", {})}
    return replace(preset, **parts, drivers=drivers)


def _parts(section: StrictMapping, keys: Iterable[str]) -> dict[str, Any]:
    """The fields of ``DriverPreset`` that some parts give."""
    return {name: value for key in keys for name, value in _PARTS[key](section, key).items()}


def _rescue_lane(top: StrictMapping, key: str) -> dict[str, Any]:
    section = top.mapping(key)
    at_once = section.number("at_once", 0.0, 1.0)
    late = section.number("late", 0.0, 1.0 - at_once)
    near = read_distribution(section.mapping("near_m"), 0.0, 1000.0)
    section.finish()
    return {"rescue_at_once": at_once, "rescue_late": late, "rescue_near_m": near}


def _drivers(section: StrictMapping) -> dict[str, float]:
    values = {name: section.number(name, -math.inf, math.inf) for name in section.values}
    for name, value in values.items():
        check_driver_value(name, value, section.where(name))
    DriverParameters().with_values(values)
    return values


def _attention(section: StrictMapping) -> Attention:
    attention = Attention(
        section.number("civilians", 0.0, 1.0),
        section.number("emv_horizon_s", 0.0, 60.0),
        section.number("emv_pet_s", 0.0, 10.0),
        read_distribution(section.mapping("emv_line_mps"), 0.0, 40.0),
    )
    section.finish()
    return attention


def _oncoming(section: StrictMapping) -> OncomingResponse:
    response = OncomingResponse(section.number("share", 0.0, 1.0), section.number("speed_share", 0.1, 1.0))
    section.finish()
    return response


def read_distribution(section: StrictMapping, low: float, high: float) -> TruncatedNormal:
    """A distribution written as ``{mean, std, min, max}``, all within ``[low, high]``; raises InputError otherwise."""
    minimum = section.number("min", low, high)
    maximum = section.number("max", minimum, high)
    mean, std = section.number("mean", minimum, maximum), section.number("std", 0.0, high)
    section.finish()
    return TruncatedNormal(mean, std, minimum, maximum)


def _lane_change(section: StrictMapping) -> TruncatedNormal:
    """The logarithm of a log-normal time, whose mean and deviation are written."""
    written = read_distribution(section, 0.5, 60.0)
    variance = math.log1p((written.std / written.mean) ** 2)
    middle, limits = math.log(written.mean) - 0.5 * variance, (math.log(written.minimum), math.log(written.maximum))
    return TruncatedNormal(middle, math.sqrt(variance), *limits)


def _shares(section: StrictMapping) -> ComplianceShares:
    shares = ComplianceShares(*(section.number(key, 0.0, 1.0) for key in ("complies", "late", "never")))
    section.finish()
    total = shares.complies + shares.late + shares.never
    if abs(total - 1.0) > _SHARE_TOLERANCE:
        raise InputError(section.where("never"), total, "shares complies + late + never that add up to 1")
    return shares


def _within(high: float, low: float = 0.0) -> "_Reader":
    return lambda section, key: {key: read_distribution(section.mapping(key), low, high)}


def _section(read: Callable[[StrictMapping], Any]) -> "_Reader":
    return lambda section, key: {key: read(section.mapping(key))}


_Reader = Callable[[StrictMapping, str], dict[str, Any]]
_PARTS: Final[Mapping[str, _Reader]] = {
    "reaction_delay_s": _within(30.0),
    "late_delay_s": _within(60.0),
    "response_distance_m": _within(300.0, 1.0),
    "compliance": _section(_shares),
    "attention": _section(_attention),
    "oncoming": _section(_oncoming),
    "pedestrian_distance_m": _within(300.0),
    "rescue_lane": _rescue_lane,
    "filtering": lambda section, key: {key: section.number(key, 0.0, 1.0)},
    "lane_change_s": lambda section, key: {"lane_change_log_s": _lane_change(section.mapping(key))},
    "drivers": _section(_drivers),
}
"""Parts of a preset's file, with readers of the fields that they give."""
_REQUIRED: Final = frozenset({"reaction_delay_s", "late_delay_s", "response_distance_m", "compliance"})
