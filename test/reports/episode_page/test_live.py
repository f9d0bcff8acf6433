"""A running episode as data, its server, and its page in a browser."""

import base64
import http.client
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser_pages import OpenedPage, PageBrowser
from episode_page.looked_at import pictures, until
from episode_page.unpacked import unpacked
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.conversions import to_actor_description, to_traffic_state
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.recording.episode_record import EpisodeRecord, RecordBuilder
from siren_ros.errors import InputError
from siren_ros.reports.episode_page import live
from siren_ros.reports.episode_page.live import LIVE_TOPICS, NO_WHY, LiveEpisode, LiveFeed, LiveServer, Place
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, SignalState

Messages = list[tuple[Topic, int, Any]]


@pytest.fixture(scope="module")
def messages() -> Messages:
    """Three seconds, at the end of which the outcome is known."""
    return [row for row in SyntheticEpisode(Scene(duration_s=3.0)).messages() if row[0].name in LIVE_TOPICS]


@pytest.fixture(scope="module")
def record(messages: Messages) -> EpisodeRecord:
    return record_of(messages)


def record_of(messages: Messages) -> EpisodeRecord:
    builder = RecordBuilder()
    for topic, _, message in messages:
        builder.add(topic.name, message)
    return builder.build()


def hearing(messages: Messages) -> LiveEpisode:
    """The episode of somebody who hears these."""
    episode = LiveEpisode()
    for topic, _, message in messages:
        episode.add(topic.name, message)
    return episode


def rows_of(parts: Iterable[bytes]) -> list[tuple[int, int, float, float]]:
    """Step, actor and place of each row in files that follow one another."""
    rows = []
    for part in parts:
        head, columns = unpacked(part)
        x_m, y_m, row = columns["motion.x_m"], columns["motion.y_m"], 0
        for actor in head["actors"]:
            for frame in range(actor["first"], actor["first"] + actor["frames"]):
                rows.append((int(columns["frame.step"][frame]), actor["id"], x_m[row], y_m[row]))
                row += 1
    return sorted(rows)


def told(messages: Messages, every: int) -> tuple[list[bytes], LiveEpisode]:
    """What a reader gets who asks after each so many messages."""
    episode, place, parts = LiveEpisode(), Place(), []
    for count, (topic, _, message) in enumerate(messages, 1):
        assert episode.belongs(topic.name)
        episode.add(topic.name, message)
        step, judged = episode.progress
        if count % every == 0 and (step > place.step or (judged and not place.judged)):
            part, place = episode.since(place)
            parts.append(part)
    return parts, episode


@pytest.mark.parametrize(
    ("lacking", "from_step", "shown"), [(topics.EVENTS, 5, 4), (topics.MAP, -1, -1), (topics.EPISODE, -1, -1)]
)
def test_a_step_needs_all_its_topics(messages: Messages, lacking: Topic, from_step: int, shown: int) -> None:
    heard = [row for row in messages if row[0] != lacking or row[1] < from_step]
    assert hearing(heard).progress[0] == shown


def test_the_end_of_a_whole_episode_is_told_by_itself(messages: Messages, record: EpisodeRecord) -> None:
    assert all(LiveEpisode().belongs(topic) for topic in LIVE_TOPICS)
    episode = hearing(messages)
    assert [topic for topic in LIVE_TOPICS if not episode.belongs(topic)] == [topics.EPISODE.name, topics.MAP.name]
    begin, place = episode.since(Place())
    assert unpacked(begin)[0]["ended"] == "not yet"
    assert "seen" not in [name for name, _ in unpacked(begin)[0]["facts"]]
    assert not place.judged
    end, place = episode.since(place)
    assert unpacked(end)[0]["ended"] == record.outcome.end.value
    assert place.judged
    assert rows_of([end]) == []


