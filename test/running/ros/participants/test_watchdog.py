"""The participant that the lockstep waits for, and the clock that stands still while loops are compiled."""

import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import pytest
from numba.core import event

from siren_ros.data.interfaces.conversions import Phase
from siren_ros.data.lockstep import LockstepConfig, LockstepState, Stage
from siren_ros.running.ros.participants import watchdog
from siren_ros.running.ros.participants.watchdog import Work, announcing, awaited_by, overdue, working_s

OWN = ("sumo_bridge", "emv_controller", "vehicle_dynamics", "recorder")
CONFIG = LockstepConfig((*OWN, "my_stack", "av_controller"), 10)


def state(stage: Stage, *waiting: str, step: int = -1, owing: tuple[str, ...] = ()) -> LockstepState:
    return LockstepState(stage, step, frozenset(waiting), frozenset(owing))


EVERYBODY = state(Stage.GATHERING, *CONFIG.participants)
AT_WORK = (None, Work("recorder", Phase.READY, 0, 1.0), Work("sensor_sim", Phase.READY, 0, 1.0))


@pytest.mark.parametrize(
    ("awaited", "works", "text"),
    [
        (
            EVERYBODY,
            (),
            "av_controller to publish /av/control_cmd, my_stack to report READY on /siren/step_done, at most 120 s",
        ),
        (state(Stage.GATHERING, "sumo_bridge"), (), "sumo_bridge to be ready, at most 120 s"),
        (EVERYBODY, AT_WORK, "recorder to be ready, at most 120 s"),
        (
            state(Stage.GATHERING, *OWN),
            (),
            "emv_controller, recorder, sumo_bridge and 1 more to be ready, at most 120 s",
        ),
        (
            state(Stage.STEPPING, "emv_controller", "vehicle_dynamics", "recorder", step=3),
            (),
            "emv_controller to finish step 3, at most 20 s",
        ),
        (
            state(Stage.STEPPING, "sumo_bridge", step=3, owing=("recorder",)),
            (),
            "recorder to finish step 2, at most 20 s",
        ),
        (state(Stage.STEPPING, "recorder", step=0), (), "recorder to finish step 0, at most 120 s"),
        (state(Stage.CLOSING, "recorder", step=9), (), "recorder to close, at most 60 s"),
        (state(Stage.CLOSED, "recorder"), (), ""),
    ],
)
def test_what_the_episode_waits_for_is_named_with_the_longest_time(awaited, works, text) -> None:
    """Whoever is at work in this process comes first."""
    assert awaited_by(awaited, CONFIG, OWN, works) == text


def test_the_first_step_may_take_as_long_as_the_start() -> None:
    works = [None, Work("recorder", Phase.STEP, 0, 0.0)]
    assert overdue(works, CONFIG, 100.0) == "", "it may compile loops"
    assert overdue(works, CONFIG, 122.0) == "recorder: did not finish step 0 within 120 s"
    assert overdue([Work("recorder", Phase.STEP, 1, 0.0)], CONFIG, 22.0) == (
        "recorder: did not finish step 1 within 20 s"
    )


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


def test_it_is_known_while_a_loop_is_compiled_and_not_when_it_comes_from_the_cache(tmp_path: Path) -> None:
    program = """
        from numba.core import event
        from siren_ros.base.numerics.compiled import compiled
        from siren_ros.running.ros.participants.watchdog import is_compiling

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

    monkeypatch.setattr(watchdog, "ANNOUNCE_S", 0.001)
    monkeypatch.setattr(watchdog, "is_compiling", is_compiling)
    with announcing(told.release):
        assert asked.acquire(timeout=60.0)
        assert asked.acquire(timeout=60.0)
        assert not told.acquire(blocking=False)
        compiles.set()
        assert told.acquire(timeout=60.0)
        assert told.acquire(timeout=60.0)
    assert "compiling" not in {thread.name for thread in threading.enumerate()}
