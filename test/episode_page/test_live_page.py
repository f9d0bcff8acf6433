"""The page of a running episode in a browser: what it draws against the record, and how it stays with the present."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from browser_pages import OpenedPage, PageBrowser
from episode_page.looked_at import until
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.episode_page.live import LIVE_TOPICS
from siren_ros.episode_page.live_server import LiveFeed, LiveServer
from siren_ros.interfaces import topics
from siren_ros.interfaces.topics import Topic
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.recording.record_builder import RecordBuilder
from siren_ros.world.actors import ACTOR_STATE_DTYPES

HOSTILE = "</script><img src=x onerror=\"document.title='taken'\"><b>"
STEPS = 60
LATER = 3
"""This actor comes in the middle of the episode."""


def episode(seed: int = 0) -> list[tuple[str, int, Any]]:
    """Three seconds; names and map try to be markup, and one actor comes later than the others."""
    messages = SyntheticEpisode(Scene(duration_s=STEPS * STEP_S, seed=seed)).messages()
    heard = [row for row in messages if row[0].name in LIVE_TOPICS]
    actors = [actor for topic, _, message in heard if topic == topics.TRAFFIC for actor in message.spawned]
    hostile = [replace(actor, name=f"{actor.name}{HOSTILE}") for actor in actors]
    return [(topic.name, step, changed(topic, step, message, hostile)) for topic, step, message in heard]


def changed(topic: Topic, step: int, message: Any, actors: list[Any]) -> Any:
    if topic == topics.EPISODE:
        return replace(message, map_name=HOSTILE)
    if topic == topics.TRAFFIC:
        coming = {0: [actor for actor in actors if actor.actor_id != LATER], STEPS // 2: actors}
        return replace(message, spawned=coming.get(step, []))
    if topic == topics.ACTORS and step < STEPS // 2:
        there = message.actor_id != LATER
        return replace(message, **{name: getattr(message, name)[there] for name in ACTOR_STATE_DTYPES})
    return message


@pytest.fixture(scope="module")
def record() -> EpisodeRecord:
    builder = RecordBuilder()
    for name, _, message in episode():
        builder.add(name, message)
    return builder.build()


class Running:
    """An episode that a test lets go on."""

    def __init__(self, page: OpenedPage, feed: LiveFeed) -> None:
        self.page = page
        self._feed = feed

    def go_on(self, first: int, last: int, seed: int = 0) -> None:
        for name, step, message in episode(seed):
            at_end = name in {topics.EPISODE_END.name, topics.OUTCOME.name}
            if last >= STEPS if at_end else first <= step <= last:
                self._feed.add(name, message)

    def drawn(self, step: int) -> dict[int, tuple[float, float]]:
        script = "time => { episodePage.seek(time); return episodePage.drawn(); }"
        rows = self.page.page.evaluate(script, step * STEP_S)
        return {row["id"]: (row["x"], row["y"]) for row in rows}

    def until(self, condition: str) -> None:
        until(self.page, condition)

    def text(self, css: str) -> str:
        return self.page.page.locator(css).inner_text()


@pytest.fixture
def running(browser: PageBrowser) -> Iterator[Running]:
    """A page that waits for an episode."""
    feed = LiveFeed()
    server = LiveServer(feed)
    with browser.served(server.address) as page:
        yield Running(page, feed)
        assert all(url.startswith((server.address, "data:")) for url in page.requests)
    server.close()


def until_end_at(step: int) -> str:
    return f"Math.abs(episodePage.tracks.end - {step * STEP_S}) < 1e-6"


def check_places(running: Running, record: EpisodeRecord, steps: range) -> None:
    for step in steps:
        state, drawn = record.states[step], running.drawn(step)
        assert sorted(drawn) == state.actor_id.tolist()
        for row, actor in enumerate(state.actor_id.tolist()):
            assert drawn[actor] == pytest.approx((state.x_m[row], state.y_m[row]), abs=0.01)


def test_drawn_places_are_those_of_the_record_while_it_runs(running: Running, record: EpisodeRecord) -> None:
    assert running.text("#wait") == "Waiting for an episode …"
    running.go_on(0, 20)
    running.until("window.episodePage !== undefined")
    assert running.text("#state") == "live"
    for end in (21, 40, STEPS - 1):
        running.go_on(end - 18 if end > 21 else end, end)
        running.until(until_end_at(end))
        check_places(running, record, range(0, end + 1, 4))
    assert running.page.problems == []


def test_it_stays_with_the_present_until_somebody_looks_back(running: Running) -> None:
    running.go_on(0, 20)
    running.until("window.episodePage && episodePage.atEnd && episodePage.following")
    running.go_on(21, 30)
    running.until(f"episodePage.moment.time > {29.9 * STEP_S}")
    running.page.page.evaluate("() => { episodePage.play(false); episodePage.seek(0.5); }")
    running.go_on(31, 40)
    running.until(until_end_at(40))
    assert running.page.page.evaluate("episodePage.moment.time") == 0.5
    running.page.page.click("#live")
    running.until(f"episodePage.following && episodePage.moment.time > {39.9 * STEP_S}")
    running.until("document.getElementById('live').hidden")


def test_the_end_is_told_and_what_was_seen_stays(running: Running, record: EpisodeRecord) -> None:
    running.go_on(0, STEPS - 1)
    running.until("window.episodePage !== undefined")
    running.go_on(STEPS, STEPS)
    running.until("document.getElementById('state').textContent === 'ended'")
    running.until("!episodePage.moment.playing")
    assert record.outcome is not None
    assert running.text("#facts").endswith(record.outcome.end.value)
    assert running.page.page.locator("#verdict").is_visible()
    check_places(running, record, range(0, STEPS, 10))


@pytest.mark.parametrize("looks_back", [False, True])
def test_the_next_episode_is_shown_or_offered(running: Running, looks_back: bool) -> None:
    running.go_on(0, STEPS)
    running.until("window.episodePage && episodePage.atEnd")
    if looks_back:
        running.page.page.evaluate("() => { episodePage.play(false); episodePage.seek(0.5); }")
    running.go_on(0, 10, seed=1)
    if looks_back:
        running.until("document.getElementById('live').textContent === 'Next episode'")
        running.page.page.click("#live")
    running.page.page.locator("h1", has_text="seed 1").wait_for()
    running.until("window.episodePage && episodePage.following")
    assert "seed 1" in running.text("h1")


def test_names_stay_text(running: Running) -> None:
    running.go_on(0, STEPS - 1)
    running.until("window.episodePage !== undefined")
    running.until(until_end_at(STEPS - 1))
    assert "taken" not in running.page.page.title()[:6]
    assert running.page.page.locator("img").count() == 0
    assert HOSTILE[:20] in running.text("h1")
    assert running.page.page.locator("#actor option").last.inner_text().endswith(HOSTILE)


def test_actors_and_events_join_the_lists(running: Running, record: EpisodeRecord) -> None:
    running.go_on(0, 5)
    running.until("window.episodePage !== undefined")
    known = running.page.page.locator("#actor option").count()
    running.go_on(6, STEPS - 1)
    running.until(until_end_at(STEPS - 1))
    assert running.page.page.locator("#actor option").count() == known + 1
    script = "() => episodePage.episode.head.events.map(event => event[0])"
    assert running.page.page.evaluate(script) == [event.step for event in record.events]