def test_of_a_fast_episode_steps_are_left_out_and_nothing_that_happens() -> None:
    """Eight seconds, of which the viewer hears every twelfth step, and those in which something happens."""
    messages = [row for row in SyntheticEpisode(Scene(duration_s=8.0)).messages() if row[0].name in LIVE_TOPICS]
    messages = [(topic, step, with_signal(topic, step, message)) for topic, step, message in messages]
    record = record_of(messages)
    steps = sorted({*range(0, record.steps, 12), *(event.step for event in record.events), 47, record.steps - 1})
    heard = [row for row in messages if row[0].name not in topics.OBSERVED or row[1] in steps]
    parts, episode = told(heard, 11)
    parts.append(episode.since(Place(max(step for step, *_ in rows_of(parts))))[0])
    heads = [unpacked(part)[0] for part in parts]
    rows = record.rows.select(np.isin(record.rows.step, steps))
    order = np.lexsort((rows.actor_id, rows.step))
    expected = np.column_stack((rows.step, rows.actor_id, rows.xy_m))[order]
    assert np.abs(np.array(rows_of(parts)) - expected).max() <= 0.0005 + 1e-9
    told_events = [(event[0], event[1], event[2]) for head in heads for event in head["events"]]
    assert told_events == [(event.step, event.kind.value, event.actor_id) for event in record.events]
    assert len(told_events) > 5
    changes = [change for head in heads for change in head["signals"].get("J", ())]
    assert [change for before, change in pairwise([[-1, ""], *changes]) if change[1] != before[1]] == [
        [0, "r"],
        [47, "G"],
    ]
    assert heads[-1]["ended"] == "complete"


def with_signal(topic: Topic, step: int, message: Any) -> Any:
    """The message, with a signal that changes at step 47."""
    if topic != topics.TRAFFIC:
        return message
    template = to_traffic_state(replace(SyntheticEpisode().traffic(0), signals=(SignalState("J", "r"),)))
    return replace(message, signals=[replace(template.signals[0], state="r" if step < 47 else "G")])


def test_who_comes_late_needs_the_roster(messages: Messages, record: EpisodeRecord) -> None:
    """Latched messages are heard, and the steps from then on."""
    episode = hearing([row for row in messages if row[0].latched or row[1] >= 20])
    assert episode.progress[0] == -1
    traffic = next(message for topic, _, message in messages if topic == topics.TRAFFIC)
    everybody = [to_actor_description(actor) for actor in record.actors.values()]
    episode.add(topics.ROSTER.name, replace(traffic, spawned=everybody))
    begin, place = episode.since(Place())
    rows = rows_of([begin])
    assert ["seen", "from 1.00 s on; events before are not known"] in unpacked(begin)[0]["facts"]
    assert unpacked(episode.since(place)[0])[0]["ended"] == "complete"
    assert {step for step, *_ in rows} == set(range(20, record.steps))
    assert {actor for _, actor, *_ in rows} == set(record.rows.actor_id[record.rows.step >= 20].tolist())


def test_actors_of_whom_nothing_was_said_are_left_out(messages: Messages) -> None:
    told_of = [
        (topic, step, replace(message, spawned=[one for one in message.spawned if one.actor_id != 2]))
        if topic == topics.TRAFFIC
        else (topic, step, message)
        for topic, step, message in messages
    ]
    assert 2 not in {actor for _, actor, *_ in rows_of([hearing(told_of).since(Place())[0]])}


PATIENCE_S = 60.0


@pytest.fixture
def feed() -> LiveFeed:
    return LiveFeed()


@pytest.fixture
def server(feed: LiveFeed) -> Iterator[LiveServer]:
    opened = LiveServer(feed)
    yield opened
    opened.close()


def tell(feed: LiveFeed, first: int, last: int, seed: int = 0) -> None:
    """Steps of an episode, with what is said once before the first step or after the last one."""
    for topic, step, message in SyntheticEpisode(Scene(duration_s=1.0, seed=seed)).messages():
        if topic.name in LIVE_TOPICS and first <= step <= last:
            feed.add(topic.name, message)


def answer(server: LiveServer, path: str, **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=PATIENCE_S)
    connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    return connection.getresponse()


def events(response: http.client.HTTPResponse) -> Iterator[tuple[str, bytes]]:
    """The events of a stream as a browser understands them."""
    kind = ""
    for line in response:
        name, _, value = line.decode().rstrip("\n").partition(": ")
        if name == "event":
            kind = value
        elif name == "data":
            yield kind, base64.b64decode(value)


def frames(content: bytes) -> list[int]:
    return unpacked(content)[1]["frame.step"].astype(int).tolist()


def test_the_page_allows_its_own_script_and_its_own_stream_alone(server: LiveServer) -> None:
    response = answer(server, f"/{server.secret}/")
    page = response.read().decode()
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert response.status == 200
    assert rules["default-src"] == "'none'"
    assert rules["connect-src"] == "'self'"
    assert re.fullmatch(r"'sha256-\S+'", rules["script-src"])
    assert response.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    assert "Access-Control-Allow-Origin" not in response.headers


