from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.generation.closed_loop import closed_loop
from siren_ros.generation.closed_loop import record_of as record_of_loop
from siren_ros.generation.episode_setup import set_up_episode
from siren_ros.judging.predicates import PREDICATES, evaluate_predicate, predicate_of
from siren_ros.judging.verdict import Part, at_least, at_most, closest_of, equals, more_than, verdict_of
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.scenario.scenario import DECLARED_PREDICATES
from siren_ros.scenario.templates import available_templates, load_template


def test_templates_may_name_exactly_the_predicates_that_exist() -> None:
    assert set(PREDICATES) == set(DECLARED_PREDICATES)


@pytest.mark.parametrize("name", sorted(PREDICATES))
def test_the_declared_thresholds_are_all_that_a_predicate_needs(
    name: str, record_of: Callable[..., EpisodeRecord]
) -> None:
    thresholds = {key: low for key, (low, _) in DECLARED_PREDICATES[name].thresholds.items()}
    parameters = {"predicate": {"name": name, "thresholds": thresholds}}
    record = record_of(duration_s=1.0)
    verdict = evaluate_predicate(replace(record, description=replace(record.description, parameters=parameters)))
    assert not verdict.holds
    assert verdict.text


@pytest.mark.parametrize("template", available_templates())
def test_every_templates_predicate_can_be_evaluated_on_its_episode(template: str) -> None:
    setup = set_up_episode(EpisodeRequest(template=template, sensors="none"))
    record = record_of_loop(setup, list(closed_loop(setup, 60)))
    choice = predicate_of(record)
    assert choice.name == load_template(template).predicate.name
    verdict = evaluate_predicate(record)
    assert verdict.text
    assert all(np.isfinite(part.value) for part in verdict.parts)
    own = {*choice.thresholds.values()}
    named = {part.threshold for part in verdict.parts}
    assert own - named <= {choice.thresholds.get("lateral_max_m")}


def test_more_than_is_strict() -> None:
    assert [more_than("a", value, 2.0).holds for value in (1.9, 2.0, 2.1)] == [False, False, True]


def test_the_closest_verdict_has_the_most_parts_and_then_the_largest_values() -> None:
    def of(*values: float) -> object:
        return verdict_of(tuple(at_least(f"part{number}", value, 1.0) for number, value in enumerate(values)), "")

    whole, none, first, second = of(1, 1), of(0, 0), of(1, 0), of(0, 9)
    assert closest_of([none, second, whole, first]) is whole  # type: ignore[list-item] # verdicts
    assert closest_of([none, second, first]) is first  # type: ignore[list-item] # verdicts
    assert closest_of([]) is None


@pytest.mark.parametrize(
    ("condition", "below", "equal", "above"),
    [
        (at_least, False, True, True),
        (more_than, False, False, True),
        (at_most, True, True, False),
        (equals, False, True, False),
    ],
)
def test_conditions_below_at_and_above_their_threshold(
    condition: Callable[..., Part], below: bool, equal: bool, above: bool
) -> None:
    assert [condition("x", value, 2.0).holds for value in (1.9, 2.0, 2.1)] == [below, equal, above]
    assert not condition("x", float("nan"), 2.0).holds
