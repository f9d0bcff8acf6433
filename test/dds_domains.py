"""DDS domains that belong to one test process, so that workers, and whole test runs, go side by side."""

import socket
from functools import cache
from pathlib import Path
from typing import Final

_NUMBERS: Final = range(100, 0, -1)
"""From above, since people use the low ones; beyond, a domain's ports lie where the system hands out its own."""
_SOCKETS: Final = Path("/proc/net/unix")
_claims: list[socket.socket] = []


def own_domain() -> int:
    """A domain's number that no other test process and no episode of this machine has; kept until this process ends.

    The claim is a name of the kernel's, as an episode's own is.
    """
    for number in _NUMBERS:
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f"\0siren_ros/test domain/{number}")
        except OSError:
            claim.close()
            continue
        _claims.append(claim)
        if not _has_episode(number):
            return number
    raise RuntimeError("the tests and episodes of this machine hold all DDS domains")


@cache
def shared_domain() -> int:
    """The domain of all those tests of this process whose programs neither hear each other nor are killed."""
    return own_domain()


def _has_episode(number: int) -> bool:
    names = _SOCKETS.read_text(encoding="utf-8").split() if _SOCKETS.exists() else []
    return f"@siren_ros/domain/{number}" in names