@pytest.mark.parametrize("name", ["", "stream"])
def test_the_secret_and_this_machine_alone_open_the_page(server: LiveServer, name: str) -> None:
    path, port = f"/{server.secret}/{name}", server.server_port
    for folder in ("", "nonsense/", server.secret[:-1] + "/"):
        assert answer(server, f"/{folder}{name}").status == 404
    assert answer(server, f"/{server.secret}/other").status == 404
    for host in ("example.org", f"example.org:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}"):
        assert answer(server, path, Host=host).status == 403
    for site in ("cross-site", "same-site"):
        assert answer(server, path, Sec_Fetch_Site=site).status == 403
    assert answer(server, f"/{server.secret}/", Host=f"localhost:{port}").status == 200
    # Browsers call a page that a file opens one of another site.
    for place, status in (("document", 403 if name else 200), ("iframe", 403)):
        assert answer(server, path, Sec_Fetch_Site="cross-site", Sec_Fetch_Dest=place).status == status
    assert server.server_address[0] == "127.0.0.1"
    with pytest.raises(InputError, match="a free port"):
        LiveServer(LiveFeed(), port)


def test_the_file_that_leads_to_the_page_belongs_to_the_user_alone(server: LiveServer, tmp_path: Path) -> None:
    door = server.write_door(tmp_path)
    assert door.stat().st_mode & 0o777 == 0o600
    assert f"url={server.address}" in door.read_text(encoding="utf-8")
    assert server.secret not in door.as_uri()
    with pytest.raises(FileExistsError):
        server.write_door(tmp_path)


def test_a_browser_gets_the_beginning_and_then_what_is_new(feed: LiveFeed, server: LiveServer) -> None:
    tell(feed, 0, 9)
    stream = events(answer(server, f"/{server.secret}/stream"))
    kind, begin = next(stream)
    assert (kind, frames(begin)) == ("begin", list(range(10)))
    tell(feed, 10, 10)
    kind, more = next(stream)
    assert (kind, frames(more)) == ("more", [10])
    late = events(answer(server, f"/{server.secret}/stream"))
    assert next(late) == ("begin", begin)
    assert frames(next(late)[1]) == [10]


def test_slow_browsers_get_more_at_once_and_waiting_ones_signs_of_life(
    feed: LiveFeed, monkeypatch: pytest.MonkeyPatch
) -> None:
    tell(feed, 0, 0)
    source = feed.events()
    assert frames(next(source)[1]) == [0]
    for step in range(1, 18):
        tell(feed, step, step)
    assert frames(next(source)[1]) == list(range(1, 18))
    monkeypatch.setattr(live, "SIGN_OF_LIFE_S", 0.01)
    assert next(source) == ("", b"")
    feed.close()
    assert list(source) == []


def test_the_next_episode_is_announced_and_ends_the_stream(feed: LiveFeed, server: LiveServer) -> None:
    tell(feed, 0, 100)
    stream = events(answer(server, f"/{server.secret}/stream"))
    assert next(stream)[0] == "begin"
    tell(feed, 0, 3, seed=1)
    assert [kind for kind, _ in stream] == ["more", "next"]  # the end of the first one comes before
    kind, begin = next(events(answer(server, f"/{server.secret}/stream")))
    assert (kind, frames(begin)) == ("begin", [0, 1, 2, 3])


HOSTILE = "</script><img src=x onerror=\"document.title='taken'\"><b>"
STEPS = 60
GAP = range(22, 26)
"""These steps are not heard."""
LATER = 3
"""This actor comes in the middle of the episode."""


def episode(seed: int = 0) -> Messages:
    """Three seconds; names and map try to be markup, and one actor comes later than the others."""
    messages = SyntheticEpisode(Scene(duration_s=STEPS * STEP_S, seed=seed)).messages()
    heard = [row for row in messages if row[0].name in LIVE_TOPICS]
    actors = [actor for topic, _, message in heard if topic == topics.TRAFFIC for actor in message.spawned]
    hostile = [replace(actor, name=f"{actor.name}{HOSTILE}") for actor in actors]
    return [(topic, step, changed(topic, step, message, hostile)) for topic, step, message in heard]


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
def shown_record() -> EpisodeRecord:
    return record_of(episode())


