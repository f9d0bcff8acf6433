"""The page of a running episode in a browser: what it draws against the record, and how it stays with the present."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest
from browser_pages import OpenedPage, PageBrowser
from episode_page.looked_at import pictures, until
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.recording.record_builder import RecordBuilder
from siren_ros.reports.episode_page.live import LIVE_TOPICS, NO_WHY
from siren_ros.reports.episode_page.live_server import LiveFeed, LiveServer
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES

HOSTILE = "</script><img src=x onerror=\"document.title='taken'\"><b>"
STEPS = 60
GAP = range(22, 26)
"""These steps are not heard."""
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
        self.actors_before = 0
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


@contextmanager
def opened(browser: PageBrowser) -> Iterator[Running]:
    """A page that waits for an episode."""
    feed = LiveFeed()
    server = LiveServer(feed)
    with browser.served(server.address) as page:
        yield Running(page, feed)
        assert all(url.startswith((server.address, "data:")) for url in page.requests)
    server.close()


@pytest.fixture
def running(browser: PageBrowser) -> Iterator[Running]:
    with opened(browser) as page:
        yield page


def until_end_at(step: int) -> str:
    return f"Math.abs(episodePage.tracks.end - {step * STEP_S}) < 1e-6"


def check_places(running: Running, record: EpisodeRecord, steps: Iterable[int]) -> None:
    for step in steps:
        state, drawn = record.states[step], running.drawn(step)
        assert sorted(drawn) == state.actor_id.tolist()
        for row, actor in enumerate(state.actor_id.tolist()):
            assert drawn[actor] == pytest.approx((state.x_m[row], state.y_m[row]), abs=0.01)


@pytest.fixture(scope="module")
def seen(browser: PageBrowser, record: EpisodeRecord) -> Iterator[Running]:
    """A page that has followed an episode from its begin to its end; some steps it has not heard."""
    with opened(browser) as running:
        assert running.text("#wait") == "Waiting for an episode …"
        running.go_on(0, 20)
        running.until("window.episodePage !== undefined")
        assert running.text("#state") == "live"
        running.actors_before = running.page.page.locator("#actor option").count()
        for begin, end in ((21, 21), (26, 40), (41, STEPS - 1)):
            running.go_on(begin, end)
            running.until(until_end_at(end))
            check_places(running, record, [step for step in range(0, end + 1, 4) if step not in GAP])
        running.go_on(STEPS, STEPS)
        running.until("document.getElementById('state').textContent === 'ended'")
        running.until("!episodePage.moment.playing")
        yield running
        assert running.page.problems == []


def test_between_two_steps_that_are_there_vehicles_are_between_their_places(
    seen: Running, record: EpisodeRecord
) -> None:
    before, after = record.states[GAP.start - 1], record.states[GAP.stop]
    share = (GAP[1] - before.step) / (after.step - before.step)
    drawn = seen.drawn(GAP[1])
    assert seen.page.page.evaluate("episodePage.moment.time") == pytest.approx(GAP[1] * STEP_S)
    pictures(seen.page)
    assert seen.text("#clock").startswith(f"{GAP[1] * STEP_S:.2f}")
    for row, actor in enumerate(before.actor_id.tolist()):
        between = before.x_m[row] + share * (after.x_m[row] - before.x_m[row])
        assert drawn[actor][0] == pytest.approx(between, abs=0.01)


def test_the_end_is_told_and_what_was_seen_stays(seen: Running, record: EpisodeRecord) -> None:
    assert not seen.page.page.evaluate("episodePage.moment.playing")
    assert record.outcome is not None
    assert seen.text("#facts").endswith(record.outcome.end.value)
    assert seen.page.page.locator("#verdict").is_visible()
    check_places(seen, record, range(0, STEPS, 10))


def test_names_stay_text(seen: Running) -> None:
    assert "taken" not in seen.page.page.title()[:6]
    assert seen.page.page.locator("img").count() == 0
    assert HOSTILE[:20] in seen.text("h1")
    assert seen.page.page.locator("#actor option").last.inner_text().endswith(HOSTILE)


def test_actors_and_events_join_the_lists(seen: Running, record: EpisodeRecord) -> None:
    assert seen.page.page.locator("#actor option").count() == seen.actors_before + 1
    script = "() => episodePage.episode.head.events.map(event => event[0])"
    assert seen.page.page.evaluate(script) == [event.step for event in record.events]


def test_the_page_says_that_it_does_not_know_why(seen: Running) -> None:
    assert seen.text("#why-not") == NO_WHY


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
