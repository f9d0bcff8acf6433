from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, NORTHBOUND, Driven, crossing, hand_made
from made_encounters import arc, record_of

from siren_ros.evaluation.yielding.emv_line import EmvLine
from siren_ros.evaluation.yielding.marks import emv as emv_marks
from siren_ros.evaluation.yielding.measure import Measure
from siren_ros.evaluation.yielding.thresholds import YieldThresholds
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.actors import Mode

LIMITS = YieldThresholds()


def line_of(record: EpisodeRecord) -> EmvLine:
    found = EmvLine.of(record)
    assert found is not None
    return found


def with_target(record: EpisodeRecord, speed_mps: float) -> EpisodeRecord:
    parameters = {"template": {"emv.speed_mps": speed_mps}}
    return replace(record, description=replace(record.description, parameters=parameters))


def test_an_emv_at_its_target_speed_loses_nothing() -> None:
    record = with_target(record_of(arc((10.0, 12.0)), {}), 10.0)
    assert emv_marks.emv_delay_s(record, line_of(record), LIMITS).value == pytest.approx(0.0, abs=1e-6)


def test_the_delay_is_the_time_lost_against_the_target_speed() -> None:
    record = with_target(record_of(arc((10.0, 6.0), (0.0, 3.0), (5.0, 4.0)), {}), 10.0)
    assert emv_marks.emv_delay_s(record, line_of(record), LIMITS).value == pytest.approx(3.0 + 2.0, abs=0.1)


def test_turns_are_free_flow_at_the_speed_of_the_turn() -> None:
    record = with_target(record_of(arc((10.0, 20.0)), {}), 20.0)
    free = emv_marks.free_speed_mps(record)
    on_junction = (record.track(EMV).y_m > -19.5) & (record.track(EMV).y_m < 9.5)
    assert set(np.unique(free[on_junction])) == {13.9}
    assert set(np.unique(free[record.track(EMV).y_m < -21.0])) == {20.0}


def test_creeping_up_is_no_second_stop() -> None:
    record = record_of(arc((10.0, 3.0), (0.0, 2.0), (1.0, 3.0), (0.0, 2.0), (8.0, 2.0), (0.0, 1.0)), {})
    assert emv_marks.emv_stops(record, line_of(record), LIMITS) == Measure(2.0)
    assert emv_marks.emv_standstill_s(record, line_of(record), LIMITS).value == pytest.approx(5.0, abs=0.15)


def test_time_in_gap_escape() -> None:
    steps = arc((10.0, 10.0))
    mode = np.where(np.arange(len(steps)) < 50, Mode.GAP_ESCAPE, Mode.ROUTE_FOLLOW).astype(np.uint8)
    record = hand_made(crossing(), {EMV: Driven(NORTHBOUND, steps, mode)})
    assert emv_marks.emv_gap_escape_s(record, line_of(record), LIMITS) == Measure(2.5)


def test_the_site_is_reached_or_not() -> None:
    record = record_of(arc((10.0, 20.0)), {})
    site = {"junction": "J"}
    there = replace(record, description=replace(record.description, site=site))
    assert emv_marks.site_time_s(there, line_of(there), LIMITS).value == pytest.approx(11.5, abs=0.05)
    short = record_of(arc((10.0, 5.0)), {})
    short = replace(short, description=replace(short.description, site=site))
    assert emv_marks.site_time_s(short, line_of(short), LIMITS).at_least
    assert emv_marks.site_time_s(record, line_of(record), LIMITS).lack


def test_an_emv_that_stands_has_no_line() -> None:
    assert EmvLine.of(record_of(arc((0.0, 3.0)), {})) is None


@pytest.mark.parametrize(("time_s", "at_least"), [(9.5, True), (11.45, True), (11.6, False)])
def test_a_site_that_the_emv_still_comes_nearer_to_is_not_passed(time_s: float, *, at_least: bool) -> None:
    """The middle of its site is 115 m after the start; 9.5 s after it, it is 20 m away."""
    record = record_of(arc((10.0, time_s)), {})
    record = replace(record, description=replace(record.description, site={"junction": "J"}))
    found = emv_marks.site_time_s(record, line_of(record), LIMITS)
    assert found.at_least is at_least
    assert found.value == pytest.approx(time_s + 0.05 if at_least else 11.5, abs=0.051)


def test_an_emv_that_stops_behind_its_site_has_passed_it() -> None:
    """It stands 10 m behind the middle until the end, and its time is that at the middle."""
    record = record_of(arc((10.0, 12.5), (0.0, 5.0)), {})
    record = replace(record, description=replace(record.description, site={"junction": "J"}))
    assert emv_marks.site_time_s(record, line_of(record), LIMITS) == Measure(pytest.approx(11.5, abs=0.051))


@pytest.mark.parametrize(("speed_mps", "stops"), [(0.49, 1.0), (0.51, 0.0)])
def test_a_stop_is_slower_than_half_a_metre_a_second(speed_mps: float, stops: float) -> None:
    record = record_of(arc((10.0, 3.0), (speed_mps, 2.0)), {})
    assert emv_marks.emv_stops(record, line_of(record), LIMITS) == Measure(stops)
    standing = emv_marks.emv_standstill_s(record, line_of(record), LIMITS).value
    assert standing == pytest.approx(2.0 * stops, abs=0.051)


@pytest.mark.parametrize(("again_mps", "stops"), [(1.9, 1.0), (2.1, 2.0)])
def test_who_moves_faster_than_two_metres_a_second_stops_again(again_mps: float, stops: float) -> None:
    record = record_of(arc((10.0, 3.0), (0.0, 1.0), (again_mps, 2.0), (0.0, 1.0)), {})
    assert emv_marks.emv_stops(record, line_of(record), LIMITS) == Measure(stops)


def test_who_stands_from_the_start_has_not_stopped() -> None:
    record = record_of(arc((0.0, 2.0), (10.0, 3.0)), {})
    assert emv_marks.emv_stops(record, line_of(record), LIMITS) == Measure(0.0)
    assert emv_marks.emv_standstill_s(record, line_of(record), LIMITS).value == pytest.approx(2.0, abs=0.06)
