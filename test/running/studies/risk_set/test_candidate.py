"""Candidates are drawn from the seed, the template and their number alone, within the template's ranges."""

from dataclasses import replace

import numpy as np
import pytest
from evaluation.made_records import Track, moving, record_with
from hypothesis import given
from hypothesis import strategies as st
from synthetic_episode import NET_XML

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.running.studies.risk_set.candidate import (
    FRAME_STEPS,
    LEANINGS,
    WINDOW_STEPS,
    Candidate,
    assessed,
    candidate_request,
    seen_by_most_at_risk,
    window_start,
)
from siren_ros.scoring.evaluation.risk.labels import RiskClass, RiskThresholds
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.scenario.episode import EpisodeRequest, values_of
from siren_ros.simulation.scenario.templates import available_templates, load_template
from siren_ros.simulation.world.actors import Event, EventKind


def drawn(template: str, risk: RiskClass, number: int, seed: int = 0) -> EpisodeRequest:
    return candidate_request(load_template(template), template, risk, seed, number, "")


@pytest.mark.parametrize("template", available_templates())
@pytest.mark.parametrize("risk", RiskClass)
def test_values_lie_where_the_class_leans_to(template: str, risk: RiskClass) -> None:
    loaded = load_template(template)
    for number in range(20):
        request = drawn(template, risk, number)
        assert request.preset in LEANINGS[risk].presets
        values = values_of(request.values)
        loaded.with_values(values)
        assert set(values) == set(loaded.ranges) & set(LEANINGS[risk].shares)
        for path, value in values.items():
            limits, (low, high) = loaded.ranges[path], LEANINGS[risk].shares[path]
            width = limits.maximum - limits.minimum
            slack = 0.5 if limits.integer else 1e-3
            assert limits.minimum + low * width - slack <= value <= limits.minimum + high * width + slack


def test_the_same_candidate_is_the_same_request() -> None:
    assert drawn("S4", RiskClass.NEAR_MISS, 7) == drawn("S4", RiskClass.NEAR_MISS, 7)
    seeds = {drawn("S4", RiskClass.NEAR_MISS, number, seed).seed for number in range(30) for seed in range(3)}
    assert len(seeds) == 90
    assert drawn("S4", RiskClass.NEAR_MISS, 7).seed != drawn("S6", RiskClass.NEAR_MISS, 7).seed


@given(begin=st.integers(0, 50), length=st.integers(0, 600), share=st.floats(0.0, 1.0), seed=st.integers(0, 1000))
def test_the_window_is_inside_and_shows_the_moment(begin: int, length: int, share: float, seed: int) -> None:
    end = begin + WINDOW_STEPS + FRAME_STEPS + length
    moment = begin + int(share * (end - begin - 1))
    first = window_start(moment, begin, end, seed)
    assert first % FRAME_STEPS == 0
    assert begin <= first
    assert first + WINDOW_STEPS <= end
    assert first - FRAME_STEPS < moment < first + WINDOW_STEPS + FRAME_STEPS


def test_the_moments_place_is_drawn_between_40_and_80_percent() -> None:
    places = [(2000 - window_start(2000, 0, 4000, seed)) / WINDOW_STEPS for seed in range(200)]
    assert 0.39 < min(places) < 0.45
    assert 0.75 < max(places) < 0.81
    assert sum(places) / len(places) == pytest.approx(0.6, abs=0.02)


EMV, CAR = 1, 5
LIMITS = RiskThresholds()


def episode_of(tracks: dict[int, Track], events: tuple[Event, ...] = ()) -> EpisodeRecord:
    record = record_with(tracks, parse_road_network(NET_XML.encode()))
    return replace(record, events=events, description=replace(record.description, emv_ids=(EMV,)))


def record(*events: Event, steps: int = WINDOW_STEPS + 120, car: Track | None = None) -> EpisodeRecord:
    """An EMV at 10 m/s from step 10 on, and a car that stands 3 m to the left of its way, 200 m ahead."""
    tracks = {
        EMV: moving(0.0, -5.25, 10.0, is_emv=True, steps=steps, first_step=10),
        CAR: car or moving(200.0, -2.25, 0.0, steps=steps + 10),
    }
    return episode_of(tracks, events)


def candidate_of(episode: EpisodeRecord, seed: int = 0) -> Candidate:
    candidate = assessed(EpisodeRequest(seed=seed), episode, LIMITS)
    assert isinstance(candidate, Candidate)
    return candidate


