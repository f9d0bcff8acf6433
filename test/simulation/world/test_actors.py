"""Looking actors up by id."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    ActorClass,
    ActorStates,
    Lights,
    Mode,
    Owner,
    rows_of_ids,
)

_ids = st.sets(st.integers(1, 40), max_size=12).map(lambda ids: np.array(sorted(ids), np.uint32))


@given(present=_ids, asked=st.lists(st.integers(1, 45), max_size=12).map(lambda ids: np.array(ids, np.uint32)))
def test_rows_hold_the_wanted_ids_or_are_minus_one(present, asked):
    rows = rows_of_ids(present, asked)
    assert rows.dtype == np.intp
    listed = present.tolist()
    assert rows.tolist() == [listed.index(actor) if actor in listed else -1 for actor in asked.tolist()]


@given(present=_ids)
def test_the_same_ids_are_the_rows_in_order(present):
    assert rows_of_ids(present, present.copy()).tolist() == list(range(len(present)))


def test_who_yields_is_in_a_phase_from_reacting_to_the_hold():
    """Not on the way back, and not who stands after a contact."""
    phases = {Mode.YIELD_REACTING, Mode.YIELD_DEFERRED, Mode.YIELD_LANE_CHANGE, Mode.YIELD_KEEP_LANE}
    phases |= {Mode.YIELD_PULL_OVER, Mode.YIELD_HOLD}
    assert {mode for mode in Mode if mode.is_yielding} == phases


def test_emergency_vehicles_are_of_three_classes():
    emergency = {kind for kind in ActorClass if kind.is_emergency}
    assert emergency == {ActorClass.AMBULANCE, ActorClass.FIRE_TRUCK, ActorClass.POLICE}


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
    columns = {name: np.zeros(len(present), dtype) for name, dtype in ACTOR_STATE_DTYPES.items()}
    states = ActorStates(step=0, **{**columns, "actor_id": present})
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
    assert len(ActorStates.empty(3)) == 0


def test_selected_rows_and_frames_keep_the_step():
    columns = {name: np.arange(4).astype(dtype) for name, dtype in ACTOR_STATE_DTYPES.items()}
    states = ActorStates(step=7, **columns)
    chosen = states.select(np.array([1, 3]))
    assert (chosen.step, len(chosen), chosen.actor_id.tolist(), chosen.residual_m.tolist()) == (
        7,
        2,
        [1, 3],
        [1.0, 3.0],
    )
    frame = chosen.to_pandas()
    assert list(frame.columns) == ["step", *ACTOR_STATE_DTYPES]
    assert frame.step.tolist() == [7, 7]
