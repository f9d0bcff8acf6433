"""The wake behind the EMV, the civilians' lost time, and the least of the safety measures."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, Driven, line
from made_encounters import CAR, IN_LANE, PULLS_RIGHT, arc, record_of

from siren_ros.evaluation.surrogate_safety.conflict_measures import Extreme, PairMeasures
from siren_ros.evaluation.surrogate_safety.post_encroachment import Encroachment
from siren_ros.evaluation.yielding.emv_line import EmvLine
from siren_ros.evaluation.yielding.encounters import Encounter, encounters_of
from siren_ros.evaluation.yielding.marks import safety
from siren_ros.evaluation.yielding.marks.civilians import civilian_delay_s
from siren_ros.evaluation.yielding.marks.driver import recovery_time_s
from siren_ros.evaluation.yielding.marks.wake import wake_duration_s, wake_length_m
from siren_ros.evaluation.yielding.measure import Measure
from siren_ros.evaluation.yielding.thresholds import YieldThresholds
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.events import Event, EventKind

LIMITS = YieldThresholds()
LEFT_LANE = IN_LANE - np.array([3.5, 0.0])


def met(record: EpisodeRecord) -> list[Encounter]:
    found = EmvLine.of(record)
    assert found is not None
    return list(encounters_of(record, found, LIMITS))


def stops_and_goes(start_m: float, stands_s: float) -> Driven:
    """A car in the left lane at 5 m/s that stands for a while from 5 s on."""
    return Driven(LEFT_LANE, arc((5.0, 5.0), (0.0, stands_s), (5.0, 15.0 - stands_s), start_m=start_m))


def test_the_wake_is_that_of_the_driver_who_recovers_last() -> None:
    """Both stand from 5 s on, 4 s and 7 s long; the EMV passes them at about 8 s and 6 s."""
    record = record_of(arc((10.0, 20.0)), {CAR: stops_and_goes(50.0, 4.0), CAR + 1: stops_and_goes(30.0, 7.0)})
    first, second = met(record)
    times = [recovery_time_s(one, LIMITS).value for one in (first, second)]
    # 75 and 55 m and 5 m between the centres of two bodies; the cars go on at 9 s and at 12 s.
    assert times == pytest.approx([9.0 - 8.0, 12.0 - 6.0], abs=0.11)
    assert wake_duration_s((first, second), LIMITS) == Measure(times[1])
    assert wake_duration_s((second, first), LIMITS) == Measure(times[1])
    # At 12 s the EMV is at 120 m, the second car still at 55 m, the first one no longer disturbed.
    assert wake_length_m((first, second), LIMITS).value == pytest.approx(120.0 - 55.0, abs=0.6)
    assert wake_length_m((first,), LIMITS).value == pytest.approx(90.0 - 75.0, abs=0.6)


def test_one_driver_who_has_not_recovered_makes_the_wake_a_lower_bound() -> None:
    """The first stands until the end, which is 2 s after its passing; the second recovers 6 s after its own."""
    cars = {CAR: Driven(LEFT_LANE, arc((0.0, 13.0), start_m=105.0)), CAR + 1: stops_and_goes(30.0, 7.0)}
    first, second = met(record_of(arc((10.0, 13.0)), cars))
    assert not recovery_time_s(second, LIMITS).at_least
    standing = replace(first, driver=replace(first.driver, track=with_first_speed(first)))
    assert recovery_time_s(standing, LIMITS).at_least
    found = wake_duration_s((standing, second), LIMITS)
    assert found.at_least
    assert found.value == recovery_time_s(second, LIMITS).value


def with_first_speed(encounter: Encounter) -> object:
    """The track of a driver who drove at 10 m/s as the encounter began."""
    track = encounter.driver.track
    vy = track.vy_mps.copy()
    vy[0] = 10.0
    return replace(track, vy_mps=vy)


def test_a_driver_who_is_not_passed_leaves_no_wake() -> None:
    passed, ahead = met(
        record_of(
            arc((10.0, 12.0)),
            {CAR: Driven(PULLS_RIGHT, arc((5.0, 12.0), start_m=46.0)), CAR + 1: stops_and_goes(100.0, 6.0)},
        )
    )
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


def test_nobody_on_a_lane_loses_time() -> None:
    record = record_of(arc((10.0, 1.0)), {CAR: Driven(IN_LANE, arc((5.0, 1.0)))})
    assert civilian_delay_s(record).lack == "nobody was on a lane"
    assert civilian_delay_s(replace(record, states=(), traffic=())).lack == "the record has no step"


def pair(ttc_s: float | None, pet_s: float | None, gap_m: float) -> PairMeasures:
    return PairMeasures(
        5,
        None if ttc_s is None else Extreme(ttc_s, 1),
        None,
        None if pet_s is None else Encroachment(pet_s, 1, subject_first=True),
        Extreme(gap_m, 1),
    )


def test_the_least_of_all_pairs_that_have_a_value() -> None:
    pairs = [pair(2.0, None, 5.0), pair(None, 3.0, -0.2), pair(1.5, 1.2, 7.0)]
    assert safety.min_ttc_s(pairs) == Measure(1.5)
    assert safety.min_pet_s(pairs) == Measure(1.2)
    assert safety.min_gap_m(pairs) == Measure(-0.2)
    assert safety.min_ttc_s([pair(None, None, 1.0)]).lack == "no contact was ahead within 3 s"
    assert safety.min_pet_s([pair(None, None, 1.0)]).lack
    assert safety.min_gap_m([]).lack


def test_collisions_of_everybody_and_of_one() -> None:
    events = (
        Event(3, EventKind.COLLISION, EMV, CAR),
        Event(4, EventKind.COLLISION, CAR + 1, CAR),
        Event(5, EventKind.SIREN_ON, CAR),
    )
    record = replace(record_of(arc((10.0, 1.0)), {}), events=events)
    assert safety.collisions(record) == Measure(2.0)
    assert [safety.collisions(record, key).value for key in (EMV, CAR, CAR + 1, CAR + 2)] == [1.0, 2.0, 1.0, 0.0]
