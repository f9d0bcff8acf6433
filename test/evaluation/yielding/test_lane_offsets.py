import numpy as np
import pytest
from hand_made_record import Driven, line
from made_encounters import CAR, arc, record_of

from siren_ros.evaluation.yielding.lane_offsets import lane_offsets

CHANGES_LEFT = line((5.25, -120.0), (5.25, -80.0), (1.75, -60.0), (1.75, 110.0))


def test_a_lane_change_is_one_way_across_the_road() -> None:
    record = record_of(arc((1.0, 10.0)), {CAR: Driven(CHANGES_LEFT, arc((10.0, 20.0)))})
    offsets = lane_offsets(record, record.track(CAR))
    assert offsets.lateral_m[-1] == pytest.approx(3.5, abs=1e-6)
    assert np.abs(offsets.offset_m).max() == pytest.approx(1.75, abs=0.1)
    assert np.abs(np.diff(offsets.lateral_m)).max() < 0.1, "no jump from lane to lane, nor across the junction"


def test_beyond_the_lanes_the_last_one_counts() -> None:
    leaves = line((5.25, -120.0), (5.25, -80.0), (12.0, -60.0), (12.0, -30.0))
    record = record_of(arc((1.0, 10.0)), {CAR: Driven(leaves, arc((8.0, 10.0)))})
    offsets = lane_offsets(record, record.track(CAR))
    assert offsets.lateral_m[-1] == pytest.approx(-6.75, abs=1e-6)


def test_to_the_left_and_back_is_no_way_and_each_change_is_one() -> None:
    """From the right lane by 3.5 m to the left one, and back again; some of the states keep their ways."""
    weaves = line((5.25, -120.0), (5.25, -100.0), (1.75, -80.0), (1.75, -60.0), (5.25, -40.0), (5.25, -25.0))
    record = record_of(arc((1.0, 10.0)), {CAR: Driven(weaves, arc((9.0, 10.0)))})
    track = record.track(CAR)
    offsets = lane_offsets(record, track)
    assert offsets.lateral_m == pytest.approx(5.25 - track.x_m)
    assert offsets.lateral_m.max() == pytest.approx(3.5)
    assert offsets.lateral_m[-1] == pytest.approx(0.0, abs=1e-6)
    near = np.where(track.x_m > 3.5, 5.25, 1.75) - track.x_m
    clear = np.abs(track.x_m - 3.5) > 0.2
    assert offsets.offset_m[clear] == pytest.approx(near[clear])
    late = offsets.select(track.y_m > -60.0)
    assert late.lateral_m == pytest.approx(5.25 - track.x_m[track.y_m > -60.0])
    assert len(late.offset_m) == len(late.lateral_m)


def test_ways_are_measured_from_the_first_state() -> None:
    """It begins 0.5 m to the left of the left lane's middle, and changes to the right lane's."""
    changes = line((1.25, -120.0), (1.25, -90.0), (5.25, -60.0), (5.25, -30.0))
    record = record_of(arc((1.0, 10.0)), {CAR: Driven(changes, arc((8.0, 10.0)))})
    offsets = lane_offsets(record, record.track(CAR))
    assert offsets.offset_m[[0, -1]] == pytest.approx([0.5, 0.0], abs=1e-6)
    assert offsets.lateral_m[[0, -1]] == pytest.approx([0.0, -4.0], abs=1e-6)


def test_a_change_with_the_second_state() -> None:
    """The lanes meet at 3.5 m."""
    record = record_of(arc((1.0, 10.0)), {CAR: Driven(line((3.502, -120.0), (1.75, -90.0)), arc((2.0, 10.0)))})
    track = record.track(CAR)
    assert track.x_m[0] > 3.5 > track.x_m[1]
    offsets = lane_offsets(record, track)
    assert offsets.lateral_m == pytest.approx(3.502 - track.x_m)
    assert offsets.offset_m[[0, 1]] == pytest.approx([5.25 - track.x_m[0], 1.75 - track.x_m[1]])
