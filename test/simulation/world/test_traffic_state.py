"""Routes of one list for all vehicles, and the types of the columns."""

import dataclasses

import numpy as np
import pytest

from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorStates
from siren_ros.simulation.world.traffic_state import (
    TRAFFIC_STATE_DTYPES,
    SignalState,
    TrafficFlags,
    TrafficState,
    hash_state,
)


def test_each_row_has_its_own_part_of_the_routes():
    columns = {name: np.zeros(3, dtype) for name, dtype in TRAFFIC_STATE_DTYPES.items()}
    columns |= {"route_offset": np.array([0, 2, 2, 5], np.int32), "route_edges": np.arange(10, 15, dtype=np.int32)}
    state = TrafficState(step=0, spawned=(), emvs=(), signals=(), **columns)
    assert [state.route_of_row(row).tolist() for row in range(3)] == [[10, 11], [], [12, 13, 14]]
    assert len(state) == 3


def test_columns_have_the_types_of_the_message():
    by_type = {}
    for name, dtype in TRAFFIC_STATE_DTYPES.items():
        by_type.setdefault(dtype, set()).add(name)
    assert by_type[np.uint32] == {"removed", "actor_id"}
    assert by_type[np.uint8] == {"owner", "lights", "flags"}
    assert by_type[np.int32] == {"lane", "route_offset", "route_edges"}
    assert {"sumo_x_m", "speed_mps", "lane_position_m", "lateral_offset_m"} <= by_type[np.float64]
    assert [int(flag) for flag in TrafficFlags] == [1, 2, 4, 8]


EMPTY = 0x282047AD06AEB62B
ONLY_SIGNALS = 0xF3E5E194E2548679
"""BLAKE2b by the definition, computed once."""
SIGNALS = (SignalState("west", "GGrr"), SignalState("east", "rrGG"))


@pytest.fixture
def states():
    rng = np.random.default_rng(1)
    columns = {name: (rng.random(3) * 100.0).astype(kind) for name, kind in ACTOR_STATE_DTYPES.items()}
    return ActorStates(step=7, **columns)


def test_the_hash_is_a_number_of_64_bits_that_never_changes():
    assert hash_state(ActorStates.empty(), ()) == EMPTY
    assert hash_state(ActorStates.empty(), SIGNALS) == ONLY_SIGNALS


def test_equal_states_have_equal_hashes(states):
    assert hash_state(states.select(np.ones(3, dtype=bool)), SIGNALS) == hash_state(states, SIGNALS) < 2**64


@pytest.mark.parametrize("name", sorted(ACTOR_STATE_DTYPES))
def test_the_last_bit_of_every_field_counts(states, name):
    column = getattr(states, name).copy()
    column.view(np.uint8)[0] ^= 1
    assert hash_state(dataclasses.replace(states, **{name: column}), SIGNALS) != hash_state(states, SIGNALS)


def test_step_signals_and_their_order_count(states):
    others = [
        *[hash_state(dataclasses.replace(states, step=8), SIGNALS), hash_state(states, SIGNALS[::-1])],
        *[hash_state(states, SIGNALS[:1]), hash_state(states, (SIGNALS[0], SignalState("east", "rrGy")))],
        hash_state(states.select(np.array([True, True, False])), SIGNALS),
    ]
    assert len({hash_state(states, SIGNALS), *others}) == 6


def test_the_byte_order_of_the_machine_does_not_count(states):
    swapped = dataclasses.replace(states, x_m=states.x_m.astype(">f8"))
    assert hash_state(swapped, SIGNALS) == hash_state(states, SIGNALS)
