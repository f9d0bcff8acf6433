"""Divides the ground into regions without overlaps: carriageway, shoulder, sidewalk, median, verge and grass.

The free places for objects lie outside the space of traffic, and no object lies inside another.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely.geometry import LineString, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry

from siren_ros.base.numerics.arrays import Flags, Points
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError
from siren_ros.simulation.roads.road_network import JunctionKind, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import TOWN_LIMIT_MPS


@dataclass(frozen=True)
class SceneConfig:
    """Numbers that decide how the static scene is generated. Lengths and heights in metres."""

    ground_margin_m: float = 150.0
    """Width of the grass around the map's bounds."""
    road_extension_m: float = 90.0
    """Length by which roads continue beyond a dead end of the network, in pictures only."""
    kerb_height_m: float = 0.13
    kerb_width_m: float = 0.15
    verge_width_m: float = 2.0
    """Width of the gravel beside the carriageway, on maps without sidewalks."""
    line_width_m: float = 0.12
    """Width of longitudinal lines (RMS, German road markings: 0.12 m in towns)."""
    dash_m: float = 3.0
    """Length of the dashes of lane dividers (RMS: in towns 3 m line, 6 m gap)."""
    dash_gap_m: float = 6.0
    solid_before_junction_m: float = 20.0
    """Lane dividers are solid this far before a signal or stop sign."""
    stop_line_depth_m: float = 0.5
    zebra_stripe_m: float = 0.5
    zebra_depth_m: float = 2.6
    """Length of the stripes of crossings that the map does not define."""
    lamp_spacing_m: float = 34.0
    lamp_height_m: float = 7.5
    tree_spacing_m: float = 13.0
    building_setback_m: float = 3.0
    """Distance from the sidewalk's outer edge, or from the verge, to the façade."""
    building_height_m: tuple[float, float] = (6.0, 25.0)
    skyline_m: float = 90.0
    """How far behind the road the second row of buildings reaches."""
    open_country_m: float = 80.0
    """Beside roads out of town there are no street's lamps, trees and houses within this distance."""
    rail_spacing_m: float = 4.0
    """Distance between the posts of crash barriers along roads out of town."""
    clearance_m: float = 4.6
    """Nothing hangs lower than this over lanes, shoulders and junctions (StVO: 4.5 m headroom)."""
    parked_share: float = 0.0
    """Share of the parking places along the roads that have a parked vehicle."""
    size_spread: float = 0.0
    """Largest relative difference between the size of a parked vehicle and that of its class."""
    clutter_per_100_m: float = 0.0
    """Pieces of furniture and clutter on 100 m of the roads' edges, where there is space."""
    colour_share: float = 0.0
    """How far the reflectivity of painted surfaces for a LiDAR follows their colour, 0 to 1."""
    tile_m: float = 30.0
    """Surfaces are cut to tiles of this size, so that ray casting finds compact triangles."""

    def __post_init__(self) -> None:
        for name in (
            "ground_margin_m",
            "road_extension_m",
            "kerb_height_m",
            "verge_width_m",
            "skyline_m",
            "open_country_m",
            "parked_share",
            "size_spread",
            "clutter_per_100_m",
            "colour_share",
        ):
            if getattr(self, name) < 0:
                raise InputError(name, getattr(self, name), "a number that is at least 0")
        for name in (
            "line_width_m",
            "dash_m",
            "dash_gap_m",
            "lamp_spacing_m",
            "tree_spacing_m",
            "rail_spacing_m",
            "tile_m",
            "zebra_stripe_m",
        ):
            if getattr(self, name) <= 0:
                raise InputError(name, getattr(self, name), "a number of metres above 0")
        low, high = self.building_height_m
        if not 3.0 <= low <= high:
            raise InputError("building_height_m", self.building_height_m, "lowest and highest, at least 3 m")


