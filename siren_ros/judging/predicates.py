"""The predicates that tell whether a template's interaction happened, evaluated on the record alone."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from siren_ros.errors import BagError
from siren_ros.judging.junction_entry import (
    red_crossing,
    red_same_direction,
    stop_crossing,
    stop_same_direction,
)
from siren_ros.judging.lane_clearance import lane_cleared
from siren_ros.judging.queue_splitting import queues_split
from siren_ros.judging.shoulder_turn import shoulder_turn
from siren_ros.judging.verdict import Verdict
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.templates import load_template

Predicate = Callable[[EpisodeRecord, Mapping[str, float]], Verdict]

PREDICATES: Final[dict[str, Predicate]] = {
    "queues_split": queues_split,
    "lane_cleared": lane_cleared,
    "red_same_direction": red_same_direction,
    "red_crossing": red_crossing,
    "stop_same_direction": stop_same_direction,
    "stop_crossing": stop_crossing,
    "shoulder_turn": shoulder_turn,
}
"""By the name that a template's file gives."""

PARAMETER: Final = "predicate"
"""Key of ``EpisodeDescription.parameters`` that holds ``{"name": …, "thresholds": {…}}``."""


@dataclass(frozen=True)
class PredicateChoice:
    """Which predicate an episode is held against."""

    name: str
    thresholds: Mapping[str, float]


def predicate_of(record: EpisodeRecord) -> PredicateChoice:
    """The predicate that the record names; for records that name none, that of the episode's template.

    Raises:
        BagError: The record names a predicate that is not known, or its thresholds are not numbers.
        InputError: The record names none, and its template is not known here.
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
    return PredicateChoice(str(name), {str(key): float(value) for key, value in thresholds.items()})


def evaluate_predicate(record: EpisodeRecord) -> Verdict:
    """Whether the interaction of the episode's template happened; raises as ``predicate_of`` does."""
    choice = predicate_of(record)
    try:
        return PREDICATES[choice.name](record, choice.thresholds)
    except KeyError as error:
        raise BagError(f"predicate {choice.name}", f"a threshold named {error.args[0]}") from error
