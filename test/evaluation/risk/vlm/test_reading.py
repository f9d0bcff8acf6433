"""What is read from a model's text, and what is not."""

import pytest

from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.evaluation.risk.vlm.reading import class_in, final_class


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