GRID_M: Final = 0.001
"""Regions' corners lie on this grid, so that neighbours share them exactly."""
_MOUTH_M: Final = 3.0
"""Length of the lane ends that count as carriageway of a junction."""
_CORNER_M: Final = 4.0
"""Gaps between the paths across a junction are paved if they are narrower than twice this."""
_SMALLEST_MEDIAN_M2: Final = 6.0
_SMALLEST_HOLE_M2: Final = 1.0


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Regions of the ground. ``keep_clear`` is the space of traffic; the others do not overlap, except ``cycle``."""

    carriageway: BaseGeometry
    """Driving lanes and the paved part of junctions."""
    shoulder: BaseGeometry
    """Shoulders and cycle lanes."""
    cycle: BaseGeometry
    """The part of ``shoulder`` that is cycle lanes."""
    sidewalk: BaseGeometry
    median: BaseGeometry
    verge: BaseGeometry
    """Gravel beside the carriageway, on maps without sidewalks."""
    keep_clear: BaseGeometry
    """Driving lanes, shoulders, outlines of junctions and crossings: no object may stand here."""
    junctions: BaseGeometry
    country: BaseGeometry
    """Roads out of town and the land beside them: the speed limit is above that of towns, and there is no sidewalk."""
    bounds_m: tuple[float, float, float, float]

    @property
    def paved(self) -> BaseGeometry:
        """Carriageway and shoulders."""
        return union((self.carriageway, self.shoulder))

    @property
    def raised(self) -> BaseGeometry:
        """The regions a kerb's height above the carriageway."""
        return union((self.sidewalk, self.median))


def drawn_centres(network: RoadNetwork, extension_m: float) -> dict[int, Polyline]:
    """Centre lines by lane index. Lanes at a dead end of the map continue straight on, unless another road is near."""
    centres = {lane.index: lane.centre for lane in network.lanes}
    if extension_m <= 0:
        return centres
    roads = shapely.STRtree([LineString(lane.centre.points) for lane in network.lanes])
    for edge in network.edges:
        if edge.internal:
            continue
        for junction_id, at_end in ((edge.from_junction, False), (edge.to_junction, True)):
            junction = network.junctions.get(junction_id)
            if junction is None or junction.kind is not JunctionKind.DEAD_END:
                continue
            last = network.lanes[edge.lanes[-1]]
            ends = (last.length_m + 1.0, last.length_m + extension_m) if at_end else (-extension_m, -1.0)
            corridor = LineString(last.centre.at(ends)).buffer(8.0, cap_style="flat")
            if len(roads.query(corridor, predicate="intersects")) == 0:
                for index in edge.lanes:
                    length_m = centres[index].length_m
                    reach = (0.0, length_m + extension_m) if at_end else (-extension_m, length_m)
                    centres[index] = centres[index].cut(*reach)
    return centres


def strip(centre: Polyline, width_m: float) -> Polygon:
    """The area of a lane: its centre line widened, with square ends."""
    area = LineString(centre.points).buffer(width_m / 2, cap_style="flat", join_style="mitre", mitre_limit=2.0)
    return shapely.set_precision(area, GRID_M)


def union(parts: Iterable[BaseGeometry]) -> BaseGeometry:
    """Union of areas on the grid. It repairs areas that cross themselves; the union of nothing is empty."""
    shapes = [part if part.is_valid else part.buffer(0) for part in parts if not part.is_empty]
    return areal(shapely.union_all(shapes, grid_size=GRID_M)) if shapes else MultiPolygon()


def difference(area: BaseGeometry, *others: BaseGeometry) -> BaseGeometry:
    """The part of an area outside the others, on the grid."""
    for other in others:
        if not other.is_empty:
            area = areal(shapely.difference(area, other, grid_size=GRID_M))
    return area


def intersection(area: BaseGeometry, other: BaseGeometry) -> BaseGeometry:
    """The intersection of two areas, on the grid."""
    return areal(shapely.intersection(area, other, grid_size=GRID_M))


def areal(shape: BaseGeometry) -> BaseGeometry:
    """The areas of a geometry, without the lines and points that overlays leave behind."""
    return shape if isinstance(shape, Polygon | MultiPolygon) else MultiPolygon(polygons(shape, 0.0))


