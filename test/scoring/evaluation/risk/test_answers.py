"""Files of answers: what is read, and what is refused with its first offender."""

from pathlib import Path

import pytest

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import RiskClass
from siren_ros.scoring.evaluation.risk.scoring import checked_answers, read_answers

BOTH = [
    ("a.json", '{"S1_000": "Normal", "S1_001": "near-miss", "S1_002": "unreadable"}'),
    ("a.csv", "class,video\nNormal,S1_000\nNear-Miss,S1_001\nunreadable,S1_002\n"),
]


@pytest.mark.parametrize(("name", "text"), BOTH)
def test_both_formats(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    assert read_answers(path) == {"S1_000": RiskClass.NORMAL, "S1_001": RiskClass.NEAR_MISS, "S1_002": None}


@pytest.mark.parametrize(
    ("name", "text", "named"),
    [
        ("a.json", '{"S1_000": "Crash"}', "Crash"),
        ("a.json", '{"S1_000": "Normal", "S1_000": "Normal"}', "S1_000"),
        ("a.json", '["Normal"]', "video and class"),
        ("a.json", '{"S1_000": 1}', "video and class"),
        ("a.json", "{", "video and class"),
        ("a.json", '{"S1_000": [1]}', "video and class"),
        ("a.csv", f"video,class\n{'x' * 200_000},Normal\n", "field limit"),
        ("a.csv", "id,label\nS1_000,Normal\n", "columns"),
        ("a.csv", "video,class\nS1_000\n", "S1_000"),
    ],
)
def test_what_is_refused(tmp_path: Path, name: str, text: str, named: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=named):
        read_answers(path)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_answers(tmp_path / "none.json")


def test_answers_belong_to_the_set() -> None:
    answers = {"b": RiskClass.NORMAL}
    assert checked_answers(answers, ["b"], allow_missing=False) == answers
    with pytest.raises(InputError, match="2 unknown videos, first c"):
        checked_answers({**answers, "d": None, "c": None}, ["b"], allow_missing=True)
    with pytest.raises(InputError, match="2 videos without an answer, first a"):
        checked_answers(answers, ["c", "b", "a"], allow_missing=False)
    assert checked_answers(answers, ["c", "b", "a"], allow_missing=True) == answers
