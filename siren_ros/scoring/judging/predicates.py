"""The predicates: they decide from the record alone whether a template's interaction happened."""

from collections.abc import Callable, Mapping
from typing import Final

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import BagError
from siren_ros.scoring.judging.junction_templates import (
    red_crossing,
    red_same_direction,
    shoulder_turn,
    stop_crossing,
    stop_same_direction,
)
from siren_ros.scoring.judging.junction_traversal import find_traversals
from siren_ros.scoring.judging.lane_clearance import lane_cleared
from siren_ros.scoring.judging.queue_splitting import queues_split
from siren_ros.scoring.judging.rescue_lane import rescue_lane
from siren_ros.scoring.judging.verdict import Moment, Verdict, at_least, verdict_of, with_sides_exchanged
from siren_ros.simulation.scenario import scenario as declared
from siren_ros.simulation.scenario.templates import load_template

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
"""Predicates by the name in a template's file."""
PARAMETER: Final = "predicate"
"""Key of ``EpisodeDescription.parameters`` that holds ``{"name": …, "thresholds": {…}}``."""


def predicate_of(record: EpisodeRecord) -> tuple[str, Mapping[str, float]]:
    """Name and thresholds of the record's predicate, or else those of the episode's template.

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
    """Decide whether the interaction of the episode's template happened; raises as ``predicate_of``.

    It has to happen to the first EMV. Those that cross its way have to pass the junction at which they do. Where
    traffic keeps left, the mirror image is judged, and the verdict's words are mirrored again.
    """
    name, thresholds = predicate_of(record)
    verdict = _judged(record, name, thresholds)
    crossing = [_crossing(record, emv_id) for emv_id in record.description.crossed_junctions]
    if not crossing:
        return verdict
    parts = (*verdict.parts, *(part for other in crossing for part in other.parts))
    return verdict_of(parts, "; ".join((verdict.text, *(other.text for other in crossing))))


def verdicts_of_others(record: EpisodeRecord) -> dict[int, Verdict]:
    """Verdict for each EMV except the first, by its id.

    Of one that crosses the first one's way it is whether it passed the junction, of others the template's interaction.
    """
    name, thresholds = predicate_of(record)
    crossed = record.description.crossed_junctions
    return {
        emv_id: _crossing(seen, emv_id) if emv_id in crossed else _judged(seen, name, thresholds)
        for emv_id, seen in list(zip(record.emv_ids, record.by_emv(), strict=True))[1:]
    }


def _judged(record: EpisodeRecord, name: str, thresholds: Mapping[str, float]) -> Verdict:
    verdict = PREDICATES[name](record.right_hand, thresholds)
    return with_sides_exchanged(verdict) if record.network.left_hand else verdict


def _crossing(record: EpisodeRecord, emv_id: int) -> Verdict:
    """Verdict whether an EMV has passed, and left, the junction at which it crosses the first one's path."""
    junction, last = record.description.crossed_junctions[emv_id], record.states[-1].step if record.states else 0
    passed = [
        one
        for one in find_traversals(record)
        if one.actor_id == emv_id and record.network.connections[one.connection].junction == junction
        if one.leave_step <= last
    ]
    when = ", ".join(f"from {one.enter_step * STEP_S:.1f} s to {one.leave_step * STEP_S:.1f} s" for one in passed)
    out = [Moment(one.leave_step, emv_id) for one in passed]
    part = at_least(f"crossing_emv_{emv_id}", len(out), 1, when, *out)
    return verdict_of((part,), f"EMV {emv_id} {'passed' if passed else 'did not pass'} junction {junction}")
