"""Loaded by the server that forks a study's processes: a short episode, so that longer ones find everything ready.

Compiled loops, message types and parsers are loaded when they are first used. A forked process has its server's.
"""

import gc
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from siren_ros.errors import SirenError
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.studies.workers import attempt_episode

_SHORT_S: Final = 1.0


def _make_ready() -> None:
    with suppress(SirenError, OSError), TemporaryDirectory() as folder:  # the study's own episodes tell what is wrong
        attempt_episode(EpisodeRequest(duration_s=_SHORT_S, sensors="none"), Path(folder) / "bag")
    gc.collect()
    gc.freeze()  # what is loaded stays, and is shared


_make_ready()
