"""Verdicts as stored results have them: a line for each part."""

from collections.abc import Iterable
from typing import Any

from siren_ros.scoring.judging.verdict import Part, Verdict


def told(verdict: Verdict) -> dict[str, Any]:
    """The text, whether it holds, and the parts."""
    return {"holds": verdict.holds, "text": verdict.text, "parts": parts_told(verdict.parts)}


def parts_told(parts: Iterable[Part]) -> dict[str, list[Any]]:
    """By name: value, relation, threshold, whether it holds, the detail; step, actor and note of each moment."""
    return {
        part.name: [
            *(part.value, part.relation, part.threshold, part.holds, part.detail),
            *((moment.step, moment.actor_id, moment.note) for moment in part.moments),
        ]
        for part in parts
    }


def briefly(verdict: Verdict) -> list[list[Any]]:
    """Of each part its value, whether it holds, and the steps of its first and its last moment."""
    ends = [(part, [moment.step for moment in part.moments]) for part in verdict.parts]
    return [[part.value, part.holds, *steps[:1], *steps[1:][-1:]] for part, steps in ends]


def told_first(verdicts: dict[str, Verdict]) -> dict[str, Any]:
    """The first of several verdicts as it is, the others briefly."""
    first, *others = verdicts
    return {first: told(verdicts[first]), **{name: briefly(verdicts[name]) for name in others}}
