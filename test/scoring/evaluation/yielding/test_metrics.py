"""The yield metrics of records made by hand."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hand_made_record import CAR_LENGTH_M, EMV, EMV_LENGTH_M, NORTHBOUND, Driven, crossing, hand_made, line
from made_encounters import CAR, IN_LANE, PULLS_RIGHT, arc, blocking, encounters_in, line_of, passing, record_of

from siren_ros.base.numerics.arrays import Points
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.tables import Measure
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.evaluation.yielding import metrics as marks
from siren_ros.scoring.evaluation.yielding.encounters import Encounter, YieldThresholds
from siren_ros.scoring.evaluation.yielding.metrics import (
    civilian_delay_s,
    recovery_time_s,
    wake_duration_s,
    wake_length_m,
)
from siren_ros.scoring.judging.surrogate_safety import Encroachment, Extreme, PairMeasures
from siren_ros.simulation.world.actors import ActorClass, Event, EventKind, Mode

LIMITS = YieldThresholds()
LEFT_OF_IT = IN_LANE - np.array([3.5, 0.0])
BODIES_M = 0.5 * (EMV_LENGTH_M + CAR_LENGTH_M)


def only(record: EpisodeRecord) -> Encounter:
    (encounter,) = encounters_in(record)
    assert encounter.actor_id == CAR
    return encounter


def test_a_driver_that_stays_holds_the_emv_up() -> None:
    one = only(blocking())
    assert marks.response_time_s(one, LIMITS).lack == "the driver did not respond"
    assert marks.complied(one, LIMITS) == Measure(0.0)
    assert marks.clearance_time_s(one, LIMITS).at_least
    assert marks.held_up_s(one, LIMITS).value == pytest.approx(6.0, abs=0.1)
    assert marks.passing_gap_m(one, LIMITS).lack
    assert marks.recovery_time_s(one, LIMITS).lack


def in_front(pieces: list[tuple[float, float]], way: Points = IN_LANE, emv_mps: float = 10.0) -> Encounter:
    """A driver whose centre is 30 m ahead of the EMV's from the start, for ten seconds."""
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
    assert marks.made_way_m(one, LIMITS).value == pytest.approx(1.6, abs=0.01)


def test_who_comes_back_into_the_way_has_not_cleared_it() -> None:
    """Leaves the strip, comes back ahead of the EMV and stays: the last clearing counts, and there is none."""
    returns = line((5.25, -120.0), (5.25, -85.0), (7.85, -75.0), (7.85, -65.0), (5.25, -55.0), (5.25, 110.0))
    one = in_front([(8.0, 10.0)], returns, emv_mps=9.0)
    assert not one.in_the_way.all()
    assert marks.clearance_time_s(one, LIMITS) == Measure((len(one.gap_m) - 1) * STEP_S, at_least=True)
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
    assert marks.made_way_m(one, LIMITS).value == pytest.approx(2.5, abs=0.01)
    assert np.abs(one.offsets.lateral_m).max() == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize(("offset_m", "disturbed"), [(0.45, False), (-0.45, False), (0.55, True), (-0.55, True)])
def test_back_in_the_lane_is_half_a_metre_on_either_side(offset_m: float, *, disturbed: bool) -> None:
    one = in_front([(5.0, 10.0)], LEFT_OF_IT - np.array([offset_m, 0.0]))
    assert marks.disturbed_rows(one, LIMITS).all() == disturbed
    recovery = marks.recovery_time_s(one, LIMITS)
    assert recovery == Measure((len(one.gap_m) - 1 - one.passed_row) * STEP_S if disturbed else 0.0, "", disturbed)


@pytest.mark.parametrize(("after_mps", "disturbed"), [(4.1, False), (3.9, True)])
def test_back_at_speed_is_four_fifths(after_mps: float, *, disturbed: bool) -> None:
    one = in_front([(5.0, 2.0), (after_mps, 8.0)], LEFT_OF_IT)
    assert marks.disturbed_rows(one, LIMITS)[-1] == disturbed


@pytest.mark.parametrize("mark", [marks.response_time_s, marks.clearance_time_s, marks.complied])
def test_nothing_is_asked_without_a_siren(mark: Callable[[Encounter, YieldThresholds], Measure]) -> None:
    assert mark(only(passing(siren=False)), LIMITS).lack == "no siren sounded"


def test_who_is_met_is_not_always_in_the_way() -> None:
    """A driver in the next lane is met; an oncoming one and one that is far away are not."""
    one = only(record_of(arc((10.0, 10.0)), {CAR: Driven(LEFT_OF_IT, arc((2.0, 10.0), start_m=40.0))}))
    assert not one.was_in_the_way
    assert marks.response_time_s(one, LIMITS).lack == "the driver was not in the EMV's way"
    assert marks.passing_gap_m(one, LIMITS).value == pytest.approx(3.5 - 1.95, abs=0.01)
    oncoming = Driven(IN_LANE[::-1] - np.array([7.0, 0.0]), arc((10.0, 10.0)))
    far = Driven(IN_LANE, arc((10.0, 10.0), start_m=90.0))
    assert encounters_in(record_of(arc((10.0, 10.0)), {CAR: oncoming, CAR + 1: far})) == []


