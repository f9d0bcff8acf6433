"""Titles of the classes and the max-severity rule."""

import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.risk_class import RiskClass, most_severe, risk_class


@pytest.mark.parametrize("risk", RiskClass)
def test_titles_are_read_back(risk: RiskClass) -> None:
    assert risk_class(risk.title) is risk
    assert risk_class(f" {risk.title.upper()} ") is risk


@pytest.mark.parametrize("written", ["near miss", "NEAR_MISS", "Near-miss", "nearmiss"])
def test_ways_to_write_near_miss(written: str) -> None:
    assert risk_class(written) is RiskClass.NEAR_MISS


@pytest.mark.parametrize("written", ["", "normality", "crash", "Normal or Collision"])
def test_another_word_is_refused(written: str) -> None:
    with pytest.raises(InputError, match="Near-Miss"):
        risk_class(written)


def test_the_more_severe_one_counts() -> None:
    assert most_severe([RiskClass.NORMAL, RiskClass.COLLISION, RiskClass.NEAR_MISS]) is RiskClass.COLLISION
    assert most_severe([RiskClass.NORMAL, RiskClass.NEAR_MISS]) is RiskClass.NEAR_MISS
