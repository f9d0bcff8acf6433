"""The first worker of a run of all tests loads all modules before the others begin; they wait where this is imported.

Otherwise each of them compiles everything to bytecode where nothing is compiled yet, at the same time.
"""

import fcntl
import os
from contextlib import ExitStack
from pathlib import Path

FIRST = "gw0"
_VARIABLE = "SIREN_TESTS_FIRST_WORKER"
"""Names the file that is locked until the first worker has collected."""
_turn = ExitStack()


def begin_turn(file: Path) -> None:
    """In the process that starts the workers, before it does."""
    fcntl.flock(_turn.enter_context(file.open("w")), fcntl.LOCK_EX)
    os.environ[_VARIABLE] = str(file)


def end_turn() -> None:
    """The others go on; a second call does nothing."""
    _turn.close()


if _VARIABLE in os.environ and os.environ.get("PYTEST_XDIST_WORKER", FIRST) != FIRST:
    with Path(os.environ[_VARIABLE]).open() as _file:
        fcntl.flock(_file, fcntl.LOCK_SH)
