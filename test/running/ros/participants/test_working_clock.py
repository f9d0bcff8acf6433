"""The clock of time limits stands still while loops are compiled."""

import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import numba
import pytest
from numba.core import event

from siren_ros.running.ros.participants import working_clock
from siren_ros.running.ros.participants.working_clock import announcing, working_s


def test_it_goes_like_wall_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    began_s = working_s()
    now[0] += 2.5
    assert working_s() - began_s == pytest.approx(2.5)


def test_it_stands_from_the_first_compilation_that_begins_to_the_last_that_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    began_s = working_s()
    starts, ends = event.start_event, event.end_event
    for seconds, tells in ((1.0, starts), (2.0, starts), (4.0, ends), (8.0, ends)):
        now[0] += seconds
        tells("numba:compile")
        assert working_s() - began_s == pytest.approx(1.0)
    now[0] += 16.0
    assert working_s() - began_s == pytest.approx(17.0)


def test_numba_tells_it() -> None:
    began_s, began_working_s = time.monotonic(), working_s()
    numba.njit(lambda x: x + 1)(1)
    wall_s, counted_s = time.monotonic() - began_s, working_s() - began_working_s
    assert counted_s < 0.5 * wall_s


def test_it_is_known_while_a_loop_is_compiled_and_not_when_it_comes_from_the_cache(tmp_path: Path) -> None:
    program = """
        from numba.core import event
        from siren_ros.base.numerics.compiled import compiled
        from siren_ros.running.ros.participants.working_clock import is_compiling

        class Later(event.Listener):
            def on_start(self, _):
                seen.append(is_compiling())

            def on_end(self, _):
                pass

        seen = []
        event.register("numba:compile", Later())

        @compiled
        def doubled(x: float) -> float:
            return 2.0 * x

        doubled(1.0)
        print(seen, is_compiling())
    """
    (tmp_path / "program.py").write_text(textwrap.dedent(program))
    for expected in ("[True] False", "[] False"):
        run = subprocess.run(
            [sys.executable, "program.py"], check=True, cwd=tmp_path, capture_output=True, text=True, timeout=120
        )
        assert run.stdout.strip() == expected


def test_it_is_announced_while_a_loop_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    compiles, told = threading.Event(), threading.Semaphore(0)
    asked = threading.Semaphore(0)

    def is_compiling() -> bool:
        asked.release()
        return compiles.is_set()

    monkeypatch.setattr(working_clock, "ANNOUNCE_S", 0.001)
    monkeypatch.setattr(working_clock, "is_compiling", is_compiling)
    with announcing(told.release):
        assert asked.acquire(timeout=60.0)
        assert asked.acquire(timeout=60.0)
        assert not told.acquire(blocking=False)
        compiles.set()
        assert told.acquire(timeout=60.0)
        assert told.acquire(timeout=60.0)
    assert "compiling" not in {thread.name for thread in threading.enumerate()}
