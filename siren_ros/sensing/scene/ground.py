"""Builds the ground: painted road markings as polygons, and the triangles of every region at its height.

Dimensions of markings follow the German guideline for road markings (RMS): lines 0.12 m, dashes 3 m with 6 m gaps, stop
lines 0.5 m, crossing stripes 0.5 m. Arrows are drawn 4 m long, 8 m before the stop line. The triangles have kerbs
between regions of different height, no gaps and no overlaps.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely.affinity import scale
from shapely.geometry import LineString, Polygon
from shapely.geometry import box as rectangle
from shapely.geometry.base import BaseGeometry

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.sensing.meshes.mesh import Material, Mesh
from siren_ros.sensing.meshes.solids import Rgb, flat_polygons, walls
from siren_ros.sensing.scene.surfaces import SceneConfig, Surfaces, difference, intersection, polygons, union
from siren_ros.simulation.roads.road_network import Edge, Junction, JunctionKind, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import opposite_edges

_ARROW_BEFORE_END_M: Final = 8.0
_SIDE_GAP_M: Final = 0.15
"""Gap between a line at the edge of a lane and the lane's boundary."""
_ONCOMING_M: Final = 14.0


@dataclass(frozen=True, eq=False)
class Markings:
    """Areas of white and yellow paint. They do not overlap and lie inside the paved surfaces."""

    white: BaseGeometry
    yellow: BaseGeometry


def road_markings(
    network: RoadNetwork, centres: dict[int, Polyline], surfaces: Surfaces, config: SceneConfig
) -> Markings:
    """All road markings of a map, cut to its paved surfaces; ``centres`` come from ``drawn_centres``."""
    painter = _Painter(network, centres, config)
    white: list[Polygon] = []
    yellow: list[Polygon] = []
    for edge in network.edges:
        if not edge.internal:
            white.extend(painter.dividers(edge))
            white.extend(painter.right_edge_line(edge))
            target, lines = painter.centre_line(edge)
            (yellow if target == "yellow" else white).extend(lines)
    lengthwise = difference(union(white), surfaces.junctions)
    centre = difference(union(yellow), surfaces.junctions)
    across = [stripe for lane in network.lanes for stripe in painter.approach(lane)]
    stripes = [stripe for lane in network.lanes if lane.kind is LaneKind.CROSSING for stripe in painter.zebra(lane)]
    if not network.crossings and any(lane.kind is LaneKind.SIDEWALK for lane in network.lanes):
        stripes.extend(painter.added_crossings())
    inside = surfaces.paved.buffer(-0.02)
    yellow_area = intersection(centre, inside)
    white_area = difference(intersection(union((lengthwise, *across, *stripes)), inside), yellow_area)
    return Markings(white=white_area, yellow=yellow_area)


