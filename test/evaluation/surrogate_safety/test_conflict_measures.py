"""Extremes of a pair and the steps at which they occur, runs, and windows of an episode."""

import numpy as np
import pytest
from evaluation.made_records import moving, record_with

from siren_ros.errors import InputError
from siren_ros.evaluation.surrogate_safety.conflict_measures import conflict_series, longest_run_s, pair_measures
from siren_ros.evaluation.surrogate_safety.encounters import encounters_of
from siren_ros.roads.road_network import RoadNetwork


def test_each_other_actor_has_its_extremes(straight_road: RoadNetwork) -> None:
    """One vehicle ahead that the subject comes closer to, and one that is never in its way."""
    tracks = {
        1: moving(0.0, 0.0, 10.0, steps=21),
        4: moving(20.0, 0.0, 0.0, steps=21),
        7: moving(0, 9.0, 10.0, steps=21),
    }
    ahead, aside = pair_measures(conflict_series(record_with(tracks, straight_road), 1))
    assert (ahead.actor_id, aside.actor_id) == (4, 7)
    assert ahead.time_to_collision_s is not None
    assert ahead.time_to_collision_s.value == pytest.approx((20.0 - 10.0 - 4.6) / 10.0)
    assert ahead.time_to_collision_s.step == 20
    assert ahead.required_deceleration_mps2 is not None
    assert ahead.required_deceleration_mps2.value == pytest.approx(10.0**2 / (2.0 * 5.4))
    assert ahead.gap_m.value == pytest.approx(5.4)
    assert ahead.encroachment is None
    assert aside.time_to_collision_s is None
    assert aside.required_deceleration_mps2 is None
    assert aside.gap_m.value == pytest.approx(9.0 - 1.8)


def test_a_window_leaves_out_what_happens_outside(straight_road: RoadNetwork) -> None:
    tracks = {1: moving(0.0, 0.0, 10.0, steps=21), 4: moving(20.0, 0.0, 0.0, steps=21)}
    (ahead,) = pair_measures(conflict_series(record_with(tracks, straight_road), 1, steps=(2, 11)))
    assert ahead.gap_m.step == 10
    assert ahead.gap_m.value == pytest.approx(20.0 - 5.0 - 4.6)


def test_only_common_steps_are_encounters(straight_road: RoadNetwork) -> None:
    tracks = {1: moving(0, 0, 10.0, steps=10, first_step=3), 2: moving(50, 0, 0.0, steps=8, without=frozenset({5}))}
    encounters = encounters_of(record_with(tracks, straight_road), 1)
    assert encounters.step.tolist() == [3, 4, 6, 7]
    assert np.array_equal(encounters.subject.step, encounters.other.step)
    assert encounters.subject.x_m == pytest.approx([0.0, 0.5, 1.5, 2.0])


def test_an_unknown_subject_is_named(straight_road: RoadNetwork) -> None:
    with pytest.raises(InputError, match="9"):
        conflict_series(record_with({1: moving(0, 0, 1.0)}, straight_road), 9)


def test_runs_are_interrupted_by_missing_steps() -> None:
    steps = np.array([1, 2, 3, 5, 6, 7, 8])
    assert longest_run_s(np.ones(7, dtype=bool), steps) == pytest.approx(0.2)
    assert longest_run_s(np.array([1, 1, 1, 1, 0, 1, 1], dtype=bool), steps) == pytest.approx(0.15)
    assert longest_run_s(np.zeros(7, dtype=bool), steps) == 0.0
