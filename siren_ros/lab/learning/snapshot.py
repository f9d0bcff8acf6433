"""Snapshots: an episode waits after its warm-up in a process of its own, and each fork of that process is a run of it.

SUMO's own saved states leave out parts of the drivers' models; a fork has the whole memory, so that a run gives the
same bytes as an episode that is simulated from its beginning.
"""

import gc
import os
import signal
import warnings
from collections.abc import Callable, Generator
from contextlib import suppress
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, Final

from siren_ros.errors import EpisodeError, SirenError
from siren_ros.running.generation.closed_loop import LoopStep, closed_loop
from siren_ros.running.generation.episode_setup import EpisodeSetup, set_up_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.world.commands import Controls

Snapshot = tuple[EpisodeSetup, Connection, int]
"""An episode, the connection to the process that waits after its first step, and that process's id."""
_BEGIN: Final = "begin"
_END: Final = None
"""Ends a run; between runs it ends the process. It is also the process's last answer of a run."""
_GONE: Final = "the process that simulated the episode has ended"


def take_snapshot(request: EpisodeRequest) -> Snapshot:
    """Set an episode up and let a new process simulate it up to its first step.

    The process is a fork: modules and compiled loops are loaded there as here. It ends with ``drop_snapshot`` or with
    this process.

    Raises:
        InputError: The request cannot be used.
    """
    setup = set_up_episode(request)
    here, there = Pipe()
    child = _forked(partial(_wait_for_runs, here, there, setup))
    there.close()
    return setup, here, child


def drop_snapshot(snapshot: Snapshot) -> None:
    """End the process of a snapshot; no run of it goes on."""
    _, connection, child = snapshot
    with suppress(OSError):
        connection.send(_END)
    connection.close()
    os.waitpid(child, 0)


def run_of(snapshot: Snapshot) -> Generator[LoopStep, Controls | None, None]:
    """A run of the episode, as ``closed_loop``; one at a time.

    Raises:
        EpisodeError: As ``closed_loop``, or the process has ended.
    """
    connection = snapshot[1]
    try:
        connection.send(_BEGIN)
        while True:
            answer = connection.recv()
            if isinstance(answer, SirenError):
                raise answer
            connection.send((yield answer) or {})
    except (EOFError, OSError) as error:
        raise EpisodeError(_GONE) from error
    finally:
        with suppress(EOFError, OSError):
            connection.send(_END)
            while connection.recv() is not _END:  # an answer that nobody waits for any more
                pass


def _forked(work: Callable[[], Any]) -> int:
    """Let a child process do some work; returns its id."""
    with warnings.catch_warnings():
        # Python 3.12 warns where the program has threads; the child has none, and takes no lock of theirs.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child:
        return child
    status = 1
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to this process, too
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        work()
        status = 0
    finally:
        os._exit(status)  # the program's own contexts and buffers are not this process's


def _answer_of(advance: Callable[[], LoopStep]) -> LoopStep | SirenError:
    """The next step, or why there is none."""
    try:
        return advance()
    except SirenError as error:
        return error
    except Exception as error:  # noqa: BLE001 - the program that asks gets it
        return EpisodeError(f"{type(error).__name__}: {error}")


def _wait_for_runs(other_end: Connection, connection: Connection, setup: EpisodeSetup) -> None:
    """Simulate the first step; then begin a run each time that one is asked for."""
    other_end.close()  # the program's: reading fails when it ends
    SumoSimulation.close()  # the copy of one that the program runs
    loop = closed_loop(setup, setup.steps)
    first = _answer_of(partial(next, loop))
    gc.collect()
    gc.freeze()  # what is there is shared with the runs
    while connection.recv() is not _END:
        _, status = os.waitpid(_forked(partial(_run, connection, loop, first)), 0)
        if status:
            connection.send(EpisodeError(_GONE))
            while connection.recv() is not _END:
                pass
        connection.send(_END)


def _run(
    connection: Connection, loop: Generator[LoopStep, Controls | None, None], answer: LoopStep | SirenError
) -> None:
    """Answer controls with steps until the run ends."""
    connection.send(answer)
    while (controls := connection.recv()) is not _END:
        connection.send(_answer_of(partial(loop.send, controls)))
