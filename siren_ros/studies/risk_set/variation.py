"""Draws of scenario parameters that make one class of risk more likely than others."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.numerics.random_streams import random_stream
from siren_ros.scenario.request import EpisodeRequest, text_of_values
from siren_ros.scenario.templates import Template


@dataclass(frozen=True)
class Leaning:
    """Where in a parameter's range values are drawn: shares of the range, from and to."""

    presets: tuple[str, ...]
    shares: Mapping[str, tuple[float, float]]


_RISKY: Final[Mapping[str, tuple[float, float]]] = {
    "emv.speed_mps": (0.5, 1.0),
    "demand.speed_factor": (0.5, 1.0),
    "demand.background_vehicles": (0.5, 1.0),
    "response.response_distance_m": (0.0, 0.5),
    "response.extra_delay_s": (0.5, 1.0),
    "response.compliance": (0.0, 0.5),
}
"""Faster, denser, later, and fewer who comply."""

LEANINGS: Final[Mapping[RiskClass, Leaning]] = {
    RiskClass.NORMAL: Leaning(("paper", "realistic"), {}),
    RiskClass.NEAR_MISS: Leaning(("realistic", "inattentive"), {**_RISKY, "emv.speed_mps": (0.3, 1.0)}),
    RiskClass.COLLISION: Leaning(("reckless",), _RISKY),
}
"""What a search for each class draws from. The label alone decides what an episode is."""


def candidate_request(
    template: Template, name: str, looking_for: RiskClass, seed: int, number: int, map_file: str
) -> EpisodeRequest:
    """The request of one candidate: drawn from the search's seed, the template and its number alone.

    Args:
        template: Its ranges are drawn from.
        name: The user's name for it.
        looking_for: The class that the search lacks most.
        seed: Of the search.
        number: Of the candidate.
        map_file: The map; empty for the town.
    """
    rng = random_stream(seed, f"risk_set/{template.template_id}", number)
    leaning = LEANINGS[looking_for]
    preset = leaning.presets[int(rng.integers(len(leaning.presets)))]
    values = {}
    for path, (low, high) in sorted(leaning.shares.items()):
        limits = template.ranges.get(path)
        if limits is None:
            continue
        value = limits.minimum + float(rng.uniform(low, high)) * (limits.maximum - limits.minimum)
        values[path] = float(np.round(value)) if limits.integer else round(value, 3)
    return EpisodeRequest(
        template=name,
        seed=int(rng.integers(2**31 - 1)),
        map=map_file,
        preset=preset,
        sensors="none",
        values=text_of_values(values),
    )
