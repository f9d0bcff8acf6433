"""Quantities of the ledger in records made by hand: closed-form distances, times and shares."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EASTBOUND, EMV, NORTHBOUND, Driven, crossing, hand_made, line, with_states
from made_encounters import CAR, arc, blocking, passing, record_of

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.evaluation.realism import quantities
from siren_ros.scoring.evaluation.realism.quantities import SAMPLES, TRAFFIC, RealismEpisode, RealismScene
from siren_ros.scoring.evaluation.realism.road_tracks import RoadTracks
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.world.actors import (
    ActorClass,
    ActorStates,
    Event,
    EventKind,
    Lights,
    Mode,
    SignalState,
    TrafficState,
)


def samples(record: EpisodeRecord, name: str) -> np.ndarray:
    return SAMPLES[name](RealismScene(record))


def test_without_a_siren_nobody_is_asked() -> None:
    record = passing(siren=False)
    for name in ("moved", "lane_change_distance_m", "response_distance_m", "hinder_time_s", "emv_contact"):
        assert len(samples(record, name)) == 0, name
    for name in ("lane_change_distance_m", "hinder_time_s"):
        assert len(samples(blocking(), name)) == 0, "who stays does not move, and blocks to an end that is not known"


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


def test_episode_without_an_emv_that_moves_has_no_samples_of_it() -> None:
    record = hand_made(crossing(), {EMV: Driven(NORTHBOUND, arc((0.0, 5.0)))})
    scene = RealismScene(record)
    for name in set(SAMPLES) - set(quantities.ORDINARY):
        assert len(SAMPLES[name](scene)) == 0, name


def north(x_m: float, *pieces: tuple[float, float], at_m: float, first_step: int = 0) -> Driven:
    """A vehicle that drives north from y = ``at_m`` on, by (speed in m/s, time in s) pieces."""
    return Driven(line((x_m, -120.0), (x_m, 110.0)), arc(*pieces, start_m=at_m + 120.0), first_step=first_step)


def with_column(record: EpisodeRecord, name: str, values: dict[int, Callable[[int], float]]) -> EpisodeRecord:
    """The record with a column of some actors as a function of the step; NaN leaves a value."""

    def column(state: ActorStates) -> np.ndarray:
        old = getattr(state, name)
        new = [values[key](state.step) if key in values else np.nan for key in state.actor_id.tolist()]
        return np.where(np.isnan(new), old, new).astype(old.dtype)

    return with_states(record, **{name: column})


AT = {7: 200, 8: 60}
"""Step at which each of two drivers changes from the left lane to the right one, which takes 2 s."""


def street() -> EpisodeRecord:
    """The EMV drives at 10 m/s from y = -119.8 m on, with 24 drivers whose samples can be told by hand.

    2 and 5 make way and come back, 5 by its speed; 3 is in the left lane; 4 drives away in front; 7 comes 90 m behind,
    8 is 135 m ahead; 20 to 26 come from the west, or are on roads that do not cross the EMV's.
    """
    cars = {
        2: north(5.25, (2.0, 20.0), at_m=-70.1),
        3: north(1.75, (3.0, 10.0), (10.0, 10.0), at_m=-82.0),
        4: north(5.25, (12.0, 1.5), (10.0, 16.0), at_m=-90.1),
        5: north(5.25, (2.0, 12.0), (6.0, 2.0), at_m=-60.1),
        7: north(1.75, (10.0, 8.0), at_m=-110.0, first_step=200),
        8: north(1.75, (5.0, 17.0), at_m=20.0),
    }
    record = record_of(arc((10.0, 20.0), start_m=0.2), cars)
    record = with_column(
        record,
        "x_m",
        {
            2: lambda step: 7.85 if 40 <= step < 180 else 5.25,
            4: lambda step: 4.25 if step >= 60 else 5.25,
            5: lambda step: 7.85 if step >= 100 else 5.25,
            **{key: lambda step, at=at: 1.75 + 3.5 * min(max((step - at - 40) / 40, 0), 1) for key, at in AT.items()},
        },
    )
    brakes = {2: {5: -9.0, 70: -1.0, 200: -8.0}, 3: {100: -3.0, 150: -6.0}, 5: {90: -0.5}}
    accels = {key: lambda step, of=of: of.get(step, 0.0) for key, of in brakes.items()}
    record = with_column(record, "accel_mps2", {**accels, 4: lambda _: 2.0})
    limits = {"n_out_0": 8.0, ":J_0_0": 4.0}
    lanes = tuple(replace(lane, speed_limit_mps=limits.get(lane.lane_id, 13.9)) for lane in record.network.lanes)
    site = {"kind": "crossing", "junction": "J"}
    described = replace(record.description, site=site, preset="observed")
    traffic = tuple(map(_traffic, record.traffic))
    return replace(record, network=replace(record.network, lanes=lanes), traffic=traffic, description=described)


def _traffic(state: TrafficState) -> TrafficState:
    """Lanes of 7 and 8, and who stands on others; the EMV is before and in the junction from step 94 to step 266."""
    step, lane = state.step, {lane.lane_id: lane.index for lane in crossing().lanes}
    west, there = lane["w_in_0"], []
    there += [(key, lane[f"s_in_{2 - (step >= at + 60)}"], 0.0, 10.0) for key, at in AT.items()]
    there += [(20, west, 97.0, 0.0)] * (step < 90) + [(21, west, 92.0, 0.0)] * (100 <= step < 250)
    there += [(22, west, 90.0, 0.0)] * (step >= 280) + [(23, west, 95.0, 3.0)] * (120 <= step < 140)
    there += [(24, west, 96.0, 0.0)] * (150 <= step < 160) + [(25, west, 69.0, 0.0)]
    there += [(26, lane["s_in_2"], 95.0, 0.0), (27, lane["p_in_0"], 96.0, 0.0)]
    ids, lanes, places, speeds = map(np.array, zip(*there, strict=True))
    letters = f"{'Gr'[step < 150]}rGG{'Gr'[150 <= step < 160]}GG"
    return replace(
        state,
        actor_id=ids.astype(np.uint32),
        lane=lanes.astype(np.int32),
        lane_position_m=places,
        speed_mps=speeds,
        signals=(SignalState("J", letters),),
    )


def test_a_street_of_drivers_has_the_samples_that_are_worked_out_by_hand() -> None:
    record = street()
    expected = {
        "time_to_site_s": [11.5],
        "moved": [1.0, 0.0, 1.0],  # 2, 3 and 5, whom the EMV passes
        "lane_change_distance_m": [28.7, 14.7],
        "response_distance_m": [28.7, 27.7, 14.7],
        "hinder_time_s": [1.4, 3.15],
        "return_distance_m": [17.3, 31.3],
        "crossed_against_signal": [0.0, 0.0, 1.0, 0.0],  # 3 does so after the EMV has passed
        "green_stop_distance_m": [8.0],
        "time_per_situation_s": [20.05],
        "time_in_situations": [0.0],
        "lane_change_s": [2.1],  # of 7; 8 hears the siren
        "rescue_lane_formed": [],
        "rescue_lane_unasked": [],
        "rescue_lane_stop": [],
        "rescue_lane_late": [],
        "rescue_lane_forgotten": [],
        "speed_in_30_zone": [(60 * 10.0 / 4.0 + 141 * 10.0 / 8.0) / 201],
        "emv_contact": [0.0],
        "emv_contact_per_km": [0.0],
        "wake_share": [],
        "hardest_brake_mps2": [1.0, 3.0, 0.0, 0.5],
    }
    found = RealismEpisode.of(record)
    for name, values in expected.items():
        assert found.samples[name].tolist() == pytest.approx(values, abs=1e-6), name
    ordinary = RealismScene(record).ordinary
    of_ordinary = {name: measure(ordinary).tolist() for name, measure in TRAFFIC.items()}
    assert {name: found.samples[name].tolist() for name in set(found.samples) - set(expected)} == of_ordinary
    assert (found.level, found.at_own_level) == ("L1", True)
    assert found.situation == ("S3", "crossing", "0", "")
    assert found.fitted_to == load_preset("observed").fitted_to != ()
    other = replace(record.description, level=EmergencyLevel.L2, seed=7, parameters={"request": {"site": "here"}})
    found = RealismEpisode.of(replace(record, description=other))
    assert (found.level, found.at_own_level, found.situation) == ("L2", False, ("S3", "crossing", "7", "here"))


def test_situations_are_short_times_to_collision_close_encroachments_and_hard_braking() -> None:
    """A car crosses 0.6 s before the EMV, one stands 14 m ahead for four steps, and the EMV brakes at three others."""
    cars = {
        CAR: Driven(EASTBOUND, arc((10.0, 20.0), start_m=13.65)),
        CAR + 1: north(5.25, (0.0, 0.15), at_m=49.2, first_step=300),
    }
    brakes = {EMV: lambda step: -5.0 if step in (50, 60, 150) else -3.0, CAR: lambda step: -9.0 * (step == 350)}
    record = with_column(record_of(arc((10.0, 20.0), start_m=0.2), cars), "accel_mps2", brakes)
    assert samples(record, "time_per_situation_s") == pytest.approx([20.05 / 4] * 4)  # 50 and 60 are one
    assert samples(record, "time_in_situations") == pytest.approx([(11 + 1 + 1 + 4) / 401])


MOTORWAY = {"kind": "motorway_stretch"}


def test_a_motorways_jam_has_the_samples_of_its_rescue_lane() -> None:
    """All stand in the left lane: 2 moves with the EMV near, 3 before, 4 is aside, 5 never moves, 6 is not passed."""
    places = {2: -70.0, 3: 15.0, 4: -50.0, 5: -40.0, 6: 100.0}
    record = record_of(
        arc((10.0, 20.0), start_m=0.2), {key: north(1.75, (0.0, 20.0), at_m=y) for key, y in places.items()}
    )
    since = {2: 30, 3: 20, 4: 0, 6: 0}
    aside = {key: lambda step, first=first: 0.75 if step >= first else 1.75 for key, first in since.items()}
    record = with_column(record, "x_m", aside)
    jam = replace(record, description=replace(record.description, site=MOTORWAY))
    expected = {"rescue_lane_formed": [1.0], "rescue_lane_unasked": [0.0], "rescue_lane_stop": [0.0]}
    expected |= {"rescue_lane_late": [1.0, 0.0, 0.0], "rescue_lane_forgotten": [0.0, 0.0, 0.0, 1.0]}
    assert {name: samples(jam, name).tolist() for name in expected} == expected
    assert (RealismEpisode.of(jam).road, RealismEpisode.of(record).road) == ("motorway", "street")
    assert all(len(samples(record, name)) == 0 for name in SAMPLES if "rescue" in name), "it is no motorway"
    stops = record_of(arc((10.0, 10.0), (0.0, 2.0), (10.0, 5.0)), {})
    stops = replace(stops, description=jam.description)
    assert samples(stops, "rescue_lane_stop").tolist() == [1.0]
    assert len(samples(stops, "rescue_lane_formed")) == 0, "nobody is there"


@pytest.mark.parametrize(("blocks_s", "formed", "aside_s"), [(2.4, 1.0, 0.0), (2.4, 1.0, 4.0), (5.0, 0.0, 0.0)])
def test_a_rescue_lane_is_formed_where_the_emv_fits_through_for_nine_tenths_of_the_time(blocks_s, formed, aside_s):
    """Three stand abreast, of whom two leave; the EMV looks 30 m ahead, and sees them from 2.5 s to 5.9 s.

    The one who stays has stood aside all the time, or moves there when the EMV is near: nobody had to ask the first.
    """
    cars = {2: north(8.25, (0.0, 20.0), at_m=-60.0)}
    cars |= {key: north(x_m, (0.0, blocks_s), at_m=-60.0) for key, x_m in ((3, 5.25), (4, 1.75))}
    record = record_of(arc((10.0, 20.0), start_m=0.2), cars)
    record = with_column(record, "x_m", {2: lambda step: 9.25 - (step < 20.0 * aside_s)})
    jam = replace(record, description=replace(record.description, site=MOTORWAY))
    assert samples(jam, "rescue_lane_formed").tolist() == [formed]
    assert samples(jam, "rescue_lane_unasked").tolist() == [formed if aside_s == 0.0 else 0.0]


def test_ordinary_traffic_is_that_which_no_siren_is_near() -> None:
    """All stand, the two EMVs 200 m apart, of which the second switches its siren on after 1 s; 5 is the AV."""
    places = {2: 30.0, 3: 190.0, 4: 100.0, 5: 110.0, 6: 120.0, 7: 130.0, 8: 151.0, 9: 200.0}
    cars = {key: north(5.25, (0.0, 2.0), at_m=at_m - 120.0) for key, at_m in places.items()}
    cars[6] = replace(cars[6], mode=Mode.STOPPED)
    record = record_of(arc((0.0, 2.0)), cars)
    record = with_column(record, "lights", {9: lambda step: int(Lights.SIREN) * (step >= 20)})
    kinds = {7: {"actor_class": ActorClass.BICYCLE}, 9: {"is_emv": True}}
    actors = {key: replace(actor, **kinds.get(key, {})) for key, actor in record.actors.items()}
    described = replace(record.description, emv_ids=(EMV, 9), parameters={"av": {"actor_id": 5}})
    ordinary = RoadTracks.of_record(replace(record, actors=actors, description=described))
    assert Counter(ordinary.track_id.tolist()) == {3: 5, 4: 11, 8: 5}
