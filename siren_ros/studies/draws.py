"""Draws of a template's parameters: every combination of values, random values, or a Latin hypercube."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from siren_ros.errors import InputError
from siren_ros.numerics.random_streams import random_stream
from siren_ros.scenario.scenario import Template, ValueRange

_NOT_DRAWN: Final = frozenset({"duration_s"})
"""How long an episode lasts is drawn only where the study names it."""


class Method(StrEnum):
    """How values are chosen."""

    GRID = "grid"
    RANDOM = "random"
    LATIN_HYPERCUBE = "latin_hypercube"


@dataclass(frozen=True)
class DrawPlan:
    """Which values of a template's parameters a study runs."""

    method: Method
    values: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Of a grid: the values of each parameter."""
    samples: int = 0
    """Of the other methods: number of draws."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Of the other methods: the parameters and between what they are drawn; empty: all of the template, over the
    ranges in its file."""
    seed: int = 0


def draws_of(plan: DrawPlan, template: Template) -> tuple[dict[str, float], ...]:
    """The values of each draw, in a fixed order.

    A template's draws do not depend on which other templates are in the study.

    Raises:
        InputError: A parameter that the template does not have, or a value outside its range.
    """
    found = _grid(plan) if plan.method is Method.GRID else _sampled(plan, template)
    for values in found:
        template.with_values(values)
    return found


def _grid(plan: DrawPlan) -> tuple[dict[str, float], ...]:
    names = sorted(plan.values)
    return tuple(
        dict(zip(names, values, strict=True)) for values in itertools.product(*(plan.values[name] for name in names))
    )


def _sampled(plan: DrawPlan, template: Template) -> tuple[dict[str, float], ...]:
    if plan.samples < 1:
        raise InputError("samples", plan.samples, "1 or more")
    ranges = _ranges(plan, template)
    rng = random_stream(plan.seed, f"study/{template.template_id}")
    unit = (
        qmc.LatinHypercube(len(ranges), seed=rng).random(plan.samples)
        if plan.method is Method.LATIN_HYPERCUBE
        else rng.random((plan.samples, len(ranges)))
    )
    columns = {path: _scaled(unit[:, column], limits) for column, (path, limits) in enumerate(sorted(ranges.items()))}
    return tuple({path: float(values[row]) for path, values in columns.items()} for row in range(plan.samples))


def _ranges(plan: DrawPlan, template: Template) -> dict[str, ValueRange]:
    if not plan.ranges:
        return {path: limits for path, limits in template.ranges.items() if path not in _NOT_DRAWN}
    ranges = {}
    for path, (low, high) in plan.ranges.items():
        limits = template.ranges.get(path)
        if limits is None:
            raise InputError(path, template.template_id, f"a parameter of the template: {', '.join(template.ranges)}")
        if not limits.minimum <= low <= high <= limits.maximum:
            allowed = (
                f"[low, high] within [{limits.minimum:g}, {limits.maximum:g}], the range of {template.template_id}"
            )
            raise InputError(path, f"[{low:g}, {high:g}]", allowed)
        ranges[path] = ValueRange(low, high, limits.integer)
    return ranges


def _scaled(unit: npt.NDArray[np.float64], limits: ValueRange) -> npt.NDArray[np.float64]:
    """Numbers of [0, 1) on a range; whole numbers are all equally likely."""
    if limits.integer:
        low, high = round(limits.minimum), round(limits.maximum)
        return np.floor(low + unit * (high - low + 1)).clip(low, high)
    return limits.minimum + unit * (limits.maximum - limits.minimum)