class _Painter:
    """Draws the markings of one map."""

    def __init__(self, network: RoadNetwork, centres: dict[int, Polyline], config: SceneConfig) -> None:
        self.network = network
        self.centres = centres
        self.config = config
        self.roads = tuple(edge for edge in network.edges if not edge.internal)
        self.opposite = opposite_edges(network)
        self.divided = _edges_beside_oncoming(network)

    def driving(self, edge: Edge) -> list[Lane]:
        """Driving lanes of an edge, from right to left."""
        return [self.network.lanes[i] for i in edge.lanes if self.network.lanes[i].kind is LaneKind.DRIVING]

    def must_wait(self, lane: Lane) -> bool:
        """Whether a signal or a stop sign stands at the end of a lane."""
        movements = self.network.connections_from.get(lane.index, ())
        return any(movement.has_stop_line for movement in movements)

    def dividers(self, edge: Edge) -> Iterator[Polygon]:
        """Dashed lines between driving lanes of the same direction, solid ahead of signals and stop signs."""
        lanes = self.driving(edge)
        for right, left in itertools.pairwise(lanes):
            if left.position != right.position + 1:
                continue
            centre = self.centres[right.index]
            solid = self.config.solid_before_junction_m if self.must_wait(right) or self.must_wait(left) else 0.0
            end = max(0.0, centre.length_m - solid)
            yield from self.dashes(centre, right.width_m / 2, 0.0, end)
            if solid:
                yield ribbon(centre, end, centre.length_m, right.width_m / 2, self.config.line_width_m)

    def dashes(self, centre: Polyline, left_m: float, from_m: float, to_m: float) -> Iterator[Polygon]:
        """Dashes along a line parallel to a curve."""
        period = self.config.dash_m + self.config.dash_gap_m
        for start in np.arange(from_m, to_m - 0.5, period):
            yield ribbon(centre, start, min(start + self.config.dash_m, to_m), left_m, self.config.line_width_m)

    def right_edge_line(self, edge: Edge) -> Iterator[Polygon]:
        """The solid line between the carriageway and the shoulder or kerb."""
        lanes = self.driving(edge)
        if lanes:
            lane = lanes[0]
            beyond = self.network.neighbour(lane, -1)
            inset = 0.0 if beyond is not None and beyond.kind is LaneKind.SHOULDER else _SIDE_GAP_M
            centre = self.centres[lane.index]
            yield ribbon(centre, 0.0, centre.length_m, -lane.width_m / 2 + inset, self.config.line_width_m)

    def centre_line(self, edge: Edge) -> tuple[str, list[Polygon]]:
        """The line left of the leftmost driving lane: yellow towards oncoming traffic, otherwise white."""
        lanes = self.driving(edge)
        if not lanes:
            return "white", []
        lane = lanes[-1]
        centre = self.centres[lane.index]
        side = lane.width_m / 2
        opposite = self.opposite.get(edge.index)
        if opposite is not None and len(lanes) == 1 and len(self.driving(self.network.edges[opposite])) == 1:
            paints = edge.index < opposite  # two edges share this line; only one of them paints it
            return "yellow", list(self.dashes(centre, side, 0.0, centre.length_m)) if paints else []
        line = ribbon(centre, 0.0, centre.length_m, side - _SIDE_GAP_M, self.config.line_width_m)
        return ("yellow" if edge.index in self.divided else "white"), [line]

    def approach(self, lane: Lane) -> Iterator[Polygon]:
        """Stop line and turn arrows at the end of a driving lane."""
        if lane.kind is not LaneKind.DRIVING or not self.must_wait(lane):
            return
        end = lane.length_m
        yield ribbon(lane.centre, end - self.config.stop_line_depth_m, end, 0.0, lane.width_m)
        letters = {c.direction.lower() for c in self.network.connections_from.get(lane.index, ())}
        tip = end - _ARROW_BEFORE_END_M
        if tip > 5.0:
            yield from arrow(lane.centre, tip, letters)

    def zebra(self, lane: Lane) -> Iterator[Polygon]:
        """Stripes of a crossing that the map defines; ``lane`` is the crossing's lane, in walking direction."""
        stripe = self.config.zebra_stripe_m
        for start in np.arange(0.25, lane.length_m - stripe, 2 * stripe):
            yield ribbon(lane.centre, start, start + stripe, 0.0, lane.width_m)

    def added_crossings(self) -> Iterator[Polygon]:
        """Stripes across the approaches of signalised junctions, just inside the junction."""
        for edge in self.roads:
            for junction_id, at_end in ((edge.to_junction, True), (edge.from_junction, False)):
                junction: Junction | None = self.network.junctions.get(junction_id)
                paved = {LaneKind.DRIVING, LaneKind.SHOULDER}
                lanes = [self.network.lanes[i] for i in edge.lanes if self.network.lanes[i].kind in paved]
                if junction is None or junction.kind is not JunctionKind.SIGNAL or not lanes:
                    continue
                yield from self._half_crossing(lanes, at_end=at_end)

    def _half_crossing(self, lanes: Sequence[Lane], *, at_end: bool) -> Iterator[Polygon]:
        reference = lanes[-1]
        left = reference.width_m / 2
        right = left - sum(lane.width_m for lane in lanes)
        stripe, depth = self.config.zebra_stripe_m, self.config.zebra_depth_m
        start = reference.length_m + 0.9 if at_end else -0.9 - depth
        for offset in np.arange(left - 0.25 - stripe / 2, right + stripe / 2, -2 * stripe):
            yield ribbon(reference.centre, start, start + depth, offset, stripe)


