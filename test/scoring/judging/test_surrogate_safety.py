"""Extremes of a pair and the steps at which they occur, runs, and windows of an episode."""

from dataclasses import replace
from pathlib import Path

import hand_made_record as hand
import numpy as np
import pytest
from busy_record import BEHIND, CROSSING, FIRST, busy_record
from evaluation.made_records import Track, moving, record_with
from hypothesis import given, settings
from hypothesis import strategies as st
from known_outputs import assert_known

from siren_ros.errors import InputError
from siren_ros.scoring.judging.surrogate_safety import (
    HORIZON_S,
    Encroachment,
    PredictedContacts,
    conflict_series,
    contacts_on_ways,
    encounters_of,
    longest_run_s,
    pair_measures,
    post_encroachment,
    predicted_contacts,
)
from siren_ros.simulation.roads.road_network import RoadNetwork


@pytest.fixture(scope="session")
def straight_road() -> RoadNetwork:
    """Any map: the measures do not look at it."""
    return hand.crossing()


def test_a_window_leaves_out_what_happens_outside(straight_road) -> None:
    tracks = {1: moving(0.0, 0.0, 10.0, steps=21), 4: moving(20.0, 0.0, 0.0, steps=21)}
    (ahead,) = pair_measures(*conflict_series(record_with(tracks, straight_road), 1, steps=(2, 11)))
    assert ahead.gap_m.step == 10
    assert ahead.gap_m.value == pytest.approx(20.0 - 5.0 - 4.6)


def test_only_common_steps_are_encounters(straight_road) -> None:
    tracks = {1: moving(0, 0, 10.0, steps=10, first_step=3), 2: moving(50, 0, 0.0, steps=8, without=frozenset({5}))}
    encounters = encounters_of(record_with(tracks, straight_road), 1)
    assert encounters.step.tolist() == [3, 4, 6, 7]
    assert np.array_equal(encounters.subject.step, encounters.other.step)
    assert encounters.subject.x_m == pytest.approx([0.0, 0.5, 1.5, 2.0])


def test_an_unknown_subject_is_named(straight_road) -> None:
    with pytest.raises(InputError, match="9"):
        conflict_series(record_with({1: moving(0, 0, 1.0)}, straight_road), 9)


def test_runs_are_interrupted_by_missing_steps() -> None:
    steps = np.array([1, 2, 3, 5, 6, 7, 8])
    assert longest_run_s(np.ones(7, dtype=bool), steps) == pytest.approx(0.2)
    assert longest_run_s(np.array([1, 1, 1, 1, 0, 1, 1], dtype=bool), steps) == pytest.approx(0.15)
    assert longest_run_s(np.zeros(7, dtype=bool), steps) == 0.0


SIZE_M = LENGTH_M, WIDTH_M = 4.6, 1.8


def encroachment(network: RoadNetwork, subject: Track, other: Track) -> Encroachment | None:
    record = record_with({1: subject, 2: other}, network)
    return post_encroachment(record.track(1), record.track(2), SIZE_M, SIZE_M)


def crossing(y_m: float, turned_rad: float, heading_rad: float = np.pi / 2.0) -> Track:
    """A vehicle at 10 m/s northwards through the origin, in a scene turned as a whole."""
    x, y = -y_m * np.sin(turned_rad), y_m * np.cos(turned_rad)
    return moving(x, y, 10.0, yaw_rad=heading_rad + turned_rad)


@pytest.mark.parametrize("turned_rad", [0.0, 0.6, 2.2, -1.9])
@pytest.mark.parametrize("late_m", [20.0, 15.0])
def test_the_time_between_the_two_at_one_place(straight_road, late_m, turned_rad) -> None:
    """Both at 10 m/s: the second reaches with its front what the first's tail left."""
    start = np.array([-30.0 * np.cos(turned_rad), -30.0 * np.sin(turned_rad)])
    subject = moving(*start, 10.0, yaw_rad=turned_rad)
    pet = encroachment(straight_road, subject, crossing(-30.0 - late_m, turned_rad))
    # The tail leaves a line across its way half a length after the centre; the front comes half a length early. Between
    # them the footprints are half a width wide each way.
    assert pet.time_s == pytest.approx((late_m - SIZE_M[0] - SIZE_M[1]) / 10.0, abs=0.11)
    assert pet.subject_first
    assert pet.step == pytest.approx((30.0 + late_m - 0.5 * (SIZE_M[0] + SIZE_M[1])) / 0.5, abs=2)


