"""A running episode as data of the page, first all that is known, then updates; served to browsers of this machine.

Both are files of the format that the page of a recorded episode holds. A file of what is new has rows of the new frames
alone, and counts frames from its own first one. Frames may be more than a step apart: not all steps are heard
(``siren_ros/running/ros/transport/endpoints.py``).

The server sends events (server-sent events, WHATWG HTML, 9.2). Another local user or another page in the browser cannot
read the page: the address holds a secret, requests must name this machine as their host (otherwise a foreign name could
be made to lead here), and nothing allows other origins. Command lines are public on a machine, so a browser is started
with a file of the user that leads to the address.
"""

import base64
import os
import secrets
import threading
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.data.interfaces import topics
from siren_ros.data.recording.episode_record import EpisodeRecord, RecordBuilder
from siren_ros.errors import InputError
from siren_ros.reports.episode_page.build import FORMAT, episode_data, events_of, live_page
from siren_ros.reports.episode_page.columns import QUICK, ColumnFile, add_motion, signals_of
from siren_ros.sensing.meshes.mesh import StaticScene
from siren_ros.sensing.scene.kerbside import scene_config_of
from siren_ros.sensing.scene.static_scene import kept_scene
from siren_ros.simulation.world.actors import ActorStates

_SETTING: Final = (topics.EPISODE.name, topics.MAP.name)
NO_WHY: Final = "Not known while an episode runs; the page of its bag says it."
LIVE_TOPICS: Final = topics.OBSERVED | {
    topic.name: topic for topic in (topics.EPISODE, topics.MAP, topics.ROSTER, topics.EPISODE_END, topics.OUTCOME)
}
"""Topics to subscribe to, by the name that they have in an episode."""


@dataclass(frozen=True)
class Place:
    """Position of a reader in an episode."""

    step: int = -1
    """The last step that the reader has."""
    judged: bool = False
    """Whether the reader has the outcome."""


class LiveEpisode:
    """One episode, from the first message received. One thread adds messages, others read."""

    def __init__(self) -> None:
        """Start without messages."""
        self._builder = RecordBuilder()
        self._latest: dict[str, int] = dict.fromkeys(topics.OBSERVED, -1)
        self._heard: set[str] = set()
        self._from_start = False
        self._adding, self._preparing = threading.Lock(), threading.Lock()
        self._scene: StaticScene | None = None
        self._begin: tuple[bytes, Place] | None = None

    def belongs(self, topic: str) -> bool:
        """Whether a message can belong to this episode; otherwise it is the first of the next one."""
        return topic not in _SETTING or not self._heard & {topic, topics.EPISODE_END.name}

    def add(self, topic: str, message: Any) -> None:
        """Add a message of a topic of ``LIVE_TOPICS``.

        Raises:
            SirenError: Its content cannot be used.
        """
        with self._adding:
            self._builder.add(topic, message)
            self._heard.add(topic)
            if topic in self._latest:
                self._latest[topic] = int(message.step)
                self._from_start |= message.step == 0

    @property
    def is_set(self) -> bool:
        """Whether its description and its map are known."""
        return self._heard.issuperset(_SETTING)

    @property
    def progress(self) -> tuple[int, bool]:
        """The last complete step, and whether the outcome is known; -1 before there is data to show.

        DDS keeps the order of a topic's messages, and not that of different topics.
        """
        introduced = self._from_start or topics.ROSTER.name in self._heard
        return min(self._latest.values()) if introduced and self.is_set else -1, topics.OUTCOME.name in self._heard

    def prepare(self) -> None:
        """Make the scene, which takes seconds in a town; otherwise the first reader waits for it.

        Raises:
            BagError: Before description and map are known.
        """
        with self._preparing:
            if self._scene is None:
                setting = self._part(range(0))
                config = scene_config_of(setting.description.template_values)
                self._scene = kept_scene(setting.network, setting.description.seed, config)

    def since(self, place: Place) -> tuple[bytes, Place]:
        """New data for a reader and its new position; from the default position, the whole episode so far.

        Call it where ``progress`` is beyond the place.
        """
        if place.step < 0:
            self.prepare()
            with self._preparing:
                if self._begin is None:
                    last, _ = self.progress
                    part = self._part(range(last + 1))
                    self._begin = episode_data(part, NO_WHY, live=self._scene), Place(last)
            return self._begin
        last, judged = self.progress
        record = self._part(range(place.step + 1, last + 1))
        file = ColumnFile()
        head = {
            "format": FORMAT,
            "actors": add_motion(file, record),
            "events": events_of(record),
            "signals": signals_of(record),
        }
        return file.packed({**head, **(_end_of(record) if judged else {})}, QUICK), Place(last, judged)

    def _part(self, steps: range) -> EpisodeRecord:
        """Record of some steps, as received."""
        with self._adding:
            record = self._builder.build(steps=steps)
        return replace(record, states=tuple(_known(state, record.actors) for state in record.states))


def _known(state: ActorStates, actors: Collection[int]) -> ActorStates:
    """The state without actors that have no description."""
    known = np.isin(state.actor_id, list(actors))
    return state if known.all() else state.select(known)