def ribbon(centre: Polyline, from_m: float, to_m: float, left_m: float, width_m: float) -> Polygon:
    """A strip along a curve between two arc lengths; its centre line is ``left_m`` to the left of the curve."""
    inner = centre.arc_m[(centre.arc_m > from_m + 0.01) & (centre.arc_m < to_m - 0.01)]
    s = np.concatenate(([from_m], inner, [to_m]))
    left = _mitred(centre, s, left_m + width_m / 2)
    right = _mitred(centre, s, left_m - width_m / 2)
    return Polygon(np.concatenate((right, left[::-1])))


def _mitred(centre: Polyline, s_m: Floats, left_m: float) -> Floats:
    """Points beside a curve; at the curve's corners they lie on the bisector, so that the width stays the same."""
    after = centre.heading_rad(s_m + 1e-6)
    before = centre.heading_rad(s_m - 1e-6)
    turn = np.arctan2(np.sin(after - before), np.cos(after - before))
    heading = before + turn / 2
    normal = np.stack((-np.sin(heading), np.cos(heading)), axis=-1)
    reach = left_m / np.maximum(np.cos(turn / 2), 0.3)
    return centre.at(s_m) + reach[:, None] * normal


def _arrow_shapes() -> dict[str, Polygon]:
    """Arrow shapes in lane coordinates (s forward, l left); the tip of the straight arrow is at the origin."""
    shaft = Polygon([(-4, -0.09), (-1.4, -0.09), (-1.4, 0.09), (-4, 0.09)])
    head = Polygon([(-1.5, -0.36), (0, 0), (-1.5, 0.36)])
    stem = Polygon([(-4, -0.09), (-2.3, -0.09), (-1.75, 0.3), (-1.75, 0.5), (-2.05, 0.42), (-2.45, 0.09), (-4, 0.09)])
    hook = Polygon([(-2.25, 0.46), (-1.9, 1.05), (-1.45, 0.46)])
    left = shapely.union_all([stem, hook])
    return {"s": shapely.union_all([shaft, head]), "l": left, "r": scale(left, yfact=-1.0, origin=(0, 0))}


_ARROWS: Final = _arrow_shapes()


def arrow(centre: Polyline, tip_m: float, letters: set[str]) -> Iterator[Polygon]:
    """The arrow for the movements of a lane, given by SUMO's letters in lower case; a U-turn counts as left."""
    for letter in sorted({"l" if letter == "t" else letter for letter in letters} & set(_ARROWS)):
        corners = np.asarray(_ARROWS[letter].exterior.coords)
        yield Polygon(centre.offset_points(tip_m + corners[:, 0], corners[:, 1]))


def _edges_beside_oncoming(network: RoadNetwork) -> frozenset[int]:
    """Edges with oncoming traffic on their left, within ``_ONCOMING_M`` of their leftmost lane."""
    leftmost = [network.lanes[edge.lanes[-1]] for edge in network.edges if not edge.internal]
    lines = [LineString(lane.centre.points) for lane in leftmost]
    tree = shapely.STRtree(lines)
    beside_oncoming = set()
    for lane in leftmost:
        middle = lane.length_m / 2
        beside = LineString(lane.centre.offset_points((middle, middle), (0.5, _ONCOMING_M)))
        heading = float(lane.centre.heading_rad(middle))
        for other in tree.query(beside, predicate="intersects"):
            centre = leftmost[other].centre
            s, _ = centre.project(lane.centre.at(middle))
            if np.cos(float(centre.heading_rad(s)) - heading) < -0.8:
                beside_oncoming.add(lane.edge)
    return frozenset(beside_oncoming)