def test_who_was_first_and_whose_ways_have_no_encroachment(straight_road) -> None:
    """One that leaves the lane is somewhere else when an oncoming one passes its former place."""
    pet = encroachment(straight_road, moving(-50.0, 0.0, 10.0), crossing(-30.0, 0.0))
    assert not pet.subject_first
    leaves = moving(0.0, 0.0, 10.0, yaw_rad=np.pi / 2.0)
    pet = encroachment(straight_road, leaves, moving(40.0, 0.0, 10.0, yaw_rad=np.pi))
    assert pet.subject_first
    pet = encroachment(straight_road, moving(-30.0, 0.0, 10.0), crossing(-30.0, 0.0))
    assert pet.time_s == 0.0, "a contact"
    follower, apart = moving(-12.0, 0.0, 10.0), moving(0.0, 2.0, 10.0, yaw_rad=np.pi)
    assert [encroachment(straight_road, moving(0.0, 0.0, 10.0), other) for other in (follower, apart)] == [None, None]


@pytest.mark.parametrize(("angle_deg", "counts"), [(29, False), (-29, False), (31, True), (-31, True), (331, False)])
def test_thirty_degrees_are_a_crossing(straight_road, angle_deg, counts) -> None:
    """The second comes through the origin 3 s after the first."""
    angle = np.radians(angle_deg)
    first = moving(-20.0, 0.0, 10.0, steps=120)
    second = moving(-50.0 * np.cos(angle), -50.0 * np.sin(angle), 10.0, yaw_rad=angle, steps=120)
    assert (encroachment(straight_road, first, second) is not None) is counts


def test_of_equal_encroachments_the_earliest_counts(straight_road) -> None:
    """One stands across the way and is gone at step 40; the other is there from step 60 on, for as long."""
    stands = moving(0.0, 0.0, 0.0, yaw_rad=np.pi / 2.0, steps=40)
    comes = moving(0.0, 0.0, 0.0, steps=30, first_step=60)
    pet = encroachment(straight_road, stands, comes)
    assert (pet.time_s, pet.step, pet.subject_first) == (pytest.approx(21 * 0.05), 60, True)
    turned = encroachment(straight_road, comes, stands)
    assert (turned.step, turned.subject_first) == (60, False)
    # There up to step 19 and from 50 on; the other from 24 to 30 and from 40 to 45: five steps each.
    apart = replace(moving(0.0, 0.0, 0.0, yaw_rad=np.pi / 2.0, steps=70), without=frozenset(range(20, 50)))
    twice = replace(moving(0.0, 0.0, 0.0, steps=46), without=frozenset({*range(24), *range(31, 40)}))
    again = encroachment(straight_road, apart, twice)
    assert (again.time_s, again.step, again.subject_first) == (pytest.approx(5 * 0.05), 24, True)


def first_instant(network: RoadNetwork, *tracks: Track, yaw_rate_radps: float = 0.0) -> PredictedContacts:
    """What the present motion of the first vehicle and each of the others leads to."""
    encounters = encounters_of(record_with(dict(enumerate(tracks, start=1)), network), 1)
    turning = replace(encounters.subject, yaw_rate_radps=np.full(len(encounters), yaw_rate_radps))
    return predicted_contacts(replace(encounters, subject=turning))


def placed(x_m: float, y_m: float, speed_mps: float, heading_rad: float = 0.0, turned_rad: float = 0.0) -> Track:
    """A vehicle of one step in a scene that is turned as a whole about the origin."""
    cos, sin = np.cos(turned_rad), np.sin(turned_rad)
    return moving(x_m * cos - y_m * sin, x_m * sin + y_m * cos, speed_mps, yaw_rad=heading_rad + turned_rad, steps=1)


@settings(max_examples=30)
@given(turned_rad=st.floats(-np.pi, np.pi), gap_m=st.floats(2.0, 12.0), speed_mps=st.floats(6.0, 15.0))
def test_behind_a_standing_vehicle(straight_road, turned_rad, gap_m, speed_mps) -> None:
    there = placed(LENGTH_M + gap_m, 0.0, 0.0, 0.0, turned_rad)
    contacts = first_instant(straight_road, placed(0.0, 0.0, speed_mps, 0.0, turned_rad), there)
    assert contacts.time_s[0] == pytest.approx(gap_m / speed_mps, abs=1e-9)
    assert contacts.closing_mps[0] == pytest.approx(speed_mps)
    assert contacts.gap_m[0] == pytest.approx(gap_m)
    assert contacts.required_deceleration_mps2[0] == pytest.approx(speed_mps**2 / (2.0 * gap_m))


def test_head_on_the_speeds_add(straight_road) -> None:
    contacts = first_instant(straight_road, placed(500.0, -500.0, 8.0), placed(524.6, -500.0, 12.0, np.pi))
    assert contacts.time_s[0] == pytest.approx(1.0)
    assert contacts.closing_mps[0] == pytest.approx(20.0)


