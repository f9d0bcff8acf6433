"""Runs a short episode in the server that forks a study's processes, so that these start with everything loaded.

Compiled loops, message types and parsers are loaded when they are first used. A forked process has its server's.
"""

import gc
import signal
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from siren_ros.base.processes.interrupts import leave, signal_at_end_of_parent
from siren_ros.errors import SirenError

_SHORT_S: Final = 1.0


def _make_ready() -> None:
    from siren_ros.running.studies.run_study import attempt_episode  # noqa: PLC0415 - as above
    from siren_ros.simulation.scenario.episode import EpisodeRequest  # noqa: PLC0415 - its loading ends with the program, too

    with suppress(SirenError, OSError), TemporaryDirectory() as folder:  # the study's own episodes report what is wrong
        attempt_episode(EpisodeRequest(duration_s=_SHORT_S, sensors="none"), Path(folder) / "bag")
    gc.collect()
    gc.freeze()  # loaded objects stay and are shared with the forked processes


_usual = signal.signal(signal.SIGTERM, leave)
signal_at_end_of_parent(signal.SIGTERM)  # only when it is ready does the server check whether its program still exists
_make_ready()
signal_at_end_of_parent(0)
signal.signal(signal.SIGTERM, _usual)
