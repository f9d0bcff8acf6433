"""Reads a class from a model's text. What cannot be read is counted and never guessed."""

import json
from collections.abc import Sequence

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.risk_class import RiskClass, most_severe, risk_class


def class_in(text: str) -> RiskClass | None:
    """The class in the last JSON object of a text that has a ``class``; None where there is none or it is unknown.

    A model may think aloud or put the object into a code fence; words outside an object are not read.
    """
    decoder = json.JSONDecoder()
    found: str | None = None
    place = text.find("{")
    while place >= 0:
        try:
            content, end = decoder.raw_decode(text, place)
        except ValueError:
            end = place + 1
        else:
            if isinstance(content, dict) and isinstance(content.get("class"), str):
                found = content["class"]
        place = text.find("{", end)
    if found is None:
        return None
    try:
        return risk_class(found)
    except InputError:
        return None


def final_class(predictions: Sequence[RiskClass | None]) -> RiskClass | None:
    """The class of a video from those of its questions: the most severe one that could be read (paper, max-severity).

    None where none could be read.
    """
    known = [prediction for prediction in predictions if prediction is not None]
    return most_severe(known) if known else None