def closed(area: BaseGeometry, radius_m: float) -> BaseGeometry:
    """Fill gaps and notches of an area that are narrower than twice the radius; outer corners stay as they are."""
    return area.buffer(radius_m, join_style="mitre", mitre_limit=2.0).buffer(-radius_m, join_style="mitre")


def polygons(area: BaseGeometry, smallest_m2: float = 1e-4) -> list[Polygon]:
    """The polygons of a geometry, without lines and points."""
    parts: Sequence[BaseGeometry] = shapely.get_parts(area).tolist() if hasattr(area, "geoms") else [area]
    kept: list[Polygon] = []
    for part in parts:
        if isinstance(part, Polygon):
            kept.extend([part] if part.area > smallest_m2 else [])
        elif hasattr(part, "geoms"):
            kept.extend(polygons(part, smallest_m2))
    return kept


def road_surfaces(network: RoadNetwork, centres: dict[int, Polyline], config: SceneConfig) -> Surfaces:
    """Regions of a map, from its lanes' areas and its junctions' outlines; ``centres`` come from ``drawn_centres``."""
    area = {lane.index: strip(centres[lane.index], lane.width_m) for lane in network.lanes}
    by_kind = {kind: union(area[x.index] for x in network.lanes if x.kind is kind) for kind in LaneKind}
    outlines = union(Polygon(j.outline).buffer(0) for j in network.junctions.values() if len(j.outline) > 2)
    crossings = union(Polygon(outline).buffer(0) for outline in network.crossings if len(outline) > 2)
    driving = by_kind[LaneKind.DRIVING]
    across = union(
        area[lane.index]
        for lane in network.lanes
        if lane.kind is LaneKind.INTERNAL and (lane.civilian_allowed or lane.emergency_allowed)
    )
    heart = junction_carriageway(network, across, outlines)
    crossed = intersection(crossings, outlines)
    beside = union(area[x.index] for x in network.lanes if x.kind in {LaneKind.SHOULDER, LaneKind.CYCLE})
    seams = closed(union((driving, beside)), 0.9)
    bare = difference(beside, driving, heart)
    drawn = union((driving, heart, across, crossed, seams, bare))
    # Narrow gaps between lanes and paths are paved, too.
    rings = [
        (part, [ring for ring in part.interiors if Polygon(ring).area > _SMALLEST_HOLE_M2]) for part in polygons(drawn)
    ]
    paved = union([Polygon(part.exterior, holes) for part, holes in rings])
    carriageway = difference(paved, bare)
    left_kerbs = union(area[lane.index] for lane in network.lanes if _is_left_of_traffic(network, lane))
    gaps = difference(closed(driving, 4.0), paved, outlines)
    median = MultiPolygon(
        polygons(difference(union((left_kerbs, gaps)), paved).buffer(-0.1).buffer(0.1), _SMALLEST_MEDIAN_M2)
    )
    median = difference(median, paved)
    walks = union((by_kind[LaneKind.SIDEWALK], by_kind[LaneKind.KERB]))
    has_walks = not by_kind[LaneKind.SIDEWALK].is_empty
    corners = closed(union((walks, paved, outlines)), 0.5) if has_walks else walks
    sidewalk = difference(corners, paved, median) if has_walks else difference(walks, paved, median)
    verge = MultiPolygon() if has_walks else difference(paved.buffer(config.verge_width_m), paved, median, sidewalk)
    with_walks = {lane.edge for lane in network.lanes if lane.kind is LaneKind.SIDEWALK}
    fast = (x.index for x in network.lanes if x.speed_limit_mps > TOWN_LIMIT_MPS and x.edge not in with_walks)
    country = union(area[index] for index in fast).buffer(config.open_country_m, quad_segs=4)
    shapely.prepare(country)
    points = np.concatenate([lane.centre.points for lane in network.lanes])
    (west, south), (east, north) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return Surfaces(
        carriageway=carriageway,
        shoulder=bare,
        cycle=intersection(by_kind[LaneKind.CYCLE], bare),
        sidewalk=sidewalk,
        median=median,
        verge=verge,
        keep_clear=union((paved, outlines, crossings)),
        junctions=outlines,
        country=country,
        bounds_m=(west, south, east, north),
    )


