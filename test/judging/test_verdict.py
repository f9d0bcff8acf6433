"""Conditions as they are printed, and on both sides of their thresholds."""

import pytest

from siren_ros.judging.verdict import Part, at_least, at_most, equals, more_than, verdict_of


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
    parts = [make("way_m", value, 2.5) for value in (2.0, 2.5, 3.0)]
    assert tuple(part.holds for part in parts) == holds
    assert {part.relation for part in parts} == {relation}
    assert not make("way_m", float("nan"), 2.5).holds


def test_a_condition_is_one_line_with_its_detail_behind_it():
    assert str(at_least("way_m", 3.14159, 2.0)) == "way_m: 3.142 (needs >= 2)"
    assert str(at_most("way_m", 7.0, 2.0, "actor 3 at step 9")) == "way_m: 7 (needs <= 2), actor 3 at step 9"


def test_a_verdict_holds_where_all_of_its_parts_do():
    good, bad = at_least("a", 3.0, 1.0), at_least("b", 0.5, 1.0)
    assert verdict_of((good,), "told").holds
    found = verdict_of((good, bad), "told")
    assert (found.holds, found.failing, found.text) == (False, (bad,), "told")
    assert found.measures() == {"a": 3.0, "b": 0.5}
    assert isinstance(good, Part)