ASPHALT_RGB: Final[Rgb] = (74, 75, 78)
SHOULDER_RGB: Final[Rgb] = (92, 92, 93)
CYCLE_RGB: Final[Rgb] = (128, 72, 60)
WHITE_RGB: Final[Rgb] = (226, 226, 222)
YELLOW_RGB: Final[Rgb] = (222, 176, 44)
KERB_RGB: Final[Rgb] = (158, 156, 150)
SIDEWALK_RGB: Final[Rgb] = (146, 142, 136)
MEDIAN_RGB: Final[Rgb] = (98, 124, 62)
VERGE_RGB: Final[Rgb] = (132, 118, 94)
GRASS_RGB: Final[Rgb] = (92, 122, 58)
_BEDROCK_DEPTH_M: Final = 0.05
"""Depth of a plane below everything; it catches rays that pass between two surfaces."""


def ground_mesh(surfaces: Surfaces, markings: Markings, config: SceneConfig) -> Mesh:
    """Triangles of the ground.

    The carriageway with its markings is at z 0; sidewalks and medians are higher by a kerb; grass lies around.
    """
    west, south, east, north = surfaces.bounds_m
    margin = config.ground_margin_m
    land = rectangle(west - margin, south - margin, east + margin, north + margin)
    painted = union((markings.white, markings.yellow))
    paved, raised = surfaces.paved, intersection(surfaces.raised, land)
    kerb = intersection(raised, paved.buffer(config.kerb_width_m))
    grass = difference(land, union((paved, raised, surfaces.verge)))
    top = config.kerb_height_m
    flat: tuple[tuple[BaseGeometry, float, Material, Rgb], ...] = (
        (difference(surfaces.carriageway, painted), 0.0, Material.ASPHALT, ASPHALT_RGB),
        (difference(surfaces.shoulder, painted, surfaces.cycle), 0.0, Material.SHOULDER_ASPHALT, SHOULDER_RGB),
        (difference(surfaces.cycle, painted), 0.0, Material.SHOULDER_ASPHALT, CYCLE_RGB),
        (markings.white, 0.0, Material.MARKING_WHITE, WHITE_RGB),
        (markings.yellow, 0.0, Material.MARKING_YELLOW, YELLOW_RGB),
        (kerb, top, Material.KERB, KERB_RGB),
        (difference(intersection(surfaces.sidewalk, land), kerb), top, Material.SIDEWALK, SIDEWALK_RGB),
        (difference(intersection(surfaces.median, land), kerb), top, Material.MEDIAN, MEDIAN_RGB),
        (surfaces.verge, 0.0, Material.GROUND, VERGE_RGB),
        (grass, 0.0, Material.GRASS, GRASS_RGB),
    )
    parts = [
        flat_polygons([tile for part in polygons(area) for tile in tiles_of(part, config.tile_m)], z, material, colour)
        for area, z, material, colour in flat
    ]
    parts.extend(walls(part, 0.0, top, Material.KERB, KERB_RGB) for part in polygons(raised))
    parts.append(flat_polygons([land], -_BEDROCK_DEPTH_M, Material.GROUND, VERGE_RGB))
    return Mesh.joined(*parts)


def tiles_of(area: BaseGeometry, tile_m: float) -> list[shapely.Polygon]:
    """Cut an area into pieces along the lines of a square grid."""
    columns = [area]
    for axis in (0, 1):
        pieces: list[shapely.Polygon] = []
        for piece in columns:
            low, high = piece.bounds[axis], piece.bounds[axis + 2]
            lines = np.arange(np.floor(low / tile_m), np.ceil(high / tile_m) + 1) * tile_m
            if len(lines) <= 2:
                pieces.append(piece)
                continue
            for start, end in itertools.pairwise(lines):
                limits = (start, -1e6, end, 1e6) if axis == 0 else (-1e6, start, 1e6, end)
                pieces.extend(polygons(shapely.clip_by_rect(piece, *limits)))
        columns = pieces
    return columns