def described(record: EpisodeRecord, **values: Any) -> EpisodeRecord:
    return replace(record, description=replace(record.description, **values))


def with_target(record: EpisodeRecord, speed_mps: float) -> EpisodeRecord:
    return described(record, parameters={"template": {"emv.speed_mps": speed_mps}})


def site_time(record: EpisodeRecord) -> Measure:
    return marks.site_time_s(record, line_of(record), LIMITS)


@pytest.mark.parametrize(
    ("pieces", "lost_s"), [([(10.0, 12.0)], 0.0), ([(10.0, 6.0), (0.0, 3.0), (5.0, 4.0)], 3.0 + 2.0)]
)
def test_the_delay_is_the_time_lost_against_the_target_speed(pieces: list[tuple[float, float]], lost_s: float) -> None:
    record = with_target(record_of(arc(*pieces), {}), 10.0)
    assert marks.emv_delay_s(record, line_of(record), LIMITS).value == pytest.approx(
        lost_s, abs=0.1 if lost_s else 1e-6
    )


def test_turns_are_free_flow_at_the_speed_of_the_turn() -> None:
    record = with_target(record_of(arc((10.0, 20.0)), {}), 20.0)
    free = marks.free_speed_mps(record)
    on_junction = (record.track(EMV).y_m > -19.5) & (record.track(EMV).y_m < 9.5)
    assert set(np.unique(free[on_junction])) == {13.9}
    assert set(np.unique(free[record.track(EMV).y_m < -21.0])) == {20.0}


@pytest.mark.parametrize(
    ("pieces", "stops", "stands_s"),
    [
        ([(10.0, 3.0), (0.0, 2.0), (1.0, 3.0), (0.0, 2.0), (8.0, 2.0), (0.0, 1.0)], 2.0, 5.0),
        ([(10.0, 3.0), (0.49, 2.0)], 1.0, 2.0),
        ([(10.0, 3.0), (0.51, 2.0)], 0.0, 0.0),
        ([(10.0, 3.0), (0.0, 1.0), (1.9, 2.0), (0.0, 1.0)], 1.0, 2.0),
        ([(10.0, 3.0), (0.0, 1.0), (2.1, 2.0), (0.0, 1.0)], 2.0, 2.0),
        ([(0.0, 2.0), (10.0, 3.0)], 0.0, 2.0),
    ],
    ids=[
        "creeping up is no second stop",
        "slow",
        "not slow enough",
        "too slow to stop again",
        "again",
        "from the start",
    ],
)
def test_stops_and_the_time_of_standing(pieces: list[tuple[float, float]], stops: float, stands_s: float) -> None:
    """A stop is slower than 0.5 m/s, after more than 2 m/s."""
    record = record_of(arc(*pieces), {})
    assert marks.emv_stops(record, line_of(record), LIMITS) == Measure(stops)
    assert marks.emv_standstill_s(record, line_of(record), LIMITS).value == pytest.approx(stands_s, abs=0.11)


def test_time_in_gap_escape() -> None:
    steps = arc((10.0, 10.0))
    mode = np.where(np.arange(len(steps)) < 50, Mode.GAP_ESCAPE, Mode.ROUTE_FOLLOW).astype(np.uint8)
    record = hand_made(crossing(), {EMV: Driven(NORTHBOUND, steps, mode)})
    assert marks.emv_gap_escape_s(record, line_of(record), LIMITS) == Measure(2.5)


@pytest.mark.parametrize(
    ("pieces", "at_least"),
    [
        ([(10.0, 20.0)], False),
        ([(10.0, 5.0)], True),
        ([(10.0, 9.5)], True),
        ([(10.0, 11.45)], True),
        ([(10.0, 11.6)], False),
        ([(10.0, 12.5), (0.0, 5.0)], False),
    ],
)
def test_a_site_that_the_emv_still_comes_nearer_to_is_not_passed(
    pieces: list[tuple[float, float]], *, at_least: bool
) -> None:
    """The middle of its site is 115 m after the start. It may stand behind it: its time is that at the middle."""
    record = record_of(arc(*pieces), {})
    measured = site_time(described(record, site={"junction": "J"}))
    assert measured.at_least is at_least
    assert measured.value == pytest.approx(pieces[0][1] + 0.05 if at_least else 11.5, abs=0.051)
    assert site_time(record).lack, "without a site"


def stops_and_goes(start_m: float, stands_s: float) -> Driven:
    """A car in the left lane at 5 m/s that stands for a while from 5 s on."""
    return Driven(LEFT_OF_IT, arc((5.0, 5.0), (0.0, stands_s), (5.0, 15.0 - stands_s), start_m=start_m))


