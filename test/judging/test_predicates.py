from dataclasses import replace

import numpy as np
import pytest

from siren_ros.generation.closed_loop import closed_loop
from siren_ros.generation.closed_loop import record_of as record_of_loop
from siren_ros.generation.episode_setup import set_up_episode
from siren_ros.judging.predicates import PREDICATES, evaluate_predicate, predicate_of
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.scenario.scenario import DECLARED_PREDICATES
from siren_ros.scenario.templates import available_templates, load_template


def test_templates_may_name_exactly_the_predicates_that_exist():
    assert set(PREDICATES) == set(DECLARED_PREDICATES)


@pytest.mark.parametrize("name", sorted(PREDICATES))
def test_the_declared_thresholds_are_all_that_a_predicate_needs(name, record_of):
    thresholds = {key: low for key, (low, _) in DECLARED_PREDICATES[name].thresholds.items()}
    parameters = {"predicate": {"name": name, "thresholds": thresholds}}
    record = record_of(duration_s=1.0)
    verdict = evaluate_predicate(replace(record, description=replace(record.description, parameters=parameters)))
    assert not verdict.holds
    assert verdict.text


@pytest.mark.parametrize("template", available_templates())
def test_every_templates_predicate_can_be_evaluated_on_its_episode(template):
    setup = set_up_episode(EpisodeRequest(template=template, sensors="none"))
    record = record_of_loop(setup, list(closed_loop(setup, 60)))
    name, thresholds = predicate_of(record)
    assert name == load_template(template).predicate.name
    verdict = evaluate_predicate(record)
    assert verdict.text
    assert all(np.isfinite(part.value) for part in verdict.parts)
    elsewhere = {thresholds.get(name) for name in ("lateral_max_m", "ahead_m", "side_m")}
    assert {*thresholds.values()} - {part.threshold for part in verdict.parts} <= elsewhere
