"""What is read from a model's text, and what is not."""

import json
import re

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import RiskClass, risk_class
from siren_ros.scoring.evaluation.risk.vlm import reading
from siren_ros.scoring.evaluation.risk.vlm.reading import DEEPEST, class_in, final_class


@pytest.mark.parametrize(
    ("text", "risk"),
    [
        ('{"class": "Near-Miss", "reason": "hard braking"}', RiskClass.NEAR_MISS),
        ('```json\n{"class": "normal"}\n```', RiskClass.NORMAL),
        (
            'It {might} be {"class": "Normal"}, but no: {"reason": "they touch", "class": "Collision"}.',
            RiskClass.COLLISION,
        ),
        ('{"class": "Normal", "more": {"class": "Collision"}}', RiskClass.NORMAL),
    ],
)
def test_the_last_object_with_a_class_counts(text: str, risk: RiskClass) -> None:
    assert class_in(text) is risk


@pytest.mark.parametrize(
    "text",
    [
        "",
        "Normal",
        "The class is Collision.",
        '{"class": "Normal or Near-Miss"}',
        '{"class": 2}',
        '{"class": "Nor',
        "[1]",
    ],
)
def test_nothing_is_guessed(text: str) -> None:
    assert class_in(text) is None


def test_the_more_severe_prediction_is_the_videos() -> None:
    assert final_class([RiskClass.NORMAL, RiskClass.NEAR_MISS]) is RiskClass.NEAR_MISS
    assert final_class([None, RiskClass.NORMAL]) is RiskClass.NORMAL
    assert final_class([None, None]) is None


def class_by_trying(text: str) -> RiskClass | None:
    """The same by trying Python's own reader at each brace: exact, and slow in long texts."""
    found, place = None, text.find("{")
    while place >= 0:
        try:
            content, end = json.JSONDecoder().raw_decode(text, place)
        except ValueError:
            end = place + 1
        else:
            found = content["class"] if isinstance(content.get("class"), str) else found
        place = text.find("{", end)
    try:
        return None if found is None else risk_class(found)
    except InputError:
        return None


PIECES = [
    '"class"',
    '"Normal"',
    '"Collision"',
    *'{}[],: \t\n"\\',
    "1",
    "-0.5e+3",
    "01",
    "null",
    "NaN",
    '"\\u0041"',
    "x",
]
objects = st.recursive(
    st.sampled_from(["Normal", "Near-Miss", 1, None, 'a "quoted" {', float("inf")]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["class", "a", "{"]), inner, max_size=3)
    ),
    max_leaves=8,
).map(json.dumps)


@settings(max_examples=100, deadline=None)
@given(text=st.lists(st.one_of(st.sampled_from(PIECES), objects), max_size=12).map("".join))
@example('{"a" {"class": "Normal"} "}')
@example('{"a": {"class": "Normal"}, b')
@example('{"a": [{"class": "Normal"}, {"class": "Collision"} {')
@example('{x {"a{": {"class": "Normal"}}')
def test_any_text_is_read_as_python_reads_it(text: str) -> None:
    assert class_in(text) is class_by_trying(text)


SIZE = 60_000


@pytest.mark.parametrize(
    "text",
    [
        "{" * SIZE,
        "{ " * (SIZE // 2),
        '{"' * (SIZE // 2),
        '{"a":1,' * (SIZE // 7),
        '{"a":"' * (SIZE // 6),
        '{"a":' * (DEEPEST - 1) + '{"a":[' + "0," * (SIZE // 2),
        ('{"a":' * DEEPEST + "x") * (SIZE // 100),
        '{"class": "Normal", "a": ' + "9" * SIZE + "x",
        '{"class":' * 200_000,
        "{" + " " * SIZE,
    ],
    ids=lambda text: text[:12],
)
def test_each_place_of_a_text_is_looked_at_a_few_times(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    looked_at = 0

    class Counting:
        def match(self, text: str, place: int) -> re.Match[str] | None:
            nonlocal looked_at
            found = token.match(text, place)
            looked_at += 1 if found is None else found.end() - place
            return found

    token = reading.TOKEN
    monkeypatch.setattr(reading, "TOKEN", Counting())
    assert class_in(text) is None
    assert looked_at <= 3 * len(text)


def test_megabytes_without_an_answer() -> None:
    assert class_in("{" * 3_000_000) is None


def test_a_long_text_with_an_answer_is_read() -> None:
    assert class_in("{" * SIZE + '{"class": "Normal", "length": ' + "9" * SIZE + "}") is RiskClass.NORMAL


def test_objects_lie_no_deeper_in_each_other_than_allowed() -> None:
    deepest = '{"a":' * (DEEPEST - 1) + "{}" + "}" * (DEEPEST - 1)
    answer = '{"class": "Normal"}'
    assert class_in(answer + deepest) is RiskClass.NORMAL
    assert class_in(answer + '{"a":' + deepest + "}") is None
