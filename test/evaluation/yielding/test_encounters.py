from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, Driven, line
from made_encounters import CAR, IN_LANE, arc, encounters_in, record_of

from siren_ros.evaluation.yielding.encounters import lane_offsets
from siren_ros.world.actors import Lights

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


BODIES_M = 5.0
"""Half of the EMV's 6 m and half of the car's 4 m."""


def standing(aside_m: float, at_m: float = 60.0, time_s: float = 12.0) -> Driven:
    """A car that stands to the left of the EMV's line."""
    return Driven(IN_LANE - np.array([aside_m, 0.0]), arc((0.0, time_s), start_m=at_m))


@pytest.mark.parametrize(("aside_m", "met"), [(6.9, True), (-6.9, True), (7.1, False), (-7.1, False)])
def test_two_lanes_aside_is_too_far(aside_m: float, *, met: bool) -> None:
    assert bool(encounters_in(record_of(arc((10.0, 12.0)), {CAR: standing(aside_m)}))) is met


def test_rows_from_forty_metres_until_the_passing() -> None:
    """The EMV's centre is at 0.5 m for each step; the car's at 60 m."""
    (one,) = encounters_in(record_of(arc((10.0, 12.0)), {CAR: standing(3.0)}))
    assert one.driver.track.step[0] == (60 - 40 - BODIES_M) / 0.5
    assert one.gap_m[0] == pytest.approx(40.0)
    assert np.diff(one.gap_m) == pytest.approx(np.full(len(one.gap_m) - 1, -0.5))
    # Passed when the EMV's centre is more than 5 m ahead.
    assert one.driver.track.step[one.passed_row] == (60 + BODIES_M) / 0.5 + 1
    assert one.until_passed == slice(0, one.passed_row)
    assert len(one.emv.track) == len(one.gap_m) == len(one.in_the_way) == len(one.offsets.lateral_m)


def test_until_the_end_where_nobody_passes() -> None:
    (one,) = encounters_in(record_of(arc((10.0, 6.0)), {CAR: standing(3.0, time_s=6.0)}))
    assert one.passed_row == -1
    assert one.until_passed == slice(0, None)


@pytest.mark.parametrize(("aside_m", "inside"), [(1.9, True), (-1.9, True), (2.0, False), (-2.0, False)])
def test_the_strip_is_as_wide_as_the_emv(aside_m: float, *, inside: bool) -> None:
    """1.05 m of the EMV and 0.9 m of the car."""
    (one,) = encounters_in(record_of(arc((10.0, 12.0)), {CAR: standing(aside_m)}))
    assert one.was_in_the_way is inside
    assert one.in_the_way.all() == inside


@pytest.mark.parametrize(("at_m", "inside"), [(19.9 + 40.0, True), (20.1 + 40.0, False)])
def test_the_strip_goes_on_fifteen_metres_beyond_the_emv(at_m: float, *, inside: bool) -> None:
    """The EMV's record ends at 40 m, its front at 43 m; the car's rear is 2 m behind its centre."""
    (one,) = encounters_in(record_of(arc((10.0, 4.0)), {CAR: standing(0.0, at_m=at_m, time_s=4.0)}))
    assert one.was_in_the_way is inside


@pytest.mark.parametrize("first_step", [0, 60])
def test_the_siren_counts_as_the_encounter_begins(first_step: int) -> None:
    """It begins at step 30; the siren sounds from a step on."""
    record = record_of(arc((10.0, 12.0)), {CAR: standing(0.0)}, siren=False)
    states = []
    for state in record.states:
        on = (state.actor_id == EMV) & (state.step >= first_step)
        lights = np.where(on, int(Lights.SIREN | Lights.BEACON), int(Lights.BRAKE)).astype(np.uint8)
        states.append(replace(state, lights=lights))
    (one,) = encounters_in(replace(record, states=tuple(states)))
    assert one.with_siren is (first_step == 0)


def test_a_car_that_comes_from_behind_is_not_met() -> None:
    """It overtakes the EMV within 40 m: from then on it is ahead, and the encounter begins there."""
    overtakes = Driven(line((1.75, -120.0), (1.75, 110.0)), arc((20.0, 9.0), start_m=0.0))
    (one,) = encounters_in(record_of(arc((5.0, 9.0)) + 20.0, {CAR: overtakes}))
    # 20 + 5 t + 5 = 20 t
    assert one.driver.track.time_s[0] == pytest.approx(25.0 / 15.0, abs=0.051)
    assert one.passed_row == -1


def test_a_car_that_is_gone_before_the_emv_comes_is_not_met() -> None:
    record = record_of(arc((10.0, 3.0)), {CAR: Driven(IN_LANE, arc((0.0, 2.0), start_m=50.0), first_step=100)})
    assert encounters_in(record) == []


def test_each_driver_once_and_no_emv() -> None:
    record = record_of(arc((10.0, 12.0)), {CAR: standing(3.0), CAR + 1: standing(0.0, at_m=90.0)})
    assert [one.actor_id for one in encounters_in(record)] == [CAR, CAR + 1]
