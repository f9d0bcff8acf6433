import dataclasses

import numpy as np
import pytest

from siren_ros.world.actors import ACTOR_STATE_DTYPES, ActorStates
from siren_ros.world.state_hash import hash_state
from siren_ros.world.traffic_state import SignalState

EMPTY = 0x282047AD06AEB62B
ONLY_SIGNALS = 0xF3E5E194E2548679
"""BLAKE2b by the definition, computed once."""
SIGNALS = (SignalState("west", "GGrr"), SignalState("east", "rrGG"))


@pytest.fixture
def states() -> ActorStates:
    rng = np.random.default_rng(1)
    columns = {name: (rng.random(3) * 100.0).astype(kind) for name, kind in ACTOR_STATE_DTYPES.items()}
    return ActorStates(step=7, **columns)


def test_the_hash_is_a_number_of_64_bits_that_never_changes() -> None:
    assert hash_state(ActorStates.empty(), ()) == EMPTY
    assert hash_state(ActorStates.empty(), SIGNALS) == ONLY_SIGNALS


def test_equal_states_have_equal_hashes(states: ActorStates) -> None:
    copy = states.select(np.ones(3, dtype=bool))
    assert hash_state(copy, SIGNALS) == hash_state(states, SIGNALS) < 2**64


@pytest.mark.parametrize("name", sorted(ACTOR_STATE_DTYPES))
def test_the_last_bit_of_every_field_counts(states: ActorStates, name: str) -> None:
    column = getattr(states, name).copy()
    column.view(np.uint8)[0] ^= 1
    assert hash_state(dataclasses.replace(states, **{name: column}), SIGNALS) != hash_state(states, SIGNALS)


def test_step_signals_and_their_order_count(states: ActorStates) -> None:
    others = [
        hash_state(dataclasses.replace(states, step=8), SIGNALS),
        hash_state(states, SIGNALS[::-1]),
        hash_state(states, SIGNALS[:1]),
        hash_state(states, (SIGNALS[0], SignalState("east", "rrGy"))),
        hash_state(states.select(np.array([True, True, False])), SIGNALS),
    ]
    assert len({hash_state(states, SIGNALS), *others}) == 6


def test_the_byte_order_of_the_machine_does_not_count(states: ActorStates) -> None:
    swapped = dataclasses.replace(states, x_m=states.x_m.astype(">f8"))
    assert hash_state(swapped, SIGNALS) == hash_state(states, SIGNALS)
