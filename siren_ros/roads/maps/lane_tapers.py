"""Where a road changes its number of lanes, they fan out over a way on which nobody has to slow down."""

from typing import Final
from xml.etree.ElementTree import Element

from siren_ros.roads.movements import movement_turn_rad
from siren_ros.roads.road_network import Connection, RoadNetwork

_RADIUS_M: Final = 12.0
"""Makes a junction of about 22 m, over which a car goes one lane aside at 30 km/h with 3 m/s². netconvert's own joints
of 8 m allow 12 km/h."""
_SWERVE_RAD: Final = 0.5
"""Sum of the turns to both sides from which a joint needs more length."""


def taper_patches(network: RoadNetwork) -> list[Element]:
    """``node`` elements that lengthen the joints between two pieces of a road at which lanes fan out too sharply.

    Args:
        network: A net of netconvert, as ``parse_road_network`` gives it.
    """
    return [
        Element("node", id=junction, radius=f"{_RADIUS_M:g}")
        for junction, movements in network.connections_at.items()
        if _only_joins(network, [one for _, one in movements])
        and any(movement_turn_rad(network, one) > _SWERVE_RAD for _, one in movements)
    ]


def _only_joins(network: RoadNetwork, movements: list[Connection]) -> bool:
    """Whether all movements lead straight on, without control, each from one road piece to one other."""
    plain = all(one.direction == "s" and one.signal_id is None and not one.must_stop for one in movements)
    pairs = {(network.lanes[one.from_lane].edge, network.lanes[one.to_lane].edge) for one in movements}
    return plain and all(len({pair[side] for pair in pairs}) == len(pairs) for side in (0, 1))
