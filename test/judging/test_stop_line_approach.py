"""The least speed over the last 15 m before the stop line at 100 m; the EMV's front is 3 m ahead of its centre."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import CAR_LENGTH_M, EMV, EMV_LENGTH_M, NORTHBOUND, PARALLEL, Driven, crossing, hand_made

from siren_ros.judging.junction_traversal import find_traversals
from siren_ros.judging.stop_line_approach import APPROACH_M, least_free_speed_mps
from siren_ros.roads.road_network import JunctionKind

NETWORK = crossing(JunctionKind.PRIORITY_STOP)
LINE_M = 100.0 - EMV_LENGTH_M / 2.0
"""Where the EMV's centre is as its front passes the line."""


def profile(*parts):
    """Arc lengths for pieces of (way, speed)."""
    arc = [40.0]
    for way, speed in parts:
        count = round(way / (speed * 0.05))
        arc.extend(arc[-1] + speed * 0.05 * (np.arange(count) + 1))
    return np.array(arc)


def least(arc_m, others=None):
    record = hand_made(NETWORK, {EMV: Driven(NORTHBOUND, arc_m), **(others or {})})
    (traversal,) = [item for item in find_traversals(record) if item.actor_id == EMV]
    return least_free_speed_mps(record, traversal)


@pytest.mark.parametrize(("slow_from_m", "expected"), [(30.0, 8.0), (50.0, 2.0)])
def test_only_the_last_15_m_count(slow_from_m, expected):
    """Slow for 5 m, from 30 m (27 m before the line) or from 50 m (7 m before it) after the start at 40 m."""
    arc = profile((slow_from_m - 10.0, 8.0), (5.0, 2.0), (80.0, 8.0))
    assert least(arc) == pytest.approx(expected, abs=0.05)
    assert APPROACH_M == 15.0


def test_the_speed_at_the_line_counts_where_it_is_the_least():
    """It brakes evenly over the line."""
    time = 0.05 * np.arange(140)
    arc = 60.0 + 10.0 * time - 0.5 * time**2
    at_line = np.sqrt(10.0**2 - 2.0 * (LINE_M - 60.0))
    assert least(arc) == pytest.approx(at_line, abs=0.06)


def standing(arc_m, points=NORTHBOUND, steps=400):
    return {2: Driven(points, np.full(steps, arc_m))}


def test_who_stands_behind_somebody_in_its_lane_has_not_stopped_for_the_line():
    """Somebody whose rear is before the line is ahead; who is past it, in another lane or behind is not."""
    arc = profile((45.0, 5.0), (10.0, 1.0), (60.0, 5.0))
    assert least(arc) == pytest.approx(1.0, abs=0.05)
    assert least(arc, standing(100.0 + CAR_LENGTH_M / 2.0 - 0.2)) == pytest.approx(5.0, abs=0.1)
    assert least(arc, standing(100.0 + CAR_LENGTH_M / 2.0 + 0.2)) == pytest.approx(1.0, abs=0.05)
    assert least(arc, standing(98.0, PARALLEL)) == pytest.approx(1.0, abs=0.05)
    assert least(arc, standing(60.0)) == pytest.approx(1.0, abs=0.05)


def test_a_record_may_begin_later_than_step_0():
    """Without its first 20 steps the record has the same approach."""
    arc = profile((40.0, 8.0), (5.0, 2.0), (80.0, 8.0))
    ahead = {2: Driven(NORTHBOUND, np.concatenate((np.full(60, 95.0), 95.0 + 0.5 * np.arange(200))))}
    record = hand_made(NETWORK, {EMV: Driven(NORTHBOUND, arc), **ahead})
    late = replace(record, states=record.states[20:], traffic=record.traffic[20:])
    (whole,), (cut,) = ([one for one in find_traversals(item) if one.actor_id == EMV] for item in (record, late))
    assert cut.enter_step == whole.enter_step
    assert least_free_speed_mps(late, cut) == least_free_speed_mps(record, whole)


LEFT_LANE = np.array([[1.75, -120.0], [1.75, 110.0]])
"""The driving lane next to the EMV's."""


def test_who_stands_in_the_next_lane_does_not_keep_the_vehicle_from_the_line():
    arc = profile((45.0, 5.0), (10.0, 1.0), (60.0, 5.0))
    assert least(arc, standing(98.0, LEFT_LANE)) == pytest.approx(1.0, abs=0.05)
    aside = np.array([[5.25 + 1.7, -120.0], [5.25 + 1.7, 110.0]])
    assert least(arc, standing(98.0, aside)) == pytest.approx(5.0, abs=0.1), "within half a lane's width it does"


@pytest.mark.parametrize("cut", [0, 20])
def test_the_way_is_free_from_the_very_step_at_which_the_one_ahead_has_left(cut):
    """The EMV gains speed, so that its least free speed is that of the first free step."""
    time = 0.05 * np.arange(160)
    arc = 82.0 + 1.0 * time + 0.6 * time**2
    gone = 60
    ahead = {2: Driven(NORTHBOUND, np.concatenate((np.full(gone, 101.0), np.full(300, 130.0))))}
    record = hand_made(NETWORK, {EMV: Driven(NORTHBOUND, arc), **ahead})
    record = replace(record, states=record.states[cut:], traffic=record.traffic[cut:])
    (traversal,) = [item for item in find_traversals(record) if item.actor_id == EMV]
    assert least_free_speed_mps(record, traversal) == pytest.approx(1.0 + 1.2 * 0.05 * gone, abs=1e-6)
