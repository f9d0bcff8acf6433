"""DDS domains that belong to one test process, so that workers, and whole test runs, go side by side."""

import socket
from typing import Final

_NUMBERS: Final = range(100, 0, -1)
"""From above, since people use the low ones; beyond, a domain's ports lie where the system hands out its own."""
_claims: list[socket.socket] = []


def own_domain() -> int:
    """A domain's number that no other test process of this machine has; kept until this one ends.

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
        return number
    raise RuntimeError("the tests of this machine hold all DDS domains")
