"""Which lanes lead across the junctions of a compiled net, from where to where."""

from collections.abc import Callable, Iterator
from typing import Final, NamedTuple
from xml.etree.ElementTree import Element

LONGEST_VIA: Final = 100
"""netconvert cuts a movement into two or three junction lanes."""


class PathAcross(NamedTuple):
    """One movement across a junction, by the ids of its lanes."""

    source: str
    target: str
    via: tuple[str, ...]
    """In driving order. Long paths wait in the middle and have two; a movement without a path of its own has none."""


def way_across(first: str | None, onward: Callable[[str], str | None]) -> tuple[str, ...]:
    """The junction lanes of one movement in driving order.

    Args:
        first: The lane with which it begins; None where it has none.
        onward: The junction lane that follows on one; None after the last.

    Raises:
        ValueError: They lead on for ever, as those of a damaged net do.
    """
    via: list[str] = []
    lane = first
    while lane is not None:
        via.append(lane)
        if len(via) > LONGEST_VIA:
            raise ValueError(f"a way through junction lanes from {first} that does not end")
        lane = onward(lane)
    return tuple(via)


def paths_across(net: Element) -> Iterator[PathAcross]:
    """All movements of a net, in its order.

    Args:
        net: The root of a net file. A path's second part is the ``via`` of the connection that leaves its first.

    Raises:
        ValueError: A path does not end.
    """
    connections = list(net.iterfind("connection"))
    onward = {_lane(one, "from"): one.get("via") for one in connections}
    for one in connections:
        source = _lane(one, "from")
        if source.startswith(":"):
            continue
        yield PathAcross(source, _lane(one, "to"), way_across(one.get("via"), onward.get))


def _lane(connection: Element, end: str) -> str:
    return f"{connection.get(end)}_{connection.get(f'{end}Lane')}"
