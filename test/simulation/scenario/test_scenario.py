"""The region of the paper's platform: 40 m in, 50 m out around the EMV."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.data.tracks import rows_in_region
from siren_ros.simulation.scenario.scenario import region_members
from siren_ros.simulation.world.actors import ActorStates

EMV = 1


def at(*places_m, step=0):
    """Actors 1, 2, … at given places; actor 1 is the EMV."""
    empty = ActorStates.empty(step)
    zeros = {name: np.zeros(len(places_m), values.dtype) for name, values in vars(empty).items() if name != "step"}
    x_m, y_m = np.array(places_m).reshape(-1, 2).T
    ids = np.arange(1, len(places_m) + 1, dtype=np.uint32)
    return replace(empty, **{**zeros, "actor_id": ids, "x_m": x_m, "y_m": y_m})


def regions_of(states, emv_ids):
    """Members after each of consecutive steps, one after the other."""
    members = nobody()
    for state in states:
        members = region_members(members, state, emv_ids)
        yield members


def nobody():
    return np.empty(0, dtype=np.uint32)


@pytest.mark.parametrize(("distance_m", "enters"), [(0.0, True), (39.99, True), (40.0, False), (49.9, False)])
def test_a_vehicle_enters_within_40_m(distance_m, enters):
    members = region_members(nobody(), at((10.0, 5.0), (10.0, 5.0 + distance_m)), [EMV])
    assert members.tolist() == ([1, 2] if enters else [1])


@pytest.mark.parametrize(("distance_m", "stays"), [(40.01, True), (50.0, True), (50.01, False)])
def test_a_member_leaves_beyond_50_m(distance_m, stays):
    members = region_members(np.array([1, 2], dtype=np.uint32), at((0.0, 0.0), (distance_m, 0.0)), [EMV])
    assert members.tolist() == ([1, 2] if stays else [1])


def test_the_nearest_of_several_emvs_counts():
    states = at((0.0, 0.0), (200.0, 0.0), (230.0, 0.0))
    assert region_members(nobody(), states, [1, 2]).tolist() == [1, 2, 3]
    assert region_members(nobody(), states, [1]).tolist() == [1]


def test_without_an_emv_there_is_no_region():
    states = at((0.0, 0.0), (1.0, 0.0))
    assert region_members(states.actor_id, states, [7]).tolist() == []
    assert region_members(nobody(), ActorStates.empty(), [EMV]).tolist() == []


@given(
    st.lists(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), min_size=1, max_size=8), st.sets(st.integers(1, 8))
)
def test_the_band_decides_by_membership_alone(places, before):
    states = at(*places)
    members = set(region_members(np.array(sorted(before), dtype=np.uint32), states, [EMV]).tolist())
    distance = np.hypot(states.x_m - states.x_m[0], states.y_m - states.y_m[0])
    for actor_id, away_m in zip(states.actor_id.tolist(), distance.tolist(), strict=True):
        expected = away_m < 40.0 or (away_m <= 50.0 and actor_id in before)
        assert (actor_id in members) == expected


@pytest.fixture(scope="module")
def small_record(record_of):
    return record_of(civilians=1)


@settings(max_examples=20)
@given(seed=st.integers(0, 2000))
def test_rows_are_as_the_steps_say_whoever_is_there(seed, small_record):
    """Random walks around 45 m from two EMVs, with gaps; one step has nobody at all, and one was not recorded."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(scale=4.0, size=(30, 6, 2)), axis=0) + rng.uniform(-45.0, 45.0, (6, 2))
    states = []
    for step in range(30):
        whole = at(*map(tuple, walk[step]), step=step)
        there = np.flatnonzero(rng.random(6) < (0.0 if step == 12 else 0.9))
        arrays = {name: values[there] for name, values in vars(whole).items() if name != "step"}
        states.append(replace(whole, **arrays))
    del states[20]
    description = replace(small_record.description, emv_ids=(1, 2))
    changed = replace(small_record, states=tuple(states), description=description)
    inside, rows = rows_in_region(changed), changed.rows
    for state, members in zip(states, regions_of(states, (1, 2)), strict=True):
        assert set(rows.actor_id[inside & (rows.step == state.step)].tolist()) == set(members.tolist())


@pytest.mark.parametrize(("first_m", "inside"), [(39.0, True), (45.0, False)])
def test_who_comes_first_in_the_record_is_what_it_was_at_its_first_step(first_m, inside, record_of):
    """The civilian has the smaller id; from its second step on it is between 40 and 50 m away."""
    record = record_of(civilians=1)
    states = tuple(at((x_m, 0.0), (0.0, 0.0), step=step) for step, x_m in enumerate((first_m, 45.0, 45.0)))
    changed = replace(record, states=states, description=replace(record.description, emv_ids=(2,)))
    assert rows_in_region(changed).tolist() == [inside, inside, inside, True, True, True]
