from collections.abc import Callable

import numpy as np
import pytest
from hand_made_record import CAR_LENGTH_M, EMV_LENGTH_M, Driven
from made_encounters import CAR, IN_LANE, arc, blocking, passing, record_of

from siren_ros.evaluation.yielding.emv_line import EmvLine
from siren_ros.evaluation.yielding.encounters import Encounter, encounters_of
from siren_ros.evaluation.yielding.marks import driver as marks
from siren_ros.evaluation.yielding.measure import Measure
from siren_ros.evaluation.yielding.thresholds import YieldThresholds
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import EpisodeRecord

LIMITS = YieldThresholds()
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
