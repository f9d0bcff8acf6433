from collections.abc import Callable

import numpy as np
import pytest
from hand_made_record import CAR_LENGTH_M, EMV_LENGTH_M, Driven, line
from made_encounters import CAR, IN_LANE, arc, blocking, passing, record_of

from siren_ros.evaluation.yielding.emv_line import EmvLine
from siren_ros.evaluation.yielding.encounters import Encounter, encounters_of
from siren_ros.evaluation.yielding.marks import driver as marks
from siren_ros.evaluation.yielding.measure import Measure
from siren_ros.evaluation.yielding.thresholds import YieldThresholds
from siren_ros.numerics.arrays import Points
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import EpisodeRecord

LIMITS = YieldThresholds()
LEFT_OF_IT = IN_LANE - np.array([3.5, 0.0])
BODIES_M = 0.5 * (EMV_LENGTH_M + CAR_LENGTH_M)


def only(record: EpisodeRecord) -> Encounter:
    line = EmvLine.of(record)
    assert line is not None
    (encounter,) = encounters_of(record, line, LIMITS)
    assert encounter.actor_id == CAR
    return encounter


def test_an_encounter_begins_at_forty_metres() -> None:
    one = only(passing())
    # 46 m between the centres, 41 m between the bodies, and 5 m/s of closing speed.
    assert one.driver.track.time_s[0] == pytest.approx((46.0 - BODIES_M - 40.0) / 5.0, abs=0.05)
    assert one.was_in_the_way
    assert one.with_siren


def test_the_driver_responds_clears_and_is_passed() -> None:
    one = only(passing())
    # The path bends 60 m after its start: 0.3 m aside after 0.3/2.6 of the 10.3 m across, at 5 m/s.
    began_s = one.driver.track.time_s[0]
    bend_s = (60.0 - 46.0) / 5.0
    bent_m = (10.0**2 + 2.6**2) ** 0.5
    assert marks.response_time_s(one, LIMITS).value == pytest.approx(
        bend_s + 0.3 / 2.6 * bent_m / 5.0 - began_s, abs=0.1
    )
    cleared = marks.clearance_time_s(one)
    assert bend_s + bent_m / 5.0 - began_s - 1.0 < cleared.value < bend_s + bent_m / 5.0 - began_s + 0.5
    assert marks.complied(one, LIMITS) == Measure(1.0)
    assert marks.made_way_m(one).value == pytest.approx(2.6, abs=0.01)
    assert marks.passing_gap_m(one).value == pytest.approx(2.6 - 0.5 * (2.1 + 1.8), abs=0.02)
    assert marks.held_up_s(one, LIMITS).value == 0.0


def test_the_driver_recovers_when_it_is_back_in_its_lane() -> None:
    one = only(passing())
    recovery = marks.recovery_time_s(one, LIMITS)
    passed_s = one.driver.track.time_s[one.passed_row]
    # On the way back 0.5 m from the centre line: 2.1/2.6 of the bend, which begins 100.33 m after the start.
    bent_m = (10.0**2 + 2.6**2) ** 0.5
    back_s = (60.0 + bent_m + 30.0 + 2.1 / 2.6 * bent_m - 46.0) / 5.0
    assert not recovery.at_least
    assert recovery.value == pytest.approx(back_s - passed_s, abs=0.15)
    rows = round(recovery.value / STEP_S)
    disturbed = marks.disturbed_rows(one, LIMITS)[one.passed_row :]
    assert disturbed[rows - 1]
    assert not disturbed[rows:].any()


def test_a_driver_that_stays_holds_the_emv_up() -> None:
    one = only(blocking())
    assert marks.response_time_s(one, LIMITS).lack == "the driver did not respond"
    assert marks.complied(one, LIMITS) == Measure(0.0)
    assert marks.clearance_time_s(one).at_least
    assert marks.held_up_s(one, LIMITS).value == pytest.approx(6.0, abs=0.1)
    assert marks.passing_gap_m(one).lack
    assert marks.recovery_time_s(one, LIMITS).lack


def in_front(pieces: list[tuple[float, float]], way: Points = IN_LANE, emv_mps: float = 10.0) -> Encounter:
    """A driver 25 m ahead of the EMV from the start."""
    return only(record_of(arc((emv_mps, 10.0)), {CAR: Driven(way, arc(*pieces, start_m=30.0))}))


def test_braking_is_a_response_and_a_little_less_speed_is_none() -> None:
    braking = in_front([(8.0, 2.0), (6.4, 8.0)])
    assert marks.response_time_s(braking, LIMITS) == Measure(pytest.approx(2.0, abs=0.06))
    assert marks.response_time_s(in_front([(8.0, 2.0), (6.6, 8.0)]), LIMITS).lack == "the driver did not respond"
    assert marks.response_time_s(in_front([(8.0, 2.0), (12.0, 8.0)]), LIMITS).lack == "the driver did not respond"


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_shift_to_either_side_is_a_response(side: float) -> None:
    """At 8 m/s over 16 m by 1.6 m: 0.3 m aside after 3 m."""
    bends = line((5.25, -120.0), (5.25, -74.0), (5.25 + 1.6 * side, -58.0), (5.25 + 1.6 * side, 110.0))
    one = in_front([(8.0, 10.0)], bends)
    assert marks.response_time_s(one, LIMITS).value == pytest.approx((16.0 + 3.0) / 8.0, abs=0.06)
    assert marks.made_way_m(one).value == pytest.approx(1.6, abs=0.01)


