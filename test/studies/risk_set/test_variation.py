"""Candidates are drawn from the seed, the template and their number alone, within the template's ranges."""

import pytest

from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.scenario.request import EpisodeRequest, values_of
from siren_ros.scenario.templates import available_templates, load_template
from siren_ros.studies.risk_set.variation import LEANINGS, candidate_request


def drawn(template: str, risk: RiskClass, number: int, seed: int = 0) -> EpisodeRequest:
    return candidate_request(load_template(template), template, risk, seed, number, "")


@pytest.mark.parametrize("template", available_templates())
@pytest.mark.parametrize("risk", RiskClass)
def test_values_lie_where_the_class_leans_to(template: str, risk: RiskClass) -> None:
    loaded = load_template(template)
    for number in range(20):
        request = drawn(template, risk, number)
        assert request.preset in LEANINGS[risk].presets
        values = values_of(request.values)
        loaded.with_values(values)
        assert set(values) == set(loaded.ranges) & set(LEANINGS[risk].shares)
        for path, value in values.items():
            limits, (low, high) = loaded.ranges[path], LEANINGS[risk].shares[path]
            width = limits.maximum - limits.minimum
            slack = 0.5 if limits.integer else 1e-3
            assert limits.minimum + low * width - slack <= value <= limits.minimum + high * width + slack


def test_the_same_candidate_is_the_same_request() -> None:
    assert drawn("S4", RiskClass.NEAR_MISS, 7) == drawn("S4", RiskClass.NEAR_MISS, 7)
    seeds = {drawn("S4", RiskClass.NEAR_MISS, number, seed).seed for number in range(30) for seed in range(3)}
    assert len(seeds) == 90
    assert drawn("S4", RiskClass.NEAR_MISS, 7).seed != drawn("S6", RiskClass.NEAR_MISS, 7).seed


def test_normal_episodes_keep_the_templates_own_draws() -> None:
    assert drawn("S2", RiskClass.NORMAL, 3).values == ""
