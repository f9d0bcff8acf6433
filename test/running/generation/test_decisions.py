"""Decisions made again: they are those of the record, to the last bit, and say what limited whom."""

import math
from dataclasses import replace
from typing import Any

import pytest

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EpisodeError
from siren_ros.running.generation.closed_loop import closed_loop, record_of
from siren_ros.running.generation.decisions import Decision, decisions_of
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.actors import Mode
from siren_ros.simulation.world.traffic_state import EventKind

STEPS = 500


@pytest.fixture(scope="module", params=[("S2", "L2"), ("S1", "L3")], ids=["L2", "L3"])
def record(request: Any) -> EpisodeRecord:
    template, level = request.param
    setup = set_up_episode(EpisodeRequest(template, level=level, sensors="none"))
    return record_of(setup, list(closed_loop(setup, STEPS)))


def acting(decision: Decision) -> dict[str, bool]:
    return {guard.name: guard.acts for guard in decision.guards}


def test_each_driven_actor_has_a_decision_at_each_step(record: EpisodeRecord) -> None:
    steps = dict(decisions_of(record))
    assert list(steps) == [traffic.step for traffic in record.traffic]
    for commands in (commands for rows in record.commands.values() for commands in rows):
        for actor_id, mode, owner in zip(commands.actor_id.tolist(), commands.mode, commands.owner, strict=True):
            decision = steps[commands.step][actor_id]
            assert decision.mode == mode
            assert math.isnan(decision.target_mps) == (owner == 0 or not decision.limits)
            assert all(guard.why for guard in decision.guards)


def test_the_pedals_follow_the_strictest_limit(record: EpisodeRecord) -> None:
    """No throttle well above the lowest limit, no brake well below it where nobody must brake."""
    emv_id, below, above = record.emv_ids[0], 0, 0
    commands = record.commands["emv_controller"]
    for (_, decided), command, traffic in zip(decisions_of(record), commands, record.traffic, strict=True):
        strictest = min(decided[emv_id].limits.values())
        free_mps = strictest.speed_mps - float(traffic.speed_mps[traffic.actor_id == emv_id][0])
        if free_mps < -1.0:
            assert command.throttle[0] == 0.0
            above += 1
        elif free_mps > 1.0 and not any(limit.brake_mps2 for limit in decided[emv_id].limits.values()):
            assert command.brake[0] == 0.0
            below += 1
    assert min(above, below) > 5


def test_guards_act_with_the_mode_and_the_events(record: EpisodeRecord) -> None:
    emv_id, seen = record.emv_ids[0], set()
    deferred = {(event.step, event.actor_id) for event in record.events_of(EventKind.YIELD_DEFERRED)}
    for step, decided in decisions_of(record):
        for actor_id, decision in decided.items():
            acts = acting(decision)
            if actor_id == emv_id:
                assert acts["gap escape"] == (decision.mode is Mode.GAP_ESCAPE)
                assert acts["rescue corridor"] == (decision.mode is Mode.COPY_SUMO) or acts["gap escape"]
            else:
                assert acts["rejoins"] == (decision.mode is Mode.REJOIN)
                if (step, actor_id) in deferred:
                    assert any(guard.why.startswith("deferred: ") for guard in decision.guards)
            seen.add(decision.mode)
    assert len(seen) >= 4


def test_another_decision_than_the_recorded_one_is_told(record: EpisodeRecord) -> None:
    source = "emv_controller"
    rows = list(record.commands[source])
    rows[50] = replace(rows[50], throttle=rows[50].throttle + 1e-12)
    other = replace(record, commands={**record.commands, source: tuple(rows)})
    with pytest.raises(EpisodeError, match="at step 50: throttle"):
        list(decisions_of(other))
