"""The viewer and real episodes: a client that only reads gets steps with the places of the bag, and what happens."""

import base64
import http.client
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from episode_page.unpacked import unpacked
from live_episodes import IN_ORDER, Domain, finish, recording, wait_until
from program_output import next_line

from siren_ros.data.recording.bag_reader import read_episode

DOMAIN = Domain()
PATIENCE_S = 120.0
VIEWER = ("-m", "siren_nodes.viewer", "--ros-args", "-p", "browser:=false")
Told = list[tuple[str, dict[str, Any], dict[str, Any]]]


@contextmanager
def viewer() -> "Iterator[tuple[str, subprocess.Popen[str]]]":
    """The address of a viewer's stream, and its program."""
    with DOMAIN.running(*VIEWER) as process:
        yield next_line(process.stdout).strip() + "stream", process


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


def check(parts: Told, bag: Path) -> list[int]:
    """Every actor of the bag is where the bag has it, at the steps that were told; no event after the first is lost."""
    record, places, steps = read_episode(bag), places_of(parts), steps_of(parts)
    assert steps == sorted(set(steps))
    rows = record.rows.select(np.isin(record.rows.step, steps))
    assert sorted(places) == sorted(zip(rows.step.tolist(), rows.actor_id.tolist(), strict=True))
    found = np.array([places[key] for key in zip(rows.step.tolist(), rows.actor_id.tolist(), strict=True)])
    assert np.abs(found - rows.xy_m).max() <= 0.0005 + 1e-9
    events = [(event.step, event.kind.value) for event in record.events if event.step >= steps[0]]
    assert [(event[0], event[1]) for _, head, _ in parts for event in head["events"] if event[0] >= steps[0]] == events
    assert {step for step, _ in events} <= set(steps)
    assert steps[-1] == record.steps - 1
    assert parts[-1][1]["ended"] == "complete"
    return steps


def test_an_episode_from_its_first_step_to_its_end_and_then_one_that_is_played(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    with viewer() as (address, program):
        stream = told(address)
        with DOMAIN.episode(f"bag:={bag}", "seed:=1", "sensors:=none", "kitti:=false", "duration_s:=1.5") as episode:
            parts = to_the_end(stream)
            done = finish(episode)
        assert done.code == 0, done.err
        assert parts[0][1]["facts"][2] == ["seed", "1"]
        assert check(parts, bag)[0] == 0
        late = told(address)
        assert check(to_the_end(late), bag)[0] == 0  # it is still known
        with DOMAIN.running(*player(bag, "start_s:=0.5")) as playing:
            assert [kind for kind, *_ in late] == ["next"]
            parts = to_the_end(told(address))
            assert playing.wait(PATIENCE_S) in IN_ORDER
        assert check(parts, bag) == list(range(10, 30))
        program.send_signal(signal.SIGINT)
        ended = finish(program)
        assert ended.code in IN_ORDER
        assert ended.err == ""


def player(bag: Path, *parameters: str) -> list[str]:
    flags = [part for item in (f"bag:={bag}", *parameters) for part in ("-p", item)]
    return ["-m", "siren_nodes.player", "--ros-args", *flags]


def test_a_viewer_that_comes_late_shows_everybody_from_then_on(tmp_path: Path) -> None:
    """At real time, where no step is left out."""
    slow = ("sensors:=none", "kitti:=false", "duration_s:=15.0", "realtime_factor:=1.0")
    with DOMAIN.episode(f"bag:={tmp_path / 'bag'}", *slow) as episode:
        wait_until(recording(tmp_path, 100_000), episode)
        with viewer() as (address, _):
            parts = to_the_end(told(address))
        assert finish(episode).code == 0
    steps = check(parts, tmp_path / "bag")
    assert steps == list(range(steps[0], 300))
    assert steps[0] > 0