def junction_carriageway(network: RoadNetwork, across: BaseGeometry, outlines: BaseGeometry) -> BaseGeometry:
    """The paved part of the junctions: paths across them, the ends of their lanes, and the gaps between these."""
    mouths: list[Polygon] = []
    for lane in network.lanes:
        if lane.kind in {LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.CYCLE}:
            reach = min(_MOUTH_M, lane.length_m / 2)
            ends = (lane.centre.cut(0.0, reach), lane.centre.cut(lane.length_m - reach, lane.length_m))
            mouths.extend(strip(end, lane.width_m) for end in ends)
    filled = closed(union((across, *mouths)), _CORNER_M)
    return intersection(union((filled, across)), outlines)


def _is_left_of_traffic(network: RoadNetwork, lane: Lane) -> bool:
    """Whether an unused strip is on the left of a driving lane of its own edge."""
    rightward = network.edges[lane.edge].lanes[: lane.position]
    return lane.kind is LaneKind.KERB and any(network.lanes[i].kind is LaneKind.DRIVING for i in rightward)


_CELL_M: Final = 20.0


class FreeSpace:
    """Space that is still free for objects: outside the space of traffic and outside the objects placed so far."""

    def __init__(self, surfaces: Surfaces) -> None:
        self.keep_clear = surfaces.keep_clear
        shapely.prepare(self.keep_clear)
        self._placed: dict[tuple[int, int], list[BaseGeometry]] = {}

    def is_clear(self, area: BaseGeometry) -> bool:
        """Whether an area touches neither traffic's space nor anything placed."""
        near = (other for cell in _cells(area) for other in self._placed.get(cell, ()))
        return not any(other.intersects(area) for other in near) and not self.keep_clear.intersects(area)

    def clear_of_traffic(self, points: Points, radius_m: float) -> Flags:
        """For each point ``(N, 2)`` whether a disc around it lies outside traffic's space."""
        return ~np.asarray(shapely.dwithin(self.keep_clear, shapely.points(points), radius_m), dtype=np.bool_)

    def occupy(self, area: BaseGeometry) -> None:
        """Mark an area as taken."""
        for cell in _cells(area):
            self._placed.setdefault(cell, []).append(area)

    def place_disc(self, x_m: float, y_m: float, radius_m: float) -> bool:
        """Take a disc if it is clear; returns whether it was."""
        disc = Point(x_m, y_m).buffer(radius_m, quad_segs=4)
        if not self.is_clear(disc):
            return False
        self.occupy(disc)
        return True

    def first_clear(self, candidates: Points, radius_m: float) -> tuple[float, float] | None:
        """The first of some points ``(N, 2)`` around which a disc is clear; the disc is taken."""
        for x, y in candidates[self.clear_of_traffic(candidates, radius_m)]:
            if self.place_disc(float(x), float(y), radius_m):
                return float(x), float(y)
        return None


def _cells(area: BaseGeometry) -> list[tuple[int, int]]:
    """Cells of a square grid that an area's bounds touch."""
    west, south, east, north = (int(value // _CELL_M) for value in area.bounds)
    return [(i, j) for i in range(west, east + 1) for j in range(south, north + 1)]


def ring_samples(area: BaseGeometry, spacing_m: float) -> tuple[Points, Points]:
    """Points along an area's boundary and the unit tangents there; the area is on the left.

    Each of shape ``(N, 2)``.
    """
    places: list[Points] = []
    tangents: list[Points] = []
    for part in shapely.get_parts(area):
        oriented = shapely.geometry.polygon.orient(Polygon(part))
        for ring in (oriented.exterior, *oriented.interiors):
            if count := int(ring.length // spacing_m):
                s = np.arange(count) * (ring.length / count)
                here = shapely.get_coordinates(shapely.line_interpolate_point(ring, s))
                step = shapely.get_coordinates(shapely.line_interpolate_point(ring, (s + 0.2) % ring.length)) - here
                places.append(here)
                tangents.append(step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9))
    return np.concatenate([np.empty((0, 2)), *places]), np.concatenate([np.empty((0, 2)), *tangents])
