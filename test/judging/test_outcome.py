"""The outcome of an episode and its numbers."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, NORTHBOUND, Driven, at_speed, crossing, hand_made

from siren_ros.errors import EpisodeError
from siren_ros.interfaces.lockstep_reports import EpisodeClosing
from siren_ros.judging.outcome import judge, outcome_of
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.actors import Owner
from siren_ros.world.events import Event, EventKind

CLOSING = EpisodeClosing(end="complete", reason="", steps=101)


def test_an_outcome_has_the_verdict_its_parts_and_the_episodes_numbers(record_of: Callable[..., EpisodeRecord]) -> None:
    found = outcome_of(record_of(), CLOSING)
    assert (found.end, found.reason, found.steps, found.predicate_holds) == ("complete", "", 101, True)
    assert found.measures["predicate.lane_changes"] == 4.0
    assert found.measures["predicate.passed"] == 4.0
    assert "4 civilians left" in str(found.measures["predicate"])


def test_way_and_mean_speed_are_those_of_the_first_emv() -> None:
    record = hand_made(
        crossing(),
        {EMV: Driven(NORTHBOUND, at_speed(10.0, 8.0, 101)), 2: Driven(NORTHBOUND, at_speed(60.0, 2.0, 101))},
    )
    for ids, speed in (((EMV, 2), 8.0), ((2, EMV), 2.0)):
        changed = replace(record, description=replace(record.description, emv_ids=ids))
        measures = outcome_of(changed, CLOSING).measures
        assert measures["emv_distance_m"] == pytest.approx(100 * 0.05 * speed)
        assert measures["emv_mean_speed_mps"] == pytest.approx(speed)
        assert measures["actors"] == 2


@pytest.mark.parametrize("ids", [(), (9,)])
def test_without_an_emv_there_is_no_way(ids: tuple[int, ...]) -> None:
    record = hand_made(crossing(), {2: Driven(NORTHBOUND, at_speed(60.0, 2.0, 21))})
    changed = replace(record, description=replace(record.description, emv_ids=ids))
    measures = outcome_of(changed, CLOSING).measures
    assert "emv_distance_m" not in measures
    assert "av.heard_s" not in measures


def test_events_and_residuals_are_counted_each_by_its_kind() -> None:
    record = hand_made(crossing(), {EMV: Driven(NORTHBOUND, at_speed(10.0, 8.0, 101))})
    kinds = [
        *[EventKind.COLLISION] * 1,
        *[EventKind.YIELD_STARTED] * 4,
        *[EventKind.YIELD_COMPLETED] * 3,
        *[EventKind.YIELD_DEFERRED] * 2,
        EventKind.YIELD_REQUESTED,
    ]
    states = tuple(
        replace(state, residual_m=np.array([0.01 * state.step]), owner=np.array([Owner.SUMO], np.uint8))
        for state in record.states
    )
    events = tuple(Event(step, kind, EMV, 2) for step, kind in enumerate(kinds))
    measures = outcome_of(replace(record, states=states, events=events), CLOSING).measures
    names = ("collisions", "yields_started", "yields_completed", "yields_deferred")
    assert [measures[name] for name in names] == [1, 4, 3, 2]
    assert (measures["residual_p99_m"], measures["residual_max_m"]) == pytest.approx((0.99, 1.0))


def test_a_record_that_cannot_be_judged_has_no_verdict_and_says_why() -> None:
    class Broken:
        def build(self) -> EpisodeRecord:
            raise EpisodeError("a state of nobody")

    found = judge(Broken(), replace(CLOSING, end="failed", reason="stopped"))  # type: ignore[arg-type] # as far as needed
    assert (found.end, found.reason, found.steps, found.predicate_holds) == ("failed", "stopped", 101, None)
    assert found.measures == {"predicate": "a state of nobody"}
