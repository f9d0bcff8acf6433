"""Quantities of the ledger in records made by hand: closed-form distances, times and shares."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EASTBOUND, EMV, NORTHBOUND, Driven, crossing, hand_made
from made_encounters import CAR, IN_LANE, PULLS_RIGHT, arc, blocking, passing, record_of

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.evaluation.realism import quantities
from siren_ros.scoring.evaluation.realism.quantities import SAMPLES, RealismEpisode, RealismScene
from siren_ros.simulation.world.actors import Event, EventKind, SignalState


def samples(record: EpisodeRecord, name: str) -> np.ndarray:
    return SAMPLES[name](RealismScene(record))


def test_driver_who_pulls_aside_and_comes_back() -> None:
    record = passing()
    assert samples(record, "moved").tolist() == [1.0]
    (distance_m,) = samples(record, "lane_change_distance_m")
    scene = RealismScene(record)
    (one,) = scene.heard
    first = int(np.argmax(np.abs(one.offsets.lateral_m - one.offsets.lateral_m[0]) >= 0.3))
    assert distance_m == pytest.approx(float(one.gap_m[first]))
    assert 0.0 < distance_m < 40.0
    (behind_m,) = samples(record, "return_distance_m")
    assert 0.0 < behind_m < 30.0
    (hinder_s,) = samples(record, "hinder_time_s")
    assert 0.0 < hinder_s < 10.0


def test_without_a_siren_nobody_is_asked() -> None:
    record = passing(siren=False)
    for name in ("moved", "lane_change_distance_m", "response_distance_m", "hinder_time_s", "emv_contact"):
        assert len(samples(record, name)) == 0, name
    for name in ("lane_change_distance_m", "hinder_time_s"):
        assert len(samples(blocking(), name)) == 0, "who stays does not move, and blocks to an end that is not known"


def test_two_drivers_are_two_samples_in_both_orders() -> None:
    cars = {
        CAR: Driven(PULLS_RIGHT, arc((5.0, 30.0), start_m=46.0)),
        CAR + 1: Driven(IN_LANE, arc((9.0, 30.0), start_m=20.0)),
    }
    swapped = {CAR: cars[CAR + 1], CAR + 1: cars[CAR]}
    found = [
        sorted(samples(record_of(arc((10.0, 20.0)), one), "hardest_brake_mps2").tolist()) for one in (cars, swapped)
    ]
    assert found[0] == found[1]
    assert len(found[0]) == 2


def test_hard_braking_of_the_emv_is_a_situation() -> None:
    record = record_of(arc((10.0, 10.0)), {})
    assert samples(record, "time_per_situation_s") == pytest.approx([10.05], abs=0.1)
    assert samples(record, "time_in_situations").tolist() == [0.0]
    states = list(record.states)
    for step in (50, 60, 150):
        accel = states[step].accel_mps2.copy()
        accel[states[step].actor_id == EMV] = -5.0
        states[step] = replace(states[step], accel_mps2=accel)
    braked = replace(record, states=tuple(states))
    assert samples(braked, "time_per_situation_s") == pytest.approx([5.0, 5.0], abs=0.1)  # 50 and 60 are one
    assert samples(braked, "time_in_situations") == pytest.approx([12 / len(states)], abs=0.001)


def test_contacts_are_those_of_the_emv_and_those_in_its_wake() -> None:
    record = passing()
    pairs = ((CAR, 9), (EMV, CAR), (CAR, EMV), (7, 8))
    events = [Event(10, EventKind.COLLISION, first, second) for first, second in pairs]
    touched = replace(record, events=tuple(events))
    assert samples(touched, "emv_contact").tolist() == [1.0]
    assert samples(touched, "wake_share").tolist() == [1.0, 0.0, 0.0, 1.0]
    driven_km = RealismScene(record).line.driven_m / 1e3
    assert samples(touched, "emv_contact_per_km") == pytest.approx([2.0 / driven_km])
    assert samples(record, "emv_contact").tolist() == [0.0]


def test_ordinary_traffic_is_that_which_no_siren_is_near() -> None:
    record = record_of(arc((10.0, 12.0)), {CAR: Driven(EASTBOUND, arc((0.0, 12.0), start_m=5.0))})
    emv, car = record.track(EMV), record.track(CAR)
    every = car.step % 4 == 0
    far = np.hypot(emv.x_m - car.x_m, emv.y_m - car.y_m) >= 50.0
    assert len(RealismScene(record).ordinary) == int(np.count_nonzero(far & every)) > 0
    near = record_of(arc((10.0, 12.0)), {CAR: Driven(NORTHBOUND, arc((10.0, 12.0), start_m=30.0))})
    assert len(RealismScene(near).ordinary) == 0
    silent = record_of(arc((10.0, 12.0)), {CAR: Driven(NORTHBOUND, arc((10.0, 12.0), start_m=30.0))}, siren=False)
    assert len(RealismScene(silent).ordinary) > 0


def test_an_episode_has_all_samples_and_knows_its_situation() -> None:
    found = RealismEpisode.of(passing())
    assert set(found.samples) == set(SAMPLES)
    assert all(np.isfinite(values).all() for values in found.samples.values())
    assert (found.situation[0], found.level, found.at_own_level) == ("S3", "L1", True)
    assert found.situation == ("S3", "crossing", "0", "")


def test_an_encounter_that_begins_later_has_the_rows_of_the_smaller_gap() -> None:
    scene = RealismScene(passing())
    (far,), (near,) = scene.heard, scene.near
    assert far.gap_m[0] > near.gap_m[0]
    assert near.gap_m[0] <= 40.0
    assert near.gap_m.tolist() == far.gap_m[-len(near.gap_m) :].tolist()
    assert near.driver.track.step[near.passed_row] == far.driver.track.step[far.passed_row]


def test_episode_without_an_emv_that_moves_has_no_samples_of_it() -> None:
    record = hand_made(crossing(), {EMV: Driven(NORTHBOUND, arc((0.0, 5.0)))})
    scene = RealismScene(record)
    for name in set(SAMPLES) - set(quantities.ORDINARY):
        assert len(SAMPLES[name](scene)) == 0, name


def test_only_drivers_whose_way_crosses_the_emvs_stop_at_green_for_it() -> None:
    """One stands 8 m before its line, coming from the west, one next to the EMV, one on a parallel road."""
    network = crossing()
    record = record_of(arc((10.0, 20.0)), {})
    lanes = [network.lane_by_id[name].index for name in ("w_in_0", "s_in_2", "p_in_0")]
    columns = {
        "actor_id": np.array([7, 8, 9], np.uint32),
        "lane": np.array(lanes, np.int32),
        "lane_position_m": np.array([92.0, 95.0, 96.0]),
        "speed_mps": np.zeros(3),
    }

    def distances_m(letter: str) -> list[float]:
        signals = (SignalState("J", letter * len(network.connections)),)
        traffic = tuple(replace(state, signals=signals, **columns) for state in record.traffic)
        return samples(replace(record, traffic=traffic), "green_stop_distance_m").tolist()

    assert distances_m("G") == pytest.approx([8.0])
    assert distances_m("r") == []