def test_who_comes_back_into_the_way_has_not_cleared_it() -> None:
    """Leaves the strip, comes back ahead of the EMV and stays: the last clearing counts, and there is none."""
    returns = line((5.25, -120.0), (5.25, -85.0), (7.85, -75.0), (7.85, -65.0), (5.25, -55.0), (5.25, 110.0))
    one = in_front([(8.0, 10.0)], returns, emv_mps=9.0)
    assert not one.in_the_way.all()
    assert marks.clearance_time_s(one) == Measure((len(one.gap_m) - 1) * STEP_S, at_least=True)
    assert marks.complied(one, LIMITS).lack == "the EMV did not come up to the driver"


def test_clear_too_late_is_no_compliance() -> None:
    """Turns aside when the EMV has come up to 5 m, or before."""
    for turns_at_m, expected in ((44.0, 0.0), (31.0, 1.0)):
        aside = line((5.25, -120.0), (5.25, -120.0 + turns_at_m), (8.25, -110.0 + turns_at_m), (8.25, 110.0))
        one = in_front([(4.0, 10.0)], aside)
        close = int(np.argmax(one.gap_m <= 5.0))
        assert one.in_the_way[close] == (expected == 0.0)
        assert marks.complied(one, LIMITS) == Measure(expected)


def test_held_up_only_close_behind_slowly_and_in_the_way() -> None:
    def held_s(gap_m: float, emv_mps: float, aside_m: float = 0.0) -> float:
        way = IN_LANE - np.array([aside_m, 0.0])
        cars = {CAR: Driven(way, arc((emv_mps, 5.0), start_m=20.0 + BODIES_M + gap_m))}
        record = record_of(arc((emv_mps, 5.0), start_m=20.0), cars)
        return marks.held_up_s(only(record), LIMITS).value

    assert held_s(9.9, 1.9) == pytest.approx(5.05, abs=0.051)
    assert held_s(10.1, 1.9) == 0.0
    assert held_s(9.9, 2.1) == 0.0
    assert held_s(9.9, 1.9, aside_m=2.5) == 0.0


def test_only_the_way_made_before_the_passing_counts() -> None:
    """A car at 2 m/s goes 0.5 m aside before it is passed, and another 2 m later."""
    later = line((5.25, -120.0), (5.25, -88.0), (7.75, -84.0), (7.75, -70.0), (8.25, -66.0), (8.25, 110.0))
    one = only(record_of(arc((10.0, 30.0)), {CAR: Driven(later, arc((2.0, 30.0), start_m=30.0))}))
    assert one.passed_row > 0
    assert marks.made_way_m(one).value == pytest.approx(2.5, abs=0.01)
    assert np.abs(one.offsets.lateral_m).max() == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize(("offset_m", "disturbed"), [(0.45, False), (-0.45, False), (0.55, True), (-0.55, True)])
def test_back_in_the_lane_is_half_a_metre_on_either_side(offset_m: float, *, disturbed: bool) -> None:
    way = LEFT_OF_IT - np.array([offset_m, 0.0])
    one = only(record_of(arc((10.0, 10.0)), {CAR: Driven(way, arc((5.0, 10.0), start_m=30.0))}))
    assert marks.disturbed_rows(one, LIMITS).all() == disturbed
    recovery = marks.recovery_time_s(one, LIMITS)
    assert recovery == Measure((len(one.gap_m) - 1 - one.passed_row) * STEP_S if disturbed else 0.0, "", disturbed)


@pytest.mark.parametrize(("after_mps", "disturbed"), [(4.1, False), (3.9, True)])
def test_back_at_speed_is_four_fifths(after_mps: float, *, disturbed: bool) -> None:
    one = only(record_of(arc((10.0, 10.0)), {CAR: Driven(LEFT_OF_IT, arc((5.0, 2.0), (after_mps, 8.0), start_m=30.0))}))
    assert marks.disturbed_rows(one, LIMITS)[-1] == disturbed


@pytest.mark.parametrize(
    "mark",
    [
        lambda one: marks.response_time_s(one, LIMITS),
        marks.clearance_time_s,
        lambda one: marks.complied(one, LIMITS),
    ],
)
def test_nothing_is_asked_without_a_siren(mark: Callable[[Encounter], Measure]) -> None:
    assert mark(only(passing(siren=False))).lack == "no siren sounded"


def test_a_driver_in_the_next_lane_is_met_but_not_in_the_way() -> None:
    left = IN_LANE - np.array([3.5, 0.0])
    one = only(record_of(arc((10.0, 10.0)), {CAR: Driven(left, arc((2.0, 10.0), start_m=40.0))}))
    assert not one.was_in_the_way
    assert marks.response_time_s(one, LIMITS).lack == "the driver was not in the EMV's way"
    assert marks.passing_gap_m(one).value == pytest.approx(3.5 - 1.95, abs=0.01)


def test_oncoming_and_far_away_drivers_are_not_met() -> None:
    oncoming = Driven(IN_LANE[::-1] - np.array([7.0, 0.0]), arc((10.0, 10.0)))
    far = Driven(IN_LANE, arc((10.0, 10.0), start_m=90.0))
    record = record_of(arc((10.0, 10.0)), {CAR: oncoming, CAR + 1: far})
    line = EmvLine.of(record)
    assert line is not None
    assert list(encounters_of(record, line, LIMITS)) == []


def test_the_way_is_clear_from_the_first_step_out_of_the_strip() -> None:
    one = only(passing())
    out = int(np.argmin(one.in_the_way))
    assert one.in_the_way[:out].all()
    assert not one.in_the_way[out : one.passed_row].any()
    assert marks.clearance_time_s(one) == Measure(out * STEP_S)