@pytest.mark.parametrize("turned_rad", [0.0, 0.7, 2.5])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_crossing_at_right_angles(straight_road, side, turned_rad) -> None:
    """The subject's front reaches the other's side: the way to it is the distance less half a length, half a width."""
    subject = placed(-15.0, 0.0, 10.0, 0.0, turned_rad)
    other = placed(0.0, side * 13.0, 9.0, -side * np.pi / 2.0, turned_rad)
    contacts = first_instant(straight_road, subject, other)
    assert contacts.time_s[0] == pytest.approx((15.0 - 0.5 * LENGTH_M - 0.5 * WIDTH_M) / 10.0, abs=1e-9)
    assert contacts.closing_mps[0] == pytest.approx(10.0)


@pytest.mark.parametrize("aside_m", [WIDTH_M + 0.05, -WIDTH_M - 0.05])
def test_passing_closely_and_being_gone_in_time_are_no_conflicts(straight_road, aside_m) -> None:
    others = placed(15.0, aside_m, 0.0), placed(15.0, 3.0, 20.0, np.pi / 2.0)
    contacts = first_instant(straight_road, placed(0.0, 0.0, 10.0), *others)
    assert np.isinf(contacts.time_s).all()
    assert contacts.closing_mps.tolist() == contacts.required_deceleration_mps2.tolist() == [0.0, 0.0]


def test_beyond_the_horizon_nothing_is_seen(straight_road) -> None:
    for gap_m, seen in ((HORIZON_S * 5.0 - 0.1, True), (HORIZON_S * 5.0 + 0.1, False)):
        contacts = first_instant(straight_road, placed(0.0, 0.0, 5.0), placed(LENGTH_M + gap_m, 0.0, 0.0))
        assert bool(np.isfinite(contacts.time_s[0])) is seen


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_a_vehicle_in_a_bend_stays_in_it(straight_road, hand) -> None:
    """A car stands where the tangent leads to and not the bend: no conflict; where the bend leads to: one."""
    speed_mps, radius_m = 8.0, 16.0
    on_tangent = placed(18.0, 0.0, 0.0)
    in_bend = placed(radius_m, hand * radius_m, 0.0, np.pi / 2.0)
    rate = hand * speed_mps / radius_m
    contacts = first_instant(straight_road, placed(0.0, 0.0, speed_mps), on_tangent, in_bend, yaw_rate_radps=rate)
    assert np.isinf(contacts.time_s[0])
    # A quarter circle less about half of each length.
    assert contacts.time_s[1] == pytest.approx((radius_m * np.pi / 2.0 - LENGTH_M) / speed_mps, abs=0.1)


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_the_body_turns_with_the_bend(straight_road, hand) -> None:
    """Past a car that stands along the bend, outside of it: only a body across the bend would touch it."""
    speed_mps, radius_m, aside_m = 8.0, 16.0, WIDTH_M + 0.4
    x_m = (radius_m + aside_m) * np.sin(np.pi / 4.0)
    y_m = hand * (radius_m - (radius_m + aside_m) * np.cos(np.pi / 4.0))
    parked = placed(x_m, y_m, 0.0, hand * np.pi / 4.0)
    rate = hand * speed_mps / radius_m
    contacts = first_instant(straight_road, placed(0.0, 0.0, speed_mps), parked, yaw_rate_radps=rate)
    assert np.isinf(contacts.time_s[0])


@pytest.mark.parametrize("turned_rad", [0.0, 1.3, -2.0])
@pytest.mark.parametrize(("ahead_mps", "closing_mps"), [(4.0, 6.0), (12.0, 0.0)])
def test_overlapping_footprints_close_or_part(straight_road, turned_rad, ahead_mps, closing_mps) -> None:
    other = placed(4.0, 0.0, ahead_mps, 0.0, turned_rad)
    contacts = first_instant(straight_road, placed(0.0, 0.0, 10.0, 0.0, turned_rad), other)
    assert (contacts.time_s[0], contacts.gap_m[0]) == (0.0, pytest.approx(4.0 - LENGTH_M))
    assert contacts.closing_mps[0] == pytest.approx(closing_mps)
    assert contacts.required_deceleration_mps2[0] == (np.inf if closing_mps else 0.0)


@pytest.mark.parametrize("gap_m", [0.02, 0.5, 0.98])
def test_near_is_not_touching(straight_road, gap_m) -> None:
    there = placed(LENGTH_M + gap_m, 0.0, 0.0)
    assert np.isinf(first_instant(straight_road, placed(0.0, 0.0, 0.0), there).time_s[0])
    contacts = first_instant(straight_road, placed(0.0, 0.0, 2.0), there)
    assert contacts.time_s[0] == pytest.approx(gap_m / 2.0)
    assert contacts.closing_mps[0] == pytest.approx(2.0)