class Running:
    """An episode that a test lets go on."""

    def __init__(self, page: OpenedPage, feed: LiveFeed) -> None:
        self.page = page
        self.actors_before = 0
        self._feed = feed

    def go_on(self, first: int, last: int, seed: int = 0) -> None:
        for topic, step, message in episode(seed):
            at_end = topic in {topics.EPISODE_END, topics.OUTCOME}
            if last >= STEPS if at_end else first <= step <= last:
                self._feed.add(topic.name, message)

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


def until_end_at(step: int) -> str:
    return f"Math.abs(episodePage.tracks.end - {step * STEP_S}) < 1e-6"


def check_places(running: Running, shown_record: EpisodeRecord, steps: Iterable[int]) -> None:
    for step in steps:
        state, drawn = shown_record.states[step], running.drawn(step)
        assert sorted(drawn) == state.actor_id.tolist()
        for row, actor in enumerate(state.actor_id.tolist()):
            assert drawn[actor] == pytest.approx((state.x_m[row], state.y_m[row]), abs=0.01)


@pytest.fixture(scope="module")
def seen(browser: PageBrowser, shown_record: EpisodeRecord) -> Iterator[Running]:
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
            check_places(running, shown_record, [step for step in range(0, end + 1, 4) if step not in GAP])
        running.go_on(STEPS, STEPS)
        running.until("document.getElementById('state').textContent === 'ended'")
        running.until("!episodePage.moment.playing")
        yield running
        assert running.page.problems == []


def test_between_two_steps_vehicles_are_between_their_places(seen: Running, shown_record: EpisodeRecord) -> None:
    before, after = shown_record.states[GAP.start - 1], shown_record.states[GAP.stop]
    share = (GAP[1] - before.step) / (after.step - before.step)
    drawn = seen.drawn(GAP[1])
    assert seen.page.page.evaluate("episodePage.moment.time") == pytest.approx(GAP[1] * STEP_S)
    pictures(seen.page)
    assert seen.text("#clock").startswith(f"{GAP[1] * STEP_S:.2f}")
    for row, actor in enumerate(before.actor_id.tolist()):
        between = before.x_m[row] + share * (after.x_m[row] - before.x_m[row])
        assert drawn[actor][0] == pytest.approx(between, abs=0.01)


def test_the_page_tells_the_end_and_names_stay_text(seen: Running, shown_record: EpisodeRecord) -> None:
    page = seen.page.page
    assert not page.evaluate("episodePage.moment.playing")
    assert shown_record.outcome is not None
    assert seen.text("#facts").endswith(shown_record.outcome.end.value)
    assert page.locator("#verdict").is_visible()
    assert seen.text("#why-not") == NO_WHY
    check_places(seen, shown_record, range(0, STEPS, 10))
    assert page.locator("#actor option").count() == seen.actors_before + 1
    script = "() => episodePage.episode.head.events.map(event => event[0])"
    assert page.evaluate(script) == [event.step for event in shown_record.events]
    assert page.locator("img").count() == 0
    assert HOSTILE[:20] in seen.text("h1")
    assert page.locator("#actor option").last.inner_text().endswith(HOSTILE)


def test_it_stays_with_the_present_and_shows_the_next_episode_until_somebody_looks_back(browser: PageBrowser) -> None:
    with opened(browser) as running:
        page = running.page.page
        running.go_on(0, 20)
        running.until("window.episodePage && episodePage.atEnd && episodePage.following")
        running.go_on(21, 30)
        running.until(f"episodePage.moment.time > {29.9 * STEP_S}")
        page.evaluate("() => { episodePage.play(false); episodePage.seek(0.5); }")
        running.go_on(31, 40)
        running.until(until_end_at(40))
        assert page.evaluate("episodePage.moment.time") == 0.5
        page.click("#live")
        running.until(f"episodePage.following && episodePage.moment.time > {39.9 * STEP_S}")
        running.until("document.getElementById('live').hidden")
        running.go_on(41, STEPS)
        running.until("episodePage.atEnd")
        for seed in (1, 2):
            running.go_on(0, 10, seed=seed)
            if seed == 2:
                running.until("document.getElementById('live').textContent === 'Next episode'")
                page.click("#live")
            page.locator("h1", has_text=f"seed {seed}").wait_for()
            running.until("window.episodePage && episodePage.following")
            page.evaluate("() => { episodePage.play(false); episodePage.seek(0.2); }")
