"""Titles of the classes and the max-severity rule."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.labels import (
    Evidence,
    Moments,
    Reason,
    RiskClass,
    RiskLabel,
    RiskThresholds,
    SeenContact,
    SeenEncroachment,
    label_of,
    most_severe,
    risk_class,
)
from siren_ros.evaluation.risk.vlm.question import SYSTEM


@pytest.mark.parametrize("risk", RiskClass)
def test_titles_are_read_back(risk: RiskClass) -> None:
    assert risk_class(risk.title) is risk
    assert risk_class(f" {risk.title.upper()} ") is risk


@pytest.mark.parametrize("written", ["near miss", "NEAR_MISS", "Near-miss", "nearmiss"])
def test_ways_to_write_near_miss(written: str) -> None:
    assert risk_class(written) is RiskClass.NEAR_MISS


@pytest.mark.parametrize("written", ["", "normality", "crash", "Normal or Collision"])
def test_another_word_is_refused(written: str) -> None:
    with pytest.raises(InputError, match="Near-Miss"):
        risk_class(written)


def test_the_more_severe_one_counts() -> None:
    assert most_severe([RiskClass.NORMAL, RiskClass.COLLISION, RiskClass.NEAR_MISS]) is RiskClass.COLLISION
    assert most_severe([RiskClass.NORMAL, RiskClass.NEAR_MISS]) is RiskClass.NEAR_MISS


LIMITS = RiskThresholds()


def moments(count: int, ttc_s: float, closing_mps: float, drac_mps2: float = 0.0, gap_m: float = 5.0) -> Moments:
    """Consecutive steps of one civilian from step 100 on."""
    full = np.ones(count)
    return Moments(
        100 + np.arange(count),
        np.full(count, 7, np.uint32),
        ttc_s * full,
        closing_mps * full,
        drac_mps2 * full,
        gap_m * full,
    )


NOTHING = moments(0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("count", "ttc_s", "closing_mps", "near"),
    [(4, 1.49, 1.1, True), (3, 1.49, 1.1, False), (4, 1.51, 1.1, False), (4, 1.49, 0.9, False), (20, 0.0, 5.0, True)],
)
def test_a_short_time_to_collision_has_to_last(count: int, ttc_s: float, closing_mps: float, near: bool) -> None:
    label = label_of(Evidence(moments(count, ttc_s, closing_mps), (), ()), LIMITS)
    assert label.risk is (RiskClass.NEAR_MISS if near else RiskClass.NORMAL)
    assert label.reason is (Reason.TIME_TO_COLLISION if near else Reason.NOTHING)


def test_an_interruption_begins_anew() -> None:
    whole = moments(6, 1.0, 3.0)
    parted = replace(whole, step=np.array([100, 101, 102, 104, 105, 106]))
    assert label_of(Evidence(whole, (), ()), LIMITS).risk is RiskClass.NEAR_MISS
    assert label_of(Evidence(parted, (), ()), LIMITS).risk is RiskClass.NORMAL


def test_two_civilians_do_not_add_up() -> None:
    two = replace(moments(6, 1.0, 3.0), actor_id=np.array([7, 7, 7, 8, 8, 8], np.uint32))
    assert label_of(Evidence(two, (), ()), LIMITS).risk is RiskClass.NORMAL


@pytest.mark.parametrize(("time_s", "near"), [(0.95, True), (1.0, False)])
def test_encroachment(time_s: float, near: bool) -> None:
    label = label_of(Evidence(NOTHING, (SeenEncroachment(9, 50, time_s),), ()), LIMITS)
    assert label.risk is (RiskClass.NEAR_MISS if near else RiskClass.NORMAL)
    assert (label.actor_id, label.step) == ((9, 50) if near else (0, 0))


@pytest.mark.parametrize(("drac_mps2", "gap_m", "near"), [(3.5, 9.9, True), (3.5, 10.1, False), (3.3, 5.0, False)])
def test_hard_braking_needed_nearby(drac_mps2: float, gap_m: float, near: bool) -> None:
    label = label_of(Evidence(moments(1, 2.0, 8.0, drac_mps2, gap_m), (), ()), LIMITS)
    assert label.risk is (RiskClass.NEAR_MISS if near else RiskClass.NORMAL)


@pytest.mark.parametrize("impact_mps", [0.0, 0.1, 1.3, 1.5])
def test_touching_is_a_collision_however_slow_as_the_models_are_told(impact_mps: float) -> None:
    label = label_of(Evidence(NOTHING, (), (SeenContact(3, 80, impact_mps),)), LIMITS)
    assert label == RiskLabel(RiskClass.COLLISION, Reason.CONTACT, 3, 80, impact_mps)
    assert "Collision: the emergency vehicle and another vehicle touch." in SYSTEM
    assert "they do not touch" in SYSTEM.partition("- Near-Miss")[2].partition("- Collision")[0]


def test_the_most_severe_decides_and_then_the_earliest() -> None:
    conflict, contact = moments(8, 1.0, 5.0), SeenContact(3, 300, 4.0)
    encroachments = (SeenEncroachment(9, 90, 0.5), SeenEncroachment(8, 95, 0.1))
    assert label_of(Evidence(conflict, encroachments, (contact,)), LIMITS).step == 300
    assert label_of(Evidence(conflict, encroachments, ()), LIMITS).step == 90


def test_thresholds_are_parameters() -> None:
    evidence = Evidence(moments(8, 2.0, 5.0), (), ())
    assert label_of(evidence, LIMITS).risk is RiskClass.NORMAL
    assert label_of(evidence, replace(LIMITS, time_to_collision_s=2.5)).risk is RiskClass.NEAR_MISS


def test_a_label_names_the_moment_that_decided_it() -> None:
    """The least TTC among the short ones, and the hardest deceleration among the near ones, not the first ones."""
    varied = replace(
        moments(6, 1.0, 5.0), time_to_collision_s=np.array([1.4, 1.2, 0.8, 1.1, 1.3, 0.5]), closing_mps=np.full(6, 5.0)
    )
    varied.closing_mps[5] = 0.5
    label = label_of(Evidence(varied, (), ()), LIMITS)
    assert (label.reason, label.actor_id, label.step, label.value) == (Reason.TIME_TO_COLLISION, 7, 102, 0.8)
    braking = replace(
        moments(4, 2.0, 8.0, 4.0),
        actor_id=np.array([7, 7, 8, 8], np.uint32),
        required_deceleration_mps2=np.array([3.5, 5.0, 4.0, 9.0]),
        gap_m=np.array([5.0, 5.0, 5.0, 12.0]),
    )
    label = label_of(Evidence(braking, (), ()), LIMITS)
    assert (label.reason, label.actor_id, label.step, label.value) == (Reason.REQUIRED_DECELERATION, 7, 101, 5.0)


def test_each_civilian_has_its_own_short_time() -> None:
    """The second one's lasts long enough, and it is that one's least time that counts."""
    two = replace(
        moments(7, 1.0, 3.0),
        actor_id=np.array([7, 7, 7, 9, 9, 9, 9], np.uint32),
        step=np.array([100, 101, 102, 150, 151, 152, 153]),
        time_to_collision_s=np.array([0.2, 0.3, 0.4, 1.2, 1.1, 0.9, 1.0]),
    )
    label = label_of(Evidence(two, (), ()), LIMITS)
    assert (label.actor_id, label.step, label.value) == (9, 152, 0.9)


@pytest.mark.parametrize(
    "found",
    [
        Evidence(moments(8, 1.5, 5.0), (), ()),
        Evidence(moments(8, 1.0, 1.0), (), ()),
        Evidence(moments(1, 2.0, 8.0, 3.4, 5.0), (), ()),
        Evidence(moments(1, 2.0, 8.0, 5.0, 10.0), (), ()),
    ],
    ids=["TTC", "closing speed", "deceleration", "gap"],
)
def test_at_the_limit_itself_nothing_is_near(found: Evidence) -> None:
    assert label_of(found, LIMITS).risk is RiskClass.NORMAL