def _end_of(record: EpisodeRecord) -> Mapping[str, Any]:
    """The end of the episode for the head of the data; empty while it runs."""
    outcome = record.outcome
    if outcome is None:
        return {}
    holds, text = outcome.predicate_holds, str(outcome.measures.get("predicate", ""))
    verdict = None if holds is None else {"holds": holds, "text": text, "parts": []}
    return {"ended": outcome.end.value, "verdict": verdict}


HOST: Final = "127.0.0.1"
BATCH_S: Final = 0.05
"""Least wall time between two messages to a browser; data in between are sent together."""
SIGN_OF_LIFE_S: Final = 5.0
"""Wall time between signs of life. A browser that has left is noticed only when something is sent to it."""
PATIENCE_S: Final = 30.0
"""A browser that receives nothing for this time must connect again."""
_HEADERS: Final = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class LiveFeed:
    """Feed of the newest episode. One thread adds messages; each browser has a thread that waits for new data."""

    def __init__(self) -> None:
        """Start without an episode."""
        self._episode = LiveEpisode()
        self._changed = threading.Condition()
        self._closed = threading.Event()

    def add(self, topic: str, message: Any) -> None:
        """Add a message of the episode, or the first one of the next episode.

        Raises:
            SirenError: As ``LiveEpisode.add``.
        """
        with self._changed:
            if not self._episode.belongs(topic):
                self._episode = LiveEpisode()
            was_set = self._episode.is_set
            self._episode.add(topic, message)
            if self._episode.is_set and not was_set:
                threading.Thread(target=self._episode.prepare, daemon=True).start()
            self._changed.notify_all()

    def close(self) -> None:
        """End the feed; all waiting threads are informed."""
        with self._changed:
            self._closed.set()
            self._changed.notify_all()

    def events(self) -> Iterator[tuple[str, bytes]]:
        """Yield messages for a browser: ``begin``, then ``more``, and ``next`` when another episode begins.

        A kind without content is a sign of life. A reader who is slow gets more at once.
        """
        episode, place = self._episode, Place()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._is_new(episode, place), SIGN_OF_LIFE_S)  # noqa: B023 - called here
            if self._closed.is_set():
                return
            if _beyond(episode, place):
                kind = "begin" if place.step < 0 else "more"
                content, place = episode.since(place)
                yield kind, content
            elif episode is not self._episode:
                yield "next", b"-"
                return
            else:
                yield "", b""
            self._closed.wait(BATCH_S)

    def _is_new(self, episode: LiveEpisode, place: Place) -> bool:
        return self._closed.is_set() or episode is not self._episode or _beyond(episode, place)


def _beyond(episode: LiveEpisode, place: Place) -> bool:
    step, judged = episode.progress
    return step > place.step or (step >= 0 and judged > place.judged)


class LiveServer(ThreadingHTTPServer):
    """Serves a feed to browsers, from its own threads."""

    daemon_threads = True

    def __init__(self, feed: LiveFeed, port: int = 0) -> None:
        """Start to listen; port 0 takes a free one.

        Raises:
            InputError: The port is taken.
        """
        self.feed = feed
        self.secret = secrets.token_urlsafe(16)
        self.page = live_page().encode()
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            raise InputError("port", port, f"a free port ({error.strerror})") from error
        self._thread = threading.Thread(target=self.serve_forever, daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """Address to open in a browser."""
        return f"http://{HOST}:{self.server_port}/{self.secret}/"

    def write_door(self, folder: Path) -> Path:
        """Write a page that leads to the address; only the user can read it."""
        door = folder / "siren.html"
        with os.fdopen(os.open(door, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
            file.write(
                f'<!doctype html><meta http-equiv="refresh" content="0; url={self.address}"><title>SIREN</title>'
            )
        return door

    def close(self) -> None:
        """End all connections."""
        self.feed.close()
        self.shutdown()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: LiveServer
    timeout = PATIENCE_S

    def do_GET(self) -> None:
        """Send the page, its stream, or an error."""
        here = {f"{name}:{self.server.server_port}" for name in (HOST, "localhost")}
        folder, _, name = self.path.removeprefix("/").partition("/")
        opened = not name and self.headers.get("Sec-Fetch-Dest") == "document"  # opened from the file that leads here
        foreign = self.headers.get("Sec-Fetch-Site", "none") not in {"none", "same-origin"} and not opened
        if self.headers.get("Host") not in here or foreign:
            self.send_error(HTTPStatus.FORBIDDEN)
        elif not secrets.compare_digest(folder.encode(), self.server.secret.encode()) or name not in {"", "stream"}:
            self.send_error(HTTPStatus.NOT_FOUND)
        elif name:
            self._stream()
        else:
            self._begin("text/html; charset=utf-8")
            self.wfile.write(self.server.page)

    def _begin(self, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        for name, value in {"Content-Type": kind, **_HEADERS}.items():
            self.send_header(name, value)
        self.end_headers()

    def _stream(self) -> None:
        self._begin("text/event-stream")
        try:
            for kind, content in self.server.feed.events():
                text = f"event: {kind}\ndata: {base64.b64encode(content).decode()}\n\n" if kind else ":\n\n"
                self.wfile.write(text.encode())
        except OSError:  # the browser has left, or receives nothing
            self.close_connection = True

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name of the base class
        """Suppress the log line of each request."""
