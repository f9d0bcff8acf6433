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
