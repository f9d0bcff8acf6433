"""The viewer beside real episodes: a client that only reads gets every step, with the places of the bag."""

import base64
import http.client
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from episode_page.unpacked import unpacked
from live_episodes import Domain, finish, recording, wait_until
from program_output import next_line

from siren_ros.recording.bag_reader import read_episode

DOMAIN = Domain()
PATIENCE_S = 120.0
VIEWER = ("-m", "siren_nodes.viewer", "--ros-args", "-p", "browser:=false")
Told = list[tuple[str, dict[str, Any], dict[str, Any]]]


@contextmanager
def viewer() -> Iterator[str]:
    """The address of a viewer's stream."""
    with DOMAIN.running(*VIEWER) as process:
        yield next_line(process.stdout).strip() + "stream"


def told(address: str) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """What a browser is told: the kind, the head and the columns of each event."""
    parts, kind = urlsplit(address), ""
    connection = http.client.HTTPConnection("127.0.0.1", parts.port, timeout=PATIENCE_S)
    connection.request("GET", parts.path)
    for line in connection.getresponse():
        name, _, value = line.decode().rstrip("\n").partition(": ")
        if name == "event":
            kind = value
        elif name == "data":
            yield kind, *(unpacked(base64.b64decode(value)) if kind != "next" else ({}, {}))


def to_the_end(events: Iterator[tuple[str, dict[str, Any], dict[str, Any]]]) -> Told:
    """What is told until the episode has ended."""
    kept = []
    for kind, head, columns in events:
        kept.append((kind, head, columns))
        if kind == "more" and "ended" in head:
            return kept
    raise AssertionError("the stream ended before the episode")


def steps_of(parts: Told) -> list[int]:
    return [int(step) for _, _, columns in parts for step in columns["frame.step"]]


def places_of(parts: Told) -> dict[tuple[int, int], tuple[float, float]]:
    """By step and actor."""
    places = {}
    for _, head, columns in parts:
        row = 0
        for actor in head["actors"]:
            for frame in range(actor["first"], actor["first"] + actor["frames"]):
                key = int(columns["frame.step"][frame]), actor["id"]
                places[key] = columns["motion.x_m"][row], columns["motion.y_m"][row]
                row += 1
    return places


def check_places(parts: Told, bag: Path) -> None:
    """Every actor of the bag is where the bag has it, from the first step on that was told."""
    record, places, first = read_episode(bag), places_of(parts), steps_of(parts)[0]
    rows = record.rows.select(record.rows.step >= first)
    assert sorted(places) == sorted(zip(rows.step.tolist(), rows.actor_id.tolist(), strict=True))
    found = np.array([places[key] for key in zip(rows.step.tolist(), rows.actor_id.tolist(), strict=True)])
    assert np.abs(found - rows.xy_m).max() <= 0.0005 + 1e-9


def test_two_episodes_from_their_first_steps_to_their_ends(tmp_path: Path) -> None:
    quiet = ("sensors:=none", "kitti:=false", "duration_s:=1.5")
    with viewer() as address:
        for name, seed in (("first", 0), ("second", 1)):
            stream = told(address)
            with DOMAIN.episode(f"bag:={tmp_path / name}", f"seed:={seed}", *quiet) as episode:
                if seed:
                    assert steps_of(to_the_end(stream)) == list(range(30))  # of the first one, which is still known
                    assert [kind for kind, *_ in stream] == ["next"]
                    stream = told(address)
                parts = to_the_end(stream)
                done = finish(episode)
            assert done.code == 0, done.err
            assert steps_of(parts) == list(range(30))
            assert parts[0][1]["facts"][2] == ["seed", str(seed)]
            assert parts[-1][1]["ended"] == "complete"
            check_places(parts, tmp_path / name)


def test_a_viewer_that_comes_late_shows_everybody_from_then_on(tmp_path: Path) -> None:
    slow = ("sensors:=none", "kitti:=false", "duration_s:=30.0", "realtime_factor:=1.0")
    with DOMAIN.episode(f"bag:={tmp_path / 'bag'}", *slow) as episode:
        wait_until(recording(tmp_path, 600_000), episode)
        with viewer() as address:
            parts = to_the_end(told(address))
        assert finish(episode).code == 0
    steps = steps_of(parts)
    assert steps == list(range(steps[0], 600))
    assert steps[0] > 0
    check_places(parts, tmp_path / "bag")
