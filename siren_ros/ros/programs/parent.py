"""The program that started a participant's process: without it nobody ends this one."""

import ctypes
import os
import signal
import sys
import threading
import time
from typing import Final

LOOK_S: Final = 0.5
CLOSE_S: Final = 10.0
"""A participant that runs has closed everything by then."""
_PR_SET_PDEATHSIG: Final = 1
"""``prctl(2)``: the signal that the kernel sends to this process when its parent ends."""


class Parent:
    """Who started this process."""

    def __init__(self, number: int) -> None:
        """Prepare for the parent's end, however it comes.

        A stopped process (SIGSTOP) would not notice it, so the kernel continues it then. If a node does not return
        from a callback, a thread kills the process after ``CLOSE_S``.

        Args:
            number: Process id of the parent; 0: this process does not depend on one.
        """
        self._number = number
        if not self._number:
            return
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGCONT))
        threading.Thread(target=self._watch, name="parent watch", daemon=True).start()

    @property
    def is_gone(self) -> bool:
        """Whether there was one, and it has ended."""
        return bool(self._number) and os.getppid() != self._number

    def _watch(self) -> None:
        while not self.is_gone:
            time.sleep(LOOK_S)
        time.sleep(CLOSE_S)
        os.kill(os.getpid(), signal.SIGKILL)
