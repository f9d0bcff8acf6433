"""Which lanes lead across the junctions of a compiled net, from where to where."""

from collections.abc import Iterator
from typing import NamedTuple
from xml.etree.ElementTree import Element


class PathAcross(NamedTuple):
    """One movement across a junction, by the ids of its lanes."""

    source: str
    target: str
    via: tuple[str, ...]
    """In driving order. Long paths wait in the middle and have two; a movement without a path of its own has none."""


def paths_across(net: Element) -> Iterator[PathAcross]:
    """All movements of a net, in its order.

    Args:
        net: The root of a net file. A path's second part is the ``via`` of the connection that leaves its first.
    """
    connections = list(net.iterfind("connection"))
    onward = {_lane(one, "from"): one.get("via") for one in connections}
    for one in connections:
        source = _lane(one, "from")
        if source.startswith(":"):
            continue
        via, lane = [], one.get("via")
        while lane is not None:
            via.append(lane)
            lane = onward.get(lane)
        yield PathAcross(source, _lane(one, "to"), tuple(via))


def _lane(connection: Element, end: str) -> str:
    return f"{connection.get(end)}_{connection.get(f'{end}Lane')}"
