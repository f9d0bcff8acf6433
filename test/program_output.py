"""What programs with a DDS participant print, without what Fast DDS itself prints there."""

from typing import IO, Final

_FAST_DDS: Final = "RTPS_TRANSPORT_SHM"
"""In a note on standard output that another process took a port at the same moment; the next port does as well."""


def own_lines(stdout: str) -> str:
    """A program's own output."""
    return "".join(line for line in stdout.splitlines(keepends=True) if _FAST_DDS not in line)


def next_line(stdout: IO[str] | None) -> str:
    """The next line of a running program's own output; empty where it has ended."""
    assert stdout is not None
    while _FAST_DDS in (line := stdout.readline()):
        pass
    return line
