"""Where the middle of a recorded site is: of its junction, or half way along its road."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely

from siren_ros.roads.road_network import LaneKind, RoadNetwork

_TRAFFIC: Final = (LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL)


def middle_of_site(network: RoadNetwork, site: Mapping[str, object]) -> npt.NDArray[np.float64] | None:
    """Middle of a site's junction, or of its road where it has none, shape ``(2,)``; None where it has neither.

    Args:
        network: The map.
        site: The site as an episode's description gives it: ``junction``, ``stretch``.
    """
    name = site.get("junction")
    junction = network.junctions.get(str(name)) if name else None
    if junction is not None:
        if len(junction.outline) > 2:
            return np.asarray(shapely.Polygon(junction.outline).buffer(0).centroid.coords[0])
        return np.array([junction.x_m, junction.y_m])
    names = site.get("stretch")
    road = (
        [network.edge_by_id[one] for one in names if one in network.edge_by_id]
        if isinstance(names, list | tuple)
        else []
    )
    lanes = [[lane for lane in map(network.lanes.__getitem__, edge.lanes) if lane.kind in _TRAFFIC] for edge in road]
    lengths = [max((lane.length_m for lane in of_edge), default=0.0) for of_edge in lanes]
    if not sum(lengths) > 0.0:
        return None
    ends = np.cumsum(lengths)
    half = float(ends[-1]) / 2.0
    place = int(np.searchsorted(ends, half))
    share = 1.0 - (ends[place] - half) / lengths[place]
    return np.mean([lane.centre.at(share * lane.length_m) for lane in lanes[place]], axis=0)
