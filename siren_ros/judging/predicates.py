"""The predicates: whether a template's interaction happened, evaluated on the record alone."""

from collections.abc import Callable, Mapping
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
from siren_ros.judging.rescue_lane import rescue_lane
from siren_ros.judging.verdict import Verdict
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario import scenario as declared
from siren_ros.scenario.templates import load_template

Predicate = Callable[[EpisodeRecord, Mapping[str, float]], Verdict]

PREDICATES: Final[dict[str, Predicate]] = {
    declared.QUEUES_SPLIT.name: queues_split,
    declared.LANE_CLEARED.name: lane_cleared,
    declared.RED_SAME_DIRECTION.name: red_same_direction,
    declared.RED_CROSSING.name: red_crossing,
    declared.STOP_SAME_DIRECTION.name: stop_same_direction,
    declared.STOP_CROSSING.name: stop_crossing,
    declared.SHOULDER_TURN.name: shoulder_turn,
    declared.RESCUE_LANE.name: rescue_lane,
}
"""By the name that a template's file gives."""
PARAMETER: Final = "predicate"
"""Key of ``EpisodeDescription.parameters`` that holds ``{"name": …, "thresholds": {…}}``."""


def predicate_of(record: EpisodeRecord) -> tuple[str, Mapping[str, float]]:
    """Name and thresholds of the record's predicate; where the record has none, those of the episode's template.

    Raises:
        BagError: The record names an unknown predicate, or a threshold is missing or not a number.
        InputError: The record names none, and its template is unknown here.
    """
    stored = record.description.parameters.get(PARAMETER)
    if stored is None:
        predicate = load_template(record.description.template).predicate
        return predicate.name, predicate.thresholds
    name = stored.get("name") if isinstance(stored, Mapping) else None
    thresholds = stored.get("thresholds") if isinstance(stored, Mapping) else None
    numbers = isinstance(thresholds, Mapping) and all(isinstance(value, int | float) for value in thresholds.values())
    if name not in PREDICATES or not isinstance(thresholds, Mapping) or not numbers:
        raise BagError(f"predicate {stored!r}", f"one of {', '.join(PREDICATES)}, with numbers as thresholds")
    for threshold in declared.DECLARED_PREDICATES[str(name)].thresholds:
        if threshold not in thresholds:
            raise BagError(f"predicate {name}", f"a threshold named {threshold}")
    return str(name), {str(key): float(value) for key, value in thresholds.items()}


def evaluate_predicate(record: EpisodeRecord) -> Verdict:
    """Whether the interaction of the episode's template happened; raises as ``predicate_of`` does."""
    name, thresholds = predicate_of(record)
    return PREDICATES[name](record, thresholds)