@pytest.mark.parametrize(("steps", "long_enough"), [(WINDOW_STEPS - 1, False), (WINDOW_STEPS, True)])
def test_the_emv_has_to_be_there_for_a_whole_video(steps: int, *, long_enough: bool) -> None:
    assert isinstance(assessed(EpisodeRequest(), record(steps=steps), LIMITS), Candidate) is long_enough


def test_nothing_happens_and_the_window_is_around_the_closest_moment() -> None:
    """The EMV is next to the car 20 s after step 10, at step 410, of 510 steps in all."""
    for seed in range(5):
        candidate = candidate_of(record(), seed)
        assert candidate.label.risk is RiskClass.NORMAL
        assert candidate.first_step == window_start(410, 10, 510, seed)
    # A car that is near while the EMV stands does not count: it stands until step 60, next to another one.
    standing = np.concatenate(
        (np.tile([0.0, -5.25, 0.0, 0.0, 0.0], (50, 1)), moving(0.0, -5.25, 10.0, steps=450).states)
    )
    others = {CAR: moving(0.0, -2.25, 0.0, steps=50), 7: moving(100.0, 0.0, 0.0, steps=500)}
    episode = episode_of({EMV: Track(standing, is_emv=True), **others})
    assert candidate_of(episode).first_step == window_start(50 + 200, 0, 500, 0)


def test_a_contact_decides_and_the_window_is_around_it() -> None:
    """The car stands ahead in view; the window's label is of what lies in it."""
    contact = Event(385, EventKind.COLLISION, EMV, CAR, detail={"impact_speed_mps": 3.0})
    candidate = candidate_of(record(contact), 4)
    assert (candidate.label.risk, candidate.label.step) == (RiskClass.COLLISION, 385)
    assert candidate.first_step == window_start(385, 10, 510, 4)
    moments = candidate.evidence.moments.step
    assert ((moments >= candidate.first_step) & (moments < candidate.first_step + WINDOW_STEPS)).all()


def test_an_emv_that_never_moves_is_shown_in_the_middle_of_its_time() -> None:
    still = moving(0.0, -5.25, 0.0, is_emv=True, steps=401)
    episode = episode_of({EMV: still, CAR: moving(50.0, -5.25, 0.0, steps=401)})
    assert candidate_of(episode, 2).first_step == window_start(200, 0, 401, 2)


OTHER = 3


def with_two_emvs(*events: Event, steps: int = 510, first_step: int = 0) -> EpisodeRecord:
    """A second EMV 60 m behind the first one on the same way, which stands 3 m beside the car 200 m ahead of it."""
    episode = record(*events)
    tracks = {
        EMV: moving(0.0, -5.25, 10.0, is_emv=True, steps=500, first_step=10),
        CAR: moving(200.0, -2.25, 0.0, steps=510),
        OTHER: moving(-60.0, -5.25, 10.0, is_emv=True, steps=steps, first_step=first_step),
    }
    both = episode_of(tracks, events)
    return replace(both, description=replace(episode.description, emv_ids=(EMV, OTHER)))


def contact_of(emv_id: int, step: int = 385) -> Event:
    return Event(step, EventKind.COLLISION, emv_id, CAR, detail={"impact_speed_mps": 3.0})


@pytest.mark.parametrize(
    ("events", "first"),
    [
        ((), EMV),
        ((contact_of(EMV),), EMV),
        ((contact_of(OTHER, 480),), OTHER),
        ((contact_of(EMV, 390), contact_of(OTHER, 380)), OTHER),
    ],
    ids=["nothing happens", "the first", "the other", "the earlier"],
)
def test_a_video_is_seen_from_the_emv_with_the_most_severe_conflict(events, first) -> None:
    seen = seen_by_most_at_risk(with_two_emvs(*events), LIMITS)
    assert seen.emv_ids[0] == first
    assert set(seen.emv_ids) == {EMV, OTHER}
    assert candidate_of(seen).label.risk is (RiskClass.COLLISION if events else RiskClass.NORMAL)


def test_an_emv_that_is_there_for_less_than_a_video_shows_none() -> None:
    short = with_two_emvs(contact_of(OTHER, 480), steps=300, first_step=210)
    assert seen_by_most_at_risk(short, LIMITS).emv_ids[0] == EMV
    alone = record(contact_of(EMV))
    assert seen_by_most_at_risk(alone, LIMITS) is alone
