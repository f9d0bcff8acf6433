"""A site: the place on a map where an interaction happens. Each kind of site has its requirements."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

SHORTEST_ROAD_M: Final = 60.0
"""Least length of a road of two lanes: 4 s at 50 km/h, enough for a yield lane change and a pass."""
SHORTEST_QUEUE_M: Final = 30.0
"""Least length of an approach for queues: four standing cars (7.5 m each) on each of two lanes."""
SHORTEST_SHOULDER_M: Final = 10.0
"""Least length of a shoulder before and after a right turn."""
ENOUGH_M: Final = 250.0
"""A site that is longer than this is not better for it."""


class SiteKind(StrEnum):
    """What a template looks for."""

    MULTI_LANE_ROAD = "multi_lane_road"
    QUEUED_APPROACH = "queued_approach"
    SIGNAL_JUNCTION = "signal_junction"
    STOP_JUNCTION = "stop_junction"
    SHOULDER_RIGHT_TURN = "shoulder_right_turn"


@dataclass(frozen=True)
class Site:
    """A place for an interaction, and the route on which the EMV drives through it."""

    kind: SiteKind
    name: str
    """Edges and junction, for people."""
    junction: str | None
    """The junction where it happens; None for a road."""
    route: tuple[int, ...]
    """Edge indices: the approach, the site, the way on. The way on may pass an edge again."""
    site_position: int
    """Position in ``route`` of ``site_edge``."""
    site_edge: int
    """The edge before the junction, or the first edge of the road."""
    stretch: tuple[int, ...]
    """Edges of the usable stretch in driving order: the road itself, or before a junction the approach whose lanes lead
    up to it."""
    approach_lane: int
    """The lane of ``site_edge`` that the EMV takes: the leftmost one that leads on; the shoulder for a turn on it."""
    length_m: float
    """Length of the usable stretch."""
    connections: tuple[int, ...]
    """Indices of the movements in the EMV's direction, from the right: at the junction, or at the end of the road."""
    crossing: tuple[int, ...]
    """Indices of the civilian movements that cross them: those from side streets, and all where these are short."""
    score: float
    """Higher is better, within a kind."""

    @property
    def beyond(self) -> tuple[int, ...]:
        """Edges of the route after ``site_edge``."""
        return self.route[self.site_position + 1 :]


REQUIREMENTS: Final[Mapping[SiteKind, str]] = {
    SiteKind.MULTI_LANE_ROAD: (
        f"a map with a road of two driving lanes or more in one direction, at least {SHORTEST_ROAD_M:.0f} m long"
    ),
    SiteKind.QUEUED_APPROACH: (
        "a map with a signalised junction that a road of two driving lanes or more leads to, with at least "
        f"{SHORTEST_QUEUE_M:.0f} m of room for queues"
    ),
    SiteKind.SIGNAL_JUNCTION: (
        "a map with a signalised junction where a movement straight on (or a turn) is crossed by another one"
    ),
    SiteKind.STOP_JUNCTION: "a map with a junction where a stop sign binds a movement that another one crosses",
    SiteKind.SHOULDER_RIGHT_TURN: (
        "a map with a right turn that has a shoulder open to emergency vehicles before it, beside it and after it, at "
        f"least {SHORTEST_SHOULDER_M:.0f} m long"
    ),
}
