"""Conditions as they are printed, and on both sides of their thresholds."""

import numpy as np
import pytest

from siren_ros.scoring.judging.verdict import (
    Moment,
    at_least,
    at_most,
    closest_of,
    equals,
    first_reaching,
    more_than,
    verdict_of,
)


@pytest.mark.parametrize(
    ("make", "holds", "relation"),
    [
        (at_least, (False, True, True), ">="),
        (more_than, (False, False, True), ">"),
        (at_most, (True, True, False), "<="),
        (equals, (False, True, False), "="),
    ],
)
def test_conditions_hold_on_their_side_of_the_threshold(make, holds, relation):
    parts = [make("way_m", value, 2.5) for value in (2.4, 2.5, 2.6)]
    assert tuple(part.holds for part in parts) == holds
    assert {part.relation for part in parts} == {relation}
    assert not make("way_m", float("nan"), 2.5).holds


def test_a_condition_is_one_line_with_its_detail_behind_it():
    assert str(at_least("way_m", 3.14159, 2.0)) == "way_m: 3.142 (needs >= 2)"
    assert str(at_most("way_m", 7.0, 2.0, "actor 3 at step 9")) == "way_m: 7 (needs <= 2), actor 3 at step 9"


def test_a_verdict_holds_where_all_of_its_parts_do():
    good, bad = at_least("a", 3.0, 1.0), at_least("b", 0.5, 1.0)
    assert verdict_of((good,), "text").holds
    verdict = verdict_of((good, bad), "text")
    assert (verdict.holds, verdict.failing, verdict.text) == (False, (bad,), "text")
    assert verdict.measures() == {"a": 3.0, "b": 0.5}


def test_the_closest_verdict_has_the_most_parts_and_then_the_largest_values():
    whole, none, first, second = (
        verdict_of(tuple(at_least(f"part{number}", value, 1.0) for number, value in enumerate(values)), "")
        for values in ((1, 1), (0, 0), (1, 0), (0, 9))
    )
    assert closest_of([none, second, whole, first]) is whole
    assert closest_of([none, second, first]) is first
    assert closest_of([]) is None


MOMENTS = tuple(Moment(10 * number, number) for number in (1, 2, 3))


@pytest.mark.parametrize(
    ("make", "threshold", "step"),
    [
        (at_least, 2, 20),
        (at_least, 1.5, 20),
        (at_least, 3, 30),
        (at_least, 4, 30),
        (at_least, 0, 10),
        (more_than, 1.2, 20),
        (equals, 0, 10),
        (at_most, 0, 10),
        (at_most, 1, 20),
        (at_most, np.inf, 30),
    ],
)
def test_the_decisive_moment_fulfils_or_breaks_a_count(make, threshold, step):
    assert make("n", 3, threshold, "", *MOMENTS).decisive.step == step


def test_a_single_moment_decides_and_without_one_nothing_does():
    assert at_least("way_m", 120.0, 100.0, "", MOMENTS[1]).decisive is MOMENTS[1]
    assert at_most("overlap_m", 0.4, 0.3).decisive is None


def test_a_moment_names_actor_and_time():
    assert str(Moment(25, 7)) == "7 at 1.2 s"
    assert str(Moment(26, 7, "0.40 m")) == "7 at 1.3 s (0.40 m)"


def test_a_threshold_is_reached_at_the_first_step_with_its_value():
    steps = np.array([4, 5, 6, 7])
    assert first_reaching(steps, 3, [0.0, 1.0, 0.5, 2.0], 1.0) == (Moment(5, 3),)
    assert first_reaching(steps, 3, [0.0, 1.0, 0.5, 2.0], 2.1) == ()
