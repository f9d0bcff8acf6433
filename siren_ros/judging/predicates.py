"""The predicates: whether a template's interaction happened, evaluated on the record alone."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from siren_ros.errors import BagError
from siren_ros.judging.junction_templates import (
    red_crossing,
    red_same_direction,
    shoulder_turn,
    stop_crossing,
    stop_same_direction,
)
from siren_ros.judging.lane_clearance import lane_cleared
from siren_ros.judging.queue_splitting import queues_split
from siren_ros.judging.verdict import Verdict
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario import scenario as declared
from siren_ros.scenario.templates import load_template

Predicate = Callable[[EpisodeRecord, Mapping[str, float]], Verdict]

_EVALUATED_BY: Final[tuple[tuple[declared.PredicateDeclaration, Predicate], ...]] = (
    (declared.QUEUES_SPLIT, queues_split),
    (declared.LANE_CLEARED, lane_cleared),
    (declared.RED_SAME_DIRECTION, red_same_direction),
    (declared.RED_CROSSING, red_crossing),
    (declared.STOP_SAME_DIRECTION, stop_same_direction),
    (declared.STOP_CROSSING, stop_crossing),
    (declared.SHOULDER_TURN, shoulder_turn),
)
PREDICATES: Final[dict[str, Predicate]] = {declaration.name: predicate for declaration, predicate in _EVALUATED_BY}
"""By the name that a template's file gives."""

PARAMETER: Final = "predicate"
"""Key of ``EpisodeDescription.parameters`` that holds ``{"name": …, "thresholds": {…}}``."""


@dataclass(frozen=True)
class PredicateChoice:
    """The predicate of an episode, with its thresholds."""

    name: str
    thresholds: Mapping[str, float]


def predicate_of(record: EpisodeRecord) -> PredicateChoice:
    """The predicate that the record names; for a record that names none, the one of the episode's template.

    Raises:
        BagError: The record names an unknown predicate, or a threshold is missing or not a number.
        InputError: The record names none, and its template is unknown here.
    """
    stored = record.description.parameters.get(PARAMETER)
    if stored is None:
        demand = load_template(record.description.template).predicate
        return PredicateChoice(demand.name, demand.thresholds)
    name = stored.get("name") if isinstance(stored, Mapping) else None
    thresholds = stored.get("thresholds") if isinstance(stored, Mapping) else None
    numbers = isinstance(thresholds, Mapping) and all(isinstance(item, int | float) for item in thresholds.values())
    if name not in PREDICATES or not isinstance(thresholds, Mapping) or not numbers:
        raise BagError(f"predicate {stored!r}", f"one of {', '.join(PREDICATES)}, with numbers as thresholds")
    for threshold in declared.DECLARED_PREDICATES[str(name)].thresholds:
        if threshold not in thresholds:
            raise BagError(f"predicate {name}", f"a threshold named {threshold}")
    return PredicateChoice(str(name), {str(key): float(value) for key, value in thresholds.items()})


def evaluate_predicate(record: EpisodeRecord) -> Verdict:
    """Whether the interaction of the episode's template happened; raises as ``predicate_of`` does."""
    choice = predicate_of(record)
    return PREDICATES[choice.name](record, choice.thresholds)
