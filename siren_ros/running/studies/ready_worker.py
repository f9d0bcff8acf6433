"""Loaded by the server that forks a study's processes: a short episode, so that longer ones find everything ready.

Compiled loops, message types and parsers are loaded when they are first used. A forked process has its server's.
"""

import gc
import signal
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from siren_ros.base.processes.interrupts import signal_at_end_of_parent
from siren_ros.errors import SirenError

_SHORT_S: Final = 1.0


def _make_ready() -> None:
    from siren_ros.running.studies.workers import attempt_episode  # noqa: PLC0415 - as above
    from siren_ros.simulation.scenario.episode import EpisodeRequest  # noqa: PLC0415 - its loading ends with the program, too

    with suppress(SirenError, OSError), TemporaryDirectory() as folder:  # the study's own episodes tell what is wrong
        attempt_episode(EpisodeRequest(duration_s=_SHORT_S, sensors="none"), Path(folder) / "bag")
    gc.collect()
    gc.freeze()  # what is loaded stays, and is shared


def _end(*_: object) -> None:
    raise SystemExit


_usual = signal.signal(signal.SIGTERM, _end)
signal_at_end_of_parent(signal.SIGTERM)  # the server itself looks for its program's end only when it is ready
_make_ready()
signal_at_end_of_parent(0)
signal.signal(signal.SIGTERM, _usual)
