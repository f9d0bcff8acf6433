from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EASTBOUND, EMV, NORTHBOUND, Driven, at_speed, crossing, hand_made

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.closed_loop import record_of as record_of_loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.scoring.judging.predicates import PREDICATES, evaluate_predicate, predicate_of, verdicts_of_others
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