def test_the_wake_is_that_of_the_driver_who_recovers_last() -> None:
    """Both stand from 5 s on, 4 s and 7 s long; the EMV passes them at about 8 s and 6 s."""
    record = record_of(arc((10.0, 20.0)), {CAR: stops_and_goes(50.0, 4.0), CAR + 1: stops_and_goes(30.0, 7.0)})
    first, second = encounters_in(record)
    times = [recovery_time_s(one, LIMITS).value for one in (first, second)]
    # 75 and 55 m and 5 m between the centres of two bodies; the cars go on at 9 s and at 12 s.
    assert times == pytest.approx([9.0 - 8.0, 12.0 - 6.0], abs=0.11)
    assert wake_duration_s((first, second), LIMITS) == Measure(times[1])
    assert wake_duration_s((second, first), LIMITS) == Measure(times[1])
    # At 12 s the EMV is at 120 m, the second car still at 55 m, the first one no longer disturbed.
    assert wake_length_m((first, second), LIMITS).value == pytest.approx(120.0 - 55.0, abs=0.6)
    assert wake_length_m((first,), LIMITS).value == pytest.approx(90.0 - 75.0, abs=0.6)


def test_a_driver_who_is_not_passed_leaves_no_wake() -> None:
    cars = {CAR: Driven(PULLS_RIGHT, arc((5.0, 12.0), start_m=46.0)), CAR + 1: stops_and_goes(100.0, 6.0)}
    passed, ahead = encounters_in(record_of(arc((10.0, 12.0)), cars))
    assert ahead.passed_row == -1
    assert wake_duration_s((passed, ahead), LIMITS) == wake_duration_s((passed,), LIMITS)
    assert wake_length_m((passed, ahead), LIMITS) == wake_length_m((passed,), LIMITS)
    assert wake_length_m((ahead,), LIMITS).lack


def on_lanes(record: EpisodeRecord, lane_of: dict[int, int]) -> EpisodeRecord:
    """With SUMO's word on the vehicles' lanes."""
    ids = np.array(sorted(lane_of), dtype=np.uint32)
    lanes = np.array([lane_of[int(key)] for key in ids], dtype=np.int32)
    traffic = tuple(replace(state, actor_id=ids, lane=lanes) for state in record.traffic)
    return replace(record, traffic=traffic)


def test_civilians_lose_time_against_the_limit_of_their_lane() -> None:
    """At 13.9 m/s one at 5 m/s and one that stands, each for 3 s; the EMV and one who comes later do not count."""
    west = line((-110.0, -5.25), (120.0, -5.25))
    cars = {
        CAR: Driven(IN_LANE, arc((5.0, 2.95))),
        CAR + 1: Driven(west, arc((0.0, 2.95))),
        CAR + 2: Driven(IN_LANE, arc((0.0, 1.0), start_m=80.0), first_step=20),
        CAR + 3: Driven(west, arc((1.0, 2.95), start_m=50.0)),
    }
    record = on_lanes(record_of(arc((10.0, 2.95)), cars), {EMV: 1, CAR: 1, CAR + 1: 7, CAR + 2: 1, CAR + 3: -1})
    assert civilian_delay_s(record).value == pytest.approx(3.0 * (1.0 - 5.0 / 13.9) + 3.0)


def test_neither_people_nor_anybody_off_the_lanes_lose_time() -> None:
    record = record_of(arc((10.0, 1.0)), {CAR: Driven(IN_LANE, arc((5.0, 1.0)))})
    assert civilian_delay_s(record).lack == "nobody was on a lane"
    rides = replace(record.actors[CAR], actor_class=ActorClass.BICYCLE)
    on_lane = on_lanes(record, {EMV: 1, CAR: 1})
    assert civilian_delay_s(on_lane).valid
    assert not civilian_delay_s(replace(on_lane, actors={**record.actors, CAR: rides})).valid
    assert civilian_delay_s(replace(record, states=(), traffic=())).lack == "the record has no step"


def pair(ttc_s: float | None, pet_s: float | None, gap_m: float) -> PairMeasures:
    ttc = None if ttc_s is None else Extreme(ttc_s, 1)
    pet = None if pet_s is None else Encroachment(pet_s, 1, subject_first=True)
    return PairMeasures(5, ttc, None, pet, Extreme(gap_m, 1))


def test_the_least_of_all_pairs_that_have_a_value() -> None:
    pairs = [pair(2.0, None, 5.0), pair(None, 3.0, -0.2), pair(1.5, 1.2, 7.0)]
    assert marks.min_ttc_s(pairs) == Measure(1.5)
    assert marks.min_pet_s(pairs) == Measure(1.2)
    assert marks.min_gap_m(pairs) == Measure(-0.2)
    assert marks.min_ttc_s([pair(None, None, 1.0)]).lack == "no contact was ahead within 3 s"
    assert marks.min_pet_s([pair(None, None, 1.0)]).lack
    assert marks.min_gap_m([]).lack


def test_collisions_of_everybody_and_of_one() -> None:
    events = (
        Event(3, EventKind.COLLISION, EMV, CAR),
        Event(4, EventKind.COLLISION, CAR + 1, CAR),
        Event(5, EventKind.SIREN_ON, CAR),
    )
    record = replace(record_of(arc((10.0, 1.0)), {}), events=events)
    assert marks.collisions(record) == Measure(2.0)
    assert [marks.collisions(record, key).value for key in (EMV, CAR, CAR + 1, CAR + 2)] == [1.0, 2.0, 1.0, 0.0]
