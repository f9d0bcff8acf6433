"""Who gets the page of a running episode and its stream, and in which pieces."""

import base64
import http.client
import re
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from episode_page.unpacked import unpacked
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.errors import InputError
from siren_ros.reports.episode_page import live_server
from siren_ros.reports.episode_page.live import LIVE_TOPICS
from siren_ros.reports.episode_page.live_server import LiveFeed, LiveServer

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
def test_without_the_secret_there_is_nothing(server: LiveServer, name: str) -> None:
    for folder in ("", "nonsense/", server.secret[:-1] + "/"):
        assert answer(server, f"/{folder}{name}").status == 404
    assert answer(server, f"/{server.secret}/other").status == 404


@pytest.mark.parametrize("name", ["", "stream"])
def test_other_hosts_and_other_sites_get_nothing(server: LiveServer, name: str) -> None:
    path, port = f"/{server.secret}/{name}", server.server_port
    for host in ("example.org", f"example.org:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}"):
        assert answer(server, path, Host=host).status == 403
    for site in ("cross-site", "same-site"):
        assert answer(server, path, Sec_Fetch_Site=site).status == 403
    assert answer(server, f"/{server.secret}/", Host=f"localhost:{port}").status == 200


def test_the_file_that_leads_to_the_page_belongs_to_the_user_alone(server: LiveServer, tmp_path: Path) -> None:
    door = server.write_door(tmp_path)
    assert door.stat().st_mode & 0o777 == 0o600
    assert f"url={server.address}" in door.read_text(encoding="utf-8")
    assert server.secret not in door.as_uri()
    with pytest.raises(FileExistsError):
        server.write_door(tmp_path)


def test_the_file_may_open_the_page_and_nothing_else(server: LiveServer) -> None:
    """Browsers call a page that a file opens one of another site."""
    opened = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "document"}
    assert answer(server, f"/{server.secret}/", **opened).status == 200
    assert answer(server, f"/{server.secret}/stream", **opened).status == 403
    assert answer(server, f"/{server.secret}/", **{**opened, "Sec_Fetch_Dest": "iframe"}).status == 403


def test_it_listens_on_this_machine_alone(server: LiveServer) -> None:
    assert server.server_address[0] == "127.0.0.1"
    with pytest.raises(InputError, match="a free port"):
        LiveServer(LiveFeed(), server.server_port)


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


def test_a_slow_browser_gets_more_at_once_and_delays_nobody(feed: LiveFeed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_server, "BATCH_S", 0.0)
    tell(feed, 0, 0)
    source = feed.events()
    assert frames(next(source)[1]) == [0]
    for step in range(1, 18):
        tell(feed, step, step)
    assert frames(next(source)[1]) == list(range(1, 18))


def test_the_next_episode_is_announced_and_ends_the_stream(feed: LiveFeed, server: LiveServer) -> None:
    tell(feed, 0, 100)
    stream = events(answer(server, f"/{server.secret}/stream"))
    assert next(stream)[0] == "begin"
    tell(feed, 0, 3, seed=1)
    assert [kind for kind, _ in stream] == ["more", "next"]  # the end of the first one comes before
    kind, begin = next(events(answer(server, f"/{server.secret}/stream")))
    assert (kind, frames(begin)) == ("begin", [0, 1, 2, 3])


def test_who_waits_for_an_episode_sees_its_begin(feed: LiveFeed, server: LiveServer) -> None:
    got: list[tuple[str, bytes]] = []
    stream = events(answer(server, f"/{server.secret}/stream"))
    waiting = threading.Thread(target=lambda: got.append(next(stream)))
    waiting.start()
    tell(feed, 0, 2)
    waiting.join(PATIENCE_S)
    assert got[0][0] == "begin"


def test_waiting_readers_get_signs_of_life_and_the_end(feed: LiveFeed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_server, "SIGN_OF_LIFE_S", 0.01)
    source = feed.events()
    assert next(source) == ("", b"")
    feed.close()
    assert list(source) == []
