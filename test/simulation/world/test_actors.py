"""Actors by id, routes of one list for all vehicles, and the types of the columns."""

import dataclasses

import numpy as np
import pytest
from hand_made_record import actor_states, traffic_of
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    ActorClass,
    ActorStates,
    Lights,
    Mode,
    Owner,
    SignalState,
    by_class,
    hash_state,
    rows_of_ids,
)

_ids = st.sets(st.integers(1, 40), max_size=12).map(lambda ids: np.array(sorted(ids), np.uint32))


@given(present=_ids, asked=st.lists(st.integers(1, 45), max_size=12).map(lambda ids: np.array(ids, np.uint32)))
def test_rows_hold_the_wanted_ids_or_are_minus_one(present, asked):
    rows = rows_of_ids(present, asked)
    assert rows.dtype == np.intp
    listed = present.tolist()
    assert rows.tolist() == [listed.index(actor) if actor in listed else -1 for actor in asked.tolist()]


def test_who_yields_is_in_a_phase_from_reacting_to_the_hold():
    """Not on the way back, and not who stands after a contact."""
    phases = {Mode.YIELD_REACTING, Mode.YIELD_DEFERRED, Mode.YIELD_LANE_CHANGE, Mode.YIELD_KEEP_LANE}
    phases |= {Mode.YIELD_PULL_OVER, Mode.YIELD_HOLD}
    assert {mode for mode in Mode if mode.is_yielding} == phases


def test_emergency_vehicles_are_of_three_classes():
    emergency = {kind for kind in ActorClass if kind.is_emergency}
    assert emergency == {ActorClass.AMBULANCE, ActorClass.FIRE_TRUCK, ActorClass.POLICE}


def test_a_class_without_a_row_has_that_of_its_body():
    table = by_class({ActorClass.SEDAN: "car", ActorClass.TRUCK: "truck", ActorClass.POLICE: "police"})
    cars = dict.fromkeys((ActorClass.HATCHBACK, ActorClass.SEDAN, ActorClass.ESTATE, ActorClass.SUV), "car")
    others = {ActorClass.PICKUP: "car", ActorClass.TRUCK: "truck", ActorClass.FIRE_TRUCK: "truck"}
    assert table == {**cars, **others, ActorClass.POLICE: "police"}


def test_codes_are_those_of_the_messages():
    """Recorded bags hold the numbers."""
    assert [mode.name for mode in Mode] == [
        *("NOMINAL", "ROUTE_FOLLOW", "FORCED_LANE_CHANGE", "COPY_SUMO", "GAP_ESCAPE", "YIELD_REACTING"),
        *("YIELD_DEFERRED", "YIELD_LANE_CHANGE", "YIELD_KEEP_LANE", "YIELD_PULL_OVER", "YIELD_HOLD", "REJOIN"),
        *("EXTERNAL", "STOPPED"),
    ]
    assert [int(mode) for mode in Mode] == list(range(14))
    assert [int(light) for light in (Lights.BRAKE, Lights.INDICATOR_LEFT, Lights.INDICATOR_RIGHT)] == [1, 2, 4]
    assert (int(Lights.BEACON), int(Lights.SIREN), int(Owner.SUMO), int(Owner.ROS)) == (8, 16, 0, 1)


@given(present=_ids, asked=st.integers(0, 45))
def test_the_row_of_an_actor_is_none_where_it_is_not_on_the_map(present, asked):
    states = actor_states(0, actor_id=present)
    listed = present.tolist()
    assert states.row_of(asked) == (listed.index(asked) if asked in listed else None)


def test_rows_are_selected_from_every_column():
    columns = {name: np.arange(4).astype(dtype) for name, dtype in ACTOR_STATE_DTYPES.items()}
    states = ActorStates(step=7, **{**columns, "vx_mps": np.array([3.0, 0.0, -3.0, 5.0])})
    chosen = states.select(np.array([True, False, True, False]))
    assert (chosen.step, len(chosen)) == (7, 2)
    assert {name: getattr(chosen, name).tolist() for name in columns if name != "vx_mps"} == {
        name: [0, 2] for name in columns if name != "vx_mps"
    }
    assert chosen.speed_mps.tolist() == [3.0, np.hypot(-3.0, 2.0)]
    frame = chosen.to_pandas()
    assert list(frame.columns) == ["step", *ACTOR_STATE_DTYPES]
    assert frame.step.tolist() == [7, 7]
    assert len(ActorStates.empty(3)) == 0


def test_each_row_has_its_own_part_of_the_routes():
    state = traffic_of(0, actor_id=[1, 2, 3], route_offset=[0, 2, 2, 5], route_edges=range(10, 15))
    assert [state.route_of_row(row).tolist() for row in range(3)] == [[10, 11], [], [12, 13, 14]]
    assert len(state) == 3


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


def test_equal_states_have_equal_hashes_whatever_the_byte_order_of_the_machine(states):
    swapped = dataclasses.replace(states, x_m=states.x_m.astype(">f8"))
    assert hash_state(swapped, SIGNALS) == hash_state(states, SIGNALS)
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