def test_one_pair_touches_and_another_does_not(straight_road) -> None:
    others = placed(4.0, 0.0, 4.0), placed(16.0 + LENGTH_M, 0.0, 2.0), placed(0.0, 300.0, 2.0)
    contacts = first_instant(straight_road, placed(0.0, 0.0, 10.0), *others)
    assert contacts.time_s == pytest.approx([0.0, 2.0, np.inf])
    assert contacts.closing_mps == pytest.approx([6.0, 8.0, 0.0])
    assert contacts.required_deceleration_mps2 == pytest.approx([np.inf, 2.0, 0.0])


def on_ways(tracks, road):
    record = record_with(tracks, road)
    encounters = encounters_of(record, 1)
    return encounters, contacts_on_ways(encounters, record)


@settings(max_examples=30)
@given(st.floats(0.0, 15.0), st.floats(-np.pi, np.pi), st.floats(3.0, 30.0), st.integers(1, 60))
def test_on_straight_ways_the_contacts_are_those_of_unchanged_motion(straight_road, speed_mps, yaw_rad, x_m, steps):
    """Also where the record ends before they would touch."""
    tracks = {1: moving(0.0, 0.0, 8.0, steps=steps), 4: moving(x_m, 6.0, speed_mps, yaw_rad=yaw_rad, steps=steps)}
    encounters, found = on_ways(tracks, straight_road)
    plain = predicted_contacts(encounters)
    assert found.gap_m == pytest.approx(plain.gap_m)
    assert found.time_s == pytest.approx(plain.time_s, abs=1e-6)
    assert found.closing_mps == pytest.approx(plain.closing_mps, abs=1e-6)


def test_a_driver_who_brakes_would_have_driven_on_at_the_speed_of_the_moment(straight_road) -> None:
    """The subject stops 1 m behind a standing vehicle; without braking it would have touched it."""
    tracks = {1: moving(0.0, 0.0, 10.0, -5.0, steps=41), 4: moving(10.0 + 4.6 + 1.0, 0.0, 0.0, steps=41)}
    encounters, found = on_ways(tracks, straight_road)
    moves = encounters.subject.speed_mps > 5.0
    subject = encounters.subject.select(moves)
    assert found.time_s[moves] == pytest.approx((11.0 - subject.x_m) / subject.speed_mps)
    assert not np.isfinite(found.time_s[-1])


def test_a_vehicle_that_ends_its_turn_does_not_turn_on(straight_road) -> None:
    """It turns across the subject's lane into the next one; its rate of turn would lead back into the subject's."""
    time_s, rate_radps, speed_mps = np.arange(81) * 0.05, 0.5, 5.4
    yaw_rad = np.pi - np.clip(rate_radps * (1.0 - time_s), 0.0, None)
    velocity = speed_mps * np.stack((np.cos(yaw_rad), np.sin(yaw_rad)), axis=1)
    places = np.cumsum(velocity * 0.05, axis=0)
    places += (50.0, 3.5 - places[-1, 1])
    turning = Track(np.column_stack((places, velocity, yaw_rad)))
    record = record_with({1: moving(0.0, 0.0, 14.0, steps=81), 4: turning}, straight_road)
    for states, rate in zip(record.states, np.where(time_s < 1.0, rate_radps, 0.0), strict=True):
        states.yaw_rate_radps[states.actor_id == 4] = rate
    encounters = encounters_of(record, 1)
    assert np.isfinite(predicted_contacts(encounters).time_s).any()
    assert np.isinf(contacts_on_ways(encounters, record).time_s).all()


def test_every_pair_of_three_emvs() -> None:
    """Extremes of every pair, and at every third meeting the contacts that are ahead, straight on and on their ways."""
    found: dict[str, object] = {}
    for emv_id in (FIRST, BEHIND, CROSSING):
        pairs, contacts = conflict_series(busy_record(), emv_id)
        for pair in pair_measures(pairs, contacts):
            extremes = pair.gap_m, pair.time_to_collision_s, pair.required_deceleration_mps2, pair.encroachment
            found[f"{emv_id} and {pair.actor_id}"] = [
                None if one is None else tuple(vars(one).values()) for one in extremes
            ]
        for name, each in (("contacts", contacts), ("on ways", contacts_on_ways(pairs, busy_record()))):
            ahead = np.flatnonzero(np.isfinite(each.time_s))[::3]
            columns = {key: value[ahead] for key, value in vars(each).items()}
            found[f"{name} of {emv_id}"] = {"step": pairs.step[ahead], "actor_id": pairs.actor_id[ahead], **columns}
    assert_known(Path(__file__).parent / "known" / "surrogate_safety.json", found, digits=5)
