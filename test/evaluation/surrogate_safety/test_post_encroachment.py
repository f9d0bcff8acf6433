"""PET of tracks that cross, follow and meet."""

from dataclasses import replace

import numpy as np
import pytest
from evaluation.made_records import Track, moving, record_with

from siren_ros.evaluation.surrogate_safety.post_encroachment import Encroachment, post_encroachment
from siren_ros.roads.road_network import RoadNetwork

SIZE_M = (4.6, 1.8)


def between(network: RoadNetwork, subject: Track, other: Track) -> Encroachment | None:
    record = record_with({1: subject, 2: other}, network)
    return post_encroachment(record.track(1), record.track(2), SIZE_M, SIZE_M)


def crossing(y_m: float, turned_rad: float, heading_rad: float = np.pi / 2.0) -> Track:
    """A vehicle at 10 m/s northwards through the origin, in a scene turned as a whole."""
    x, y = -y_m * np.sin(turned_rad), y_m * np.cos(turned_rad)
    return moving(x, y, 10.0, yaw_rad=heading_rad + turned_rad)


@pytest.mark.parametrize("turned_rad", [0.0, 0.6, 2.2, -1.9])
@pytest.mark.parametrize("late_m", [20.0, 15.0])
def test_the_time_between_the_two_at_one_place(straight_road: RoadNetwork, late_m: float, turned_rad: float) -> None:
    """Both at 10 m/s: the second reaches with its front what the first's tail left."""
    start = np.array([-30.0 * np.cos(turned_rad), -30.0 * np.sin(turned_rad)])
    subject = moving(*start, 10.0, yaw_rad=turned_rad)
    found = between(straight_road, subject, crossing(-30.0 - late_m, turned_rad))
    assert found is not None
    # The tail leaves a line across its way half a length after the centre; the front comes half a length early. Between
    # them the footprints are half a width wide each way.
    assert found.time_s == pytest.approx((late_m - SIZE_M[0] - SIZE_M[1]) / 10.0, abs=0.11)
    assert found.subject_first
    assert found.step == pytest.approx((30.0 + late_m - 0.5 * (SIZE_M[0] + SIZE_M[1])) / 0.5, abs=2)


def test_who_was_first(straight_road: RoadNetwork) -> None:
    subject = moving(-50.0, 0.0, 10.0)
    found = between(straight_road, subject, crossing(-30.0, 0.0))
    assert found is not None
    assert not found.subject_first


def test_followers_have_headway_and_no_encroachment(straight_road: RoadNetwork) -> None:
    assert between(straight_road, moving(0.0, 0.0, 10.0), moving(-12.0, 0.0, 10.0)) is None


def test_head_on_over_the_same_place_counts(straight_road: RoadNetwork) -> None:
    """One leaves the lane for the other's sake: it is somewhere else when the other passes its former place."""
    leaves = moving(0.0, 0.0, 10.0, yaw_rad=np.pi / 2.0)
    found = between(straight_road, leaves, moving(40.0, 0.0, 10.0, yaw_rad=np.pi))
    assert found is not None
    assert found.subject_first


def test_ways_apart_have_none(straight_road: RoadNetwork) -> None:
    assert between(straight_road, moving(0.0, 0.0, 10.0), moving(0.0, 2.0, 10.0, yaw_rad=np.pi)) is None


def test_a_contact_has_none_left(straight_road: RoadNetwork) -> None:
    found = between(straight_road, moving(-30.0, 0.0, 10.0), crossing(-30.0, 0.0))
    assert found is not None
    assert found.time_s == 0.0


@pytest.mark.parametrize(("angle_deg", "counts"), [(29, False), (-29, False), (31, True), (-31, True), (331, False)])
def test_thirty_degrees_are_a_crossing(straight_road: RoadNetwork, angle_deg: int, *, counts: bool) -> None:
    """The second comes through the origin 3 s after the first."""
    angle = np.radians(angle_deg)
    first = moving(-20.0, 0.0, 10.0, steps=120)
    second = moving(-50.0 * np.cos(angle), -50.0 * np.sin(angle), 10.0, yaw_rad=angle, steps=120)
    assert (between(straight_road, first, second) is not None) is counts


def test_of_equal_encroachments_the_earliest_counts(straight_road: RoadNetwork) -> None:
    """One stands across the way and is gone at step 40; the other is there from step 60 on, for as long."""
    stands = moving(0.0, 0.0, 0.0, yaw_rad=np.pi / 2.0, steps=40)
    comes = moving(0.0, 0.0, 0.0, steps=30, first_step=60)
    found = between(straight_road, stands, comes)
    assert found is not None
    assert (found.time_s, found.step, found.subject_first) == (pytest.approx(21 * 0.05), 60, True)
    turned = between(straight_road, comes, stands)
    assert turned is not None
    assert (turned.step, turned.subject_first) == (60, False)
    # There up to step 19 and from 50 on; the other from 24 to 30 and from 40 to 45: five steps each.
    apart = replace(moving(0.0, 0.0, 0.0, yaw_rad=np.pi / 2.0, steps=70), without=frozenset(range(20, 50)))
    twice = replace(moving(0.0, 0.0, 0.0, steps=46), without=frozenset({*range(24), *range(31, 40)}))
    again = between(straight_road, apart, twice)
    assert again is not None
    assert (again.time_s, again.step, again.subject_first) == (pytest.approx(5 * 0.05), 24, True)
