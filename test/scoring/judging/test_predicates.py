"""Predicates, and what their verdicts say."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EASTBOUND, EMV, NORTHBOUND, Driven, at_speed, crossing, hand_made

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.closed_loop import record_of as record_of_loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.scoring.judging.predicates import PREDICATES, evaluate_predicate, predicate_of, verdicts_of_others
from siren_ros.scoring.judging.verdict import (
    Moment,
    at_least,
    at_most,
    closest_of,
    equals,
    first_reaching,
    more_than,
    verdict_of,
)
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.scenario import DECLARED_PREDICATES
from siren_ros.simulation.scenario.templates import available_templates, load_template


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


def several(second: Driven, third: Driven | None = None, **parameters: object) -> EpisodeRecord:
    """The first EMV runs the red light while a civilian crosses; others may be EMVs as well."""
    vehicles = {
        EMV: Driven(NORTHBOUND, at_speed(60.0, 10.0, 200)),
        2: second,
        9: Driven(EASTBOUND, at_speed(60.0, 9.0, 200)),
    }
    if third is not None:
        vehicles[3] = third
    record = hand_made(crossing(), vehicles, signal=lambda _: "r" * 40)
    actors = {key: replace(actor, is_emv=key != 9) for key, actor in record.actors.items()}
    told = {"predicate": {"name": "red_crossing", "thresholds": {}}, **parameters}
    emv_ids = tuple(key for key in actors if key != 9)
    return replace(record, actors=actors, description=replace(record.description, emv_ids=emv_ids, parameters=told))


def test_the_interaction_happens_to_the_first_emv_and_every_other_one_has_a_verdict_of_its_own():
    """The second EMV stops before the line."""
    behind = several(Driven(NORTHBOUND, np.full(200, 40.0)))
    assert evaluate_predicate(behind).holds
    assert {emv_id: verdict.holds for emv_id, verdict in verdicts_of_others(behind).items()} == {2: False}
    swapped = replace(behind, description=replace(behind.description, emv_ids=(2, EMV)))
    assert not evaluate_predicate(swapped).holds
    assert {emv_id: verdict.holds for emv_id, verdict in verdicts_of_others(swapped).items()} == {EMV: True}


@pytest.mark.parametrize(("speed_mps", "passes"), [(20.0, True), (9.0, False), (0.0, False)])
def test_an_emv_that_crosses_has_to_pass_its_junction(speed_mps, passes):
    """At 9 m/s it is still inside at the end of the 10 s."""
    across = {"crossing": {"junction": "J", "emv_ids": [2]}}
    record = several(Driven(EASTBOUND, at_speed(20.0, speed_mps, 200)), **across)
    verdict = evaluate_predicate(record)
    assert verdict.holds is passes
    assert [part.name for part in verdict.parts] == ["against_red", "crossing_inside", "crossing_emv_2"]
    assert f"EMV 2 {'passed' if passes else 'did not pass'} junction J" in verdict.text
    (other,) = verdicts_of_others(record).values()
    assert (other.holds, len(other.parts)) == (passes, 1)
    assert [moment.actor_id for moment in other.parts[0].moments] == [2] * passes
    elsewhere = several(Driven(EASTBOUND, at_speed(20.0, 10.0, 200)), crossing={"junction": "K", "emv_ids": [2]})
    assert not evaluate_predicate(elsewhere).holds


def test_with_one_emv_there_are_no_others(record_of):
    assert verdicts_of_others(record_of(duration_s=1.0)) == {}


@pytest.mark.parametrize(
    ("make", "holds", "relation"),
    [
        (at_least, (False, True, True), ">="),
        (more_than, (False, False, True), ">"),
        (at_most, (True, True, False), "<="),
        (equals, (False, True, False), "="),
    ],
)
def test_conditions_hold_on_their_side_of_the_threshold(make, holds, relation):
    parts = [make("way_m", value, 2.5) for value in (2.4, 2.5, 2.6)]
    assert tuple(part.holds for part in parts) == holds
    assert {part.relation for part in parts} == {relation}
    assert not make("way_m", float("nan"), 2.5).holds


def test_a_condition_is_one_line_with_its_detail_behind_it():
    assert str(at_least("way_m", 3.14159, 2.0)) == "way_m: 3.142 (needs >= 2)"
    assert str(at_most("way_m", 7.0, 2.0, "actor 3 at step 9")) == "way_m: 7 (needs <= 2), actor 3 at step 9"


def test_a_verdict_holds_where_all_of_its_parts_do():
    good, bad = at_least("a", 3.0, 1.0), at_least("b", 0.5, 1.0)
    assert verdict_of((good,), "text").holds
    verdict = verdict_of((good, bad), "text")
    assert (verdict.holds, verdict.failing, verdict.text) == (False, (bad,), "text")
    assert verdict.measures() == {"a": 3.0, "b": 0.5}


def test_the_closest_verdict_has_the_most_parts_and_then_the_largest_values():
    whole, none, first, second = (
        verdict_of(tuple(at_least(f"part{number}", value, 1.0) for number, value in enumerate(values)), "")
        for values in ((1, 1), (0, 0), (1, 0), (0, 9))
    )
    assert closest_of([none, second, whole, first]) is whole
    assert closest_of([none, second, first]) is first
    assert closest_of([]) is None


MOMENTS = tuple(Moment(10 * number, number) for number in (1, 2, 3))


@pytest.mark.parametrize(
    ("make", "threshold", "step"),
    [
        (at_least, 2, 20),
        (at_least, 1.5, 20),
        (at_least, 3, 30),
        (at_least, 4, 30),
        (at_least, 0, 10),
        (more_than, 1.2, 20),
        (equals, 0, 10),
        (at_most, 0, 10),
        (at_most, 1, 20),
        (at_most, np.inf, 30),
    ],
)
def test_the_decisive_moment_fulfils_or_breaks_a_count(make, threshold, step):
    assert make("n", 3, threshold, "", *MOMENTS).decisive.step == step


def test_a_single_moment_decides_and_without_one_nothing_does():
    assert at_least("way_m", 120.0, 100.0, "", MOMENTS[1]).decisive is MOMENTS[1]
    assert at_most("overlap_m", 0.4, 0.3).decisive is None


def test_a_moment_names_actor_and_time():
    assert str(Moment(25, 7)) == "7 at 1.2 s"
    assert str(Moment(26, 7, "0.40 m")) == "7 at 1.3 s (0.40 m)"


def test_a_threshold_is_reached_at_the_first_step_with_its_value():
    steps = np.array([4, 5, 6, 7])
    assert first_reaching(steps, 3, [0.0, 1.0, 0.5, 2.0], 1.0) == (Moment(5, 3),)
    assert first_reaching(steps, 3, [0.0, 1.0, 0.5, 2.0], 2.1) == ()
