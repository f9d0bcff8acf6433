"""What is said of a wait, and when."""

import io
import threading

import pytest

from siren_ros.ros.programs import waiting
from siren_ros.ros.programs.waiting import AGAIN_S, FIRST_S, Awaited, Waiting, begin_silence, keep_silence

LOOK_S = 0.25


def lines_of(awaited: list[Awaited]) -> dict[float, str]:
    """The lines with their times, of what is waited for at each look."""
    silence, found = begin_silence(awaited[0], 0.0), {}
    for look, now in enumerate(awaited):
        silence, line = keep_silence(silence, now, look * LOOK_S)
        if line:
            found[look * LOOK_S] = line
    return found


def looks(seconds: float, awaited: Awaited) -> list[Awaited]:
    return [awaited] * round(seconds / LOOK_S)


def test_a_long_wait_is_told_at_growing_intervals() -> None:
    lines = lines_of(looks(60.0, Awaited("the AV")))
    assert list(lines) == [FIRST_S, FIRST_S + AGAIN_S, FIRST_S + 3 * AGAIN_S, FIRST_S + 7 * AGAIN_S]
    assert lines[FIRST_S] == "waiting for the AV (3 s so far)"
    assert lines[FIRST_S + 3 * AGAIN_S] == "waiting for the AV (18 s so far)"


def test_something_else_is_told_sooner_but_not_in_a_row() -> None:
    lines = lines_of([*looks(20.0, Awaited("maps")), *looks(1.0, Awaited("cars")), *looks(40.0, Awaited("the AV"))])
    assert list(lines) == [3.0, 8.0, 18.0, 23.0, 28.0, 38.0, 58.0]
    assert lines[18.0] == "waiting for maps (18 s so far)"
    assert lines[23.0] == "waiting for the AV (2 s so far)"


def test_who_goes_on_is_silent() -> None:
    steps = [one for step in range(50) for one in looks(FIRST_S - LOOK_S, Awaited(f"a to finish step {step}", step))]
    assert lines_of(steps) == {}
    assert lines_of(looks(60.0, Awaited(""))) == {}
    lines = lines_of([*steps, *looks(FIRST_S + LOOK_S, Awaited("b to finish step 50", 50, "it compiles"))])
    assert list(lines.values()) == ["waiting for b to finish step 50 (3 s so far; it compiles)"]


def test_the_thread_asks_and_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(waiting, "LOOK_S", 0.001)
    monkeypatch.setattr(waiting, "FIRST_S", 0.0)
    monkeypatch.setattr(waiting, "AGAIN_S", 0.0)
    said, stream = threading.Event(), io.StringIO()
    with Waiting("cosim", "libraries", stream) as thread:
        thread.expect("the AV")
        printed = thread.say

        def say(line: str) -> None:
            printed(line)
            said.set()

        thread.say = say
        assert said.wait(30.0)
    assert stream.getvalue().splitlines()[-1].startswith("cosim: waiting for the AV")
