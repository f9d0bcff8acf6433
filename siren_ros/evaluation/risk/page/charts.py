"""Curves as the points of small SVG charts."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.risk.labels import RiskThresholds
from siren_ros.evaluation.risk.page.curves import Curves
from siren_ros.numerics.arrays import Floats

WIDTH: Final = 380.0
HEIGHT: Final = 64.0
_TIME_TO_COLLISION_MAX_S: Final = 5.0
_DECELERATION_MAX_MPS2: Final = 10.0
_ENCROACHMENT_MAX_S: Final = 5.0


@dataclass(frozen=True)
class Chart:
    """One measure over the time of a video; coordinates in a box of WIDTH by HEIGHT, y downwards."""

    title: str
    unit: str
    top: float
    """Value at the upper edge; greater ones are drawn there."""
    limit: float
    """From where on the measure counts as a near-miss."""
    limit_y: float
    path: str
    """Of the SVG path; empty without a value."""
    dots: tuple[tuple[float, float, str], ...]
    """x, y and what to say of it."""
    extreme: str
    """The most critical value and its time, in words."""


def charts_of(curves: Curves, thresholds: RiskThresholds) -> tuple[Chart, ...]:
    """TTC, PET and DRAC of a video."""
    length_s = len(curves.time_s) * (curves.time_s[1] - curves.time_s[0])
    across = WIDTH / length_s
    dots = [(dot.at_s, dot.value) for dot in curves.encroachments]
    return (
        _line(
            "TTC",
            "s",
            curves.time_s,
            curves.time_to_collision_s,
            across,
            _TIME_TO_COLLISION_MAX_S,
            thresholds.time_to_collision_s,
            least=True,
        ),
        Chart(
            "PET",
            "s",
            _ENCROACHMENT_MAX_S,
            thresholds.post_encroachment_s,
            _y(thresholds.post_encroachment_s, _ENCROACHMENT_MAX_S),
            "",
            tuple((at * across, _y(value, _ENCROACHMENT_MAX_S), f"{value:.2f} s at {at:.1f} s") for at, value in dots),
            _said(*min(dots, key=lambda dot: dot[1]), "s") if dots else "",
        ),
        _line(
            "DRAC",
            "m/s²",
            curves.time_s,
            curves.required_deceleration_mps2,
            across,
            _DECELERATION_MAX_MPS2,
            thresholds.required_deceleration_mps2,
            least=False,
        ),
    )


def _line(
    title: str, unit: str, time_s: Floats, values: Floats, across: float, top: float, limit: float, *, least: bool
) -> Chart:
    known = np.flatnonzero(np.isfinite(values))
    extreme = ""
    if len(known):
        at = known[np.argmin(values[known]) if least else np.argmax(values[known])]
        extreme = _said(time_s[at], values[at], unit)
    return Chart(title, unit, top, limit, _y(limit, top), _path(time_s * across, values, top), (), extreme)


def _said(at_s: float, value: float, unit: str) -> str:
    return f"{value:.2f} {unit} at {at_s:.1f} s"


def _path(x: Floats, values: Floats, top: float) -> str:
    """Moves and lines; the pen is lifted where a value is missing. Single values become a short stroke."""
    parts, drawing = [], False
    for at, value in zip(x.tolist(), values.tolist(), strict=True):
        if not np.isfinite(value):
            drawing = False
            continue
        place = f"{at:.1f} {_y(value, top):.1f}"
        parts.append(f"L{place}" if drawing else f"M{place}h0.6")
        drawing = True
    return "".join(parts)


def _y(value: float, top: float) -> float:
    return HEIGHT * (1.0 - min(max(value, 0.0), top) / top)
