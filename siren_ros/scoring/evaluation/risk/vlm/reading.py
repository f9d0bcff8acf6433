"""Reads a class from a model's text. An unreadable answer is counted, not guessed."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import RiskClass, most_severe, risk_class

DEEPEST: Final = 20
"""Largest nesting of objects and lists; deeper texts are not read. The requested answer is one object."""
_BEGIN: Final = re.compile(r'\{(?=[ \t\n\r]*+["}])')
TOKEN: Final = re.compile(
    r"""[ \t\n\r]*+(?:(?P<sign>[{}\[\],:])
    |(?P<text>"[^"\\\x00-\x1f]*+(?:\\(?:["\\/bfnrt]|u[0-9a-fA-F]{4})[^"\\\x00-\x1f]*+)*+")
    |(?P<value>-?(?:0|[1-9][0-9]*+)(?:\.[0-9]++)?(?:[eE][-+]?[0-9]++)?|true|false|null|NaN|-?Infinity))""",
    re.VERBOSE,
)
"""Matches the next token of a JSON text (RFC 8259, with the three special numbers that Python writes)."""


_STATES: Final[Mapping[tuple[str, str], str]] = {
    **{(state, kind): "open" for state in ("value", "first [") for kind in "{["},
    **{(state, kind): "more" for state in ("value", "first [") for kind in ("text", "value")},
    ("key", "text"): "colon",
    ("first {", "text"): "colon",
    ("first {", "}"): "close",
    ("first [", "]"): "close",
    ("colon", ":"): "value",
    ("more {", ","): "key",
    ("more {", "}"): "close",
    ("more [", ","): "value",
    ("more [", "]"): "close",
}
"""Next state of the parser, by state and token; after a value, the enclosing container decides."""


class _TooDeepError(Exception):
    """Raised for a text that is nested too deeply."""


def class_in(text: str) -> RiskClass | None:
    """Find the class in the last JSON object of a text that has a ``class``; None if there is none or it is unknown.

    A model may think aloud or put the object into a code fence; words outside an object are not read. Takes a time
    proportional to the length of the text, and little memory, whatever the text is.
    """
    title = ""
    try:
        for part in _objects(text):
            # Integers are read as floats, because Python is slow with, and refuses, integers of many digits.
            content = json.loads(part, parse_int=float)
            if isinstance(content.get("class"), str):
                title = content["class"]
        return risk_class(title)
    except (_TooDeepError, InputError):
        return None


def _objects(text: str) -> Iterator[str]:
    """Find the JSON objects of a text that are not inside another object.

    Raises:
        _TooDeepError: One has more than ``DEEPEST`` levels.
    """
    known: dict[int, int | None] = {}
    begins = _BEGIN.search(text)
    while begins is not None:
        begin = begins.start()
        end = known[begin] if begin in known else _end_of_object(text, begin, known)
        if end is not None:
            yield text[begin:end]
        begins = _BEGIN.search(text, end or begin + 1)


def _end_of_object(text: str, begin: int, known: dict[int, int | None]) -> int | None:
    """Find the end of the JSON object that begins at a brace; None if it is not one.

    ``known`` holds the ends of objects inside others that were read before, so that no place is read again and again;
    this call adds to it.

    Raises:
        _TooDeepError: It has more than ``DEEPEST`` levels.
    """
    inside: list[tuple[str, int]] = []
    state, place = "value", begin
    while token := TOKEN.match(text, place):
        kind, place = token.group("sign") or str(token.lastgroup), token.end()
        state = _STATES.get((state, kind), "")
        if not state:
            break
        if state == "open":
            end = known.get(place - 1, place)
            if end is None:
                break
            if end == place:
                inside.append((kind, place - 1))
            state, place = (f"first {kind}" if end == place else "more"), end
            if len(inside) > DEEPEST:
                raise _TooDeepError
        elif state == "close":
            known[inside.pop()[1]] = place
            state = "more"
        if not inside:
            return place
        state += f" {inside[-1][0]}" if state == "more" else ""
    known |= dict.fromkeys(at for _, at in inside)
    return None


def final_class(predictions: Sequence[RiskClass | None]) -> RiskClass | None:
    """Class of a video from its questions' classes: the most severe readable one (paper, max-severity).

    None where none could be read.
    """
    known = [prediction for prediction in predictions if prediction is not None]
    return most_severe(known) if known else None
