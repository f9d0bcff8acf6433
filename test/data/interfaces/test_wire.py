"""A node gets the very content that another node of its process sent; what comes from elsewhere is decoded."""

import numpy as np

from siren_ros.data.interfaces import wire
from siren_ros.data.interfaces.conversions import from_actor_states, to_actor_states
from siren_ros.data.interfaces.episode_conversions import Phase, StepReport, from_step_done, to_step_done
from siren_ros.data.interfaces.topics import ACTORS, STEP_DONE
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorStates


def states_at(step: int) -> ActorStates:
    return ActorStates(step, **{name: np.ones(2, dtype) for name, dtype in ACTOR_STATE_DTYPES.items()})


def test_what_was_sent_is_read_without_a_conversion():
    states = states_at(3)
    cdr = wire.encode_content(ACTORS, 3, states, to_actor_states)
    assert cdr == wire.encode(ACTORS, to_actor_states(states))
    message = wire.decode(ACTORS, bytes(bytearray(cdr)))  # as it comes from the middleware
    assert wire.step_of_message(ACTORS, message) == 3
    assert wire.content(from_actor_states, message) is states


def test_what_others_send_is_decoded():
    wire.encode_content(ACTORS, 4, states_at(4), to_actor_states)
    message = wire.decode(ACTORS, wire.encode(ACTORS, to_actor_states(states_at(5))))
    assert wire.step_of_message(ACTORS, message) == 5
    read = wire.content(from_actor_states, message)
    assert read is wire.content(from_actor_states, message)
    assert (read.step, read.x_m.tolist()) == (5, [1.0, 1.0])


def test_reports_of_all_nodes_are_known_together_and_old_ones_are_forgotten():
    reports = [StepReport(7, f"node_{number}", Phase.STEP) for number in range(wire.KEPT + 1)]
    sent = [wire.encode_content(STEP_DONE, 7, report, to_step_done) for report in reports]
    read = [wire.content(from_step_done, wire.decode(STEP_DONE, cdr)) for cdr in sent]
    assert read == reports
    assert [value is report for value, report in zip(read, reports, strict=True)] == [False] + [True] * wire.KEPT
