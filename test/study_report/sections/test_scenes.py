"""Which steps the film of an episode has."""

from dataclasses import replace

import pytest
from evaluation.made_records import moving, record_with
from synthetic_episode import NET_XML

from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.net_parser import parse_road_network
from siren_ros.study_report.sections.scenes import film_steps
from siren_ros.world.events import Event, EventKind

EMV, CAR = 1, 5


def record(*events: Event, steps: int = 601) -> EpisodeRecord:
    tracks = {EMV: moving(0.0, -5.25, 5.0, is_emv=True, steps=steps), CAR: moving(40.0, -5.25, 2.0, steps=steps)}
    made = record_with(tracks, parse_road_network(NET_XML.encode()))
    return replace(made, events=events, description=replace(made.description, emv_ids=(EMV,)))


def told(step: int) -> Event:
    return Event(step, EventKind.YIELD_STARTED, CAR)


def test_the_film_is_around_the_median_event() -> None:
    """Of ten seconds: five before step 300 and five after it, at every second step."""
    found = film_steps(record(told(10), told(300), told(590)), 10.0)
    assert (found.start, found.stop, found.step) == (200, 400, 2)


@pytest.mark.parametrize(("step", "start"), [(20, 0), (590, 400), (101, 0), (103, 2)])
def test_the_film_lies_inside_the_episode_and_begins_with_a_frame(step: int, start: int) -> None:
    found = film_steps(record(told(step)), 10.0)
    assert found.start == start
    assert len(found) == 100


def test_lines_that_others_cross_are_no_events_of_the_interaction() -> None:
    crossed = (Event(step, EventKind.STOP_LINE_CROSSED, CAR) for step in (10, 20, 30))
    found = film_steps(record(*crossed, Event(400, EventKind.STOP_LINE_CROSSED, EMV)), 5.0)
    assert found.start == 350


def test_a_short_episode_is_shown_whole() -> None:
    found = film_steps(record(told(30), steps=61), 10.0)
    assert (found.start, found.stop) == (0, 61)
