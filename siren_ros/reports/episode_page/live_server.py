"""Serves the page of a running episode to browsers of this machine, with server-sent events (WHATWG HTML, 9.2).

Another local user or another page in the browser cannot read it: the address holds a secret, requests must name this
machine as their host (otherwise a foreign name could be made to lead here), and nothing allows other origins. Command
lines are public on a machine, so a browser is started with a file of the user that leads to the address.
"""

import base64
import os
import secrets
import threading
from collections.abc import Iterator
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import InputError
from siren_ros.reports.episode_page.build import live_page
from siren_ros.reports.episode_page.live import LiveEpisode, Place

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
