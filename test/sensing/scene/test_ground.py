"""The ground's triangles: heights and materials at places of a small crossing, areas without gaps."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from hand_made_record import crossing
from known_outputs import assert_known
from shapely.geometry import Polygon

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.sensing.scene.ground import arrow, ground_mesh, ribbon, road_markings, tiles_of
from siren_ros.sensing.scene.surfaces import SceneConfig, drawn_centres, road_surfaces
from siren_ros.simulation.roads.road_network import Edge, JunctionKind, Lane, LaneKind, RoadNetwork

CONFIG = SceneConfig(ground_margin_m=20.0, tile_m=40.0)
TOP_M = CONFIG.kerb_height_m


def ground_of(network):
    centres = drawn_centres(network, 0.0)
    surfaces = road_surfaces(network, centres, CONFIG)
    return surfaces, ground_mesh(surfaces, road_markings(network, centres, surfaces, CONFIG), CONFIG)


BARE = ground_of(crossing())
"""Without sidewalks, with a verge."""


def triangles(mesh):
    return np.asarray(mesh.vertices_m[mesh.triangles], dtype=np.float64)


def test_the_land_is_covered_once_with_a_plane_below():
    """The lanes reach from −110 to 120 m and from −120 to 110 m; the margin is 20 m."""
    surfaces, mesh = BARE
    assert surfaces.bounds_m == (-110.0, -120.0, 120.0, 110.0)
    corners = triangles(mesh)
    side = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.abs(side[:, 2])
    below = corners[:, 0, 2] < -0.01
    assert (corners[below, 0, 2], area[below].sum()) == (pytest.approx(-0.05), pytest.approx(270.0 * 270.0))
    assert area[~below].sum() == pytest.approx(270.0 * 270.0, rel=1e-6)
    assert (corners[:, :, 0].min(), corners[:, :, 1].max()) == (pytest.approx(-130.0), pytest.approx(130.0))
    assert (side[:, 2] > -1e-6).all(), "seen from above"


@pytest.mark.parametrize(
    ("area", "count"),
    [
        # By columns from the west: up to 22.5 m, 29.6 m, 31 m and 23.6 m.
        (Polygon([(-5.0, 1.0), (25.0, 1.0), (25.0, 19.0), (12.0, 31.0), (-5.0, 19.0)]), 3 + 3 + 4 + 3),
        (shapely.box(-12.0, 3.0, 25.0, 17.0) - shapely.box(0.0, 5.0, 5.0, 8.0), 10),
    ],
)
def test_areas_are_cut_along_a_grid_without_loss(area, count):
    tiles = tiles_of(area, 10.0)
    assert shapely.union_all(tiles).symmetric_difference(area).area < 1e-9
    assert sum(tile.area for tile in tiles) == pytest.approx(area.area)
    for tile in tiles:
        low_x, low_y, high_x, high_y = tile.bounds
        assert np.floor(low_x / 10.0) == np.floor((high_x - 1e-9) / 10.0)
        assert np.floor(low_y / 10.0) == np.floor((high_y - 1e-9) / 10.0)
    assert len(tiles) == count
    inside = Polygon([(1.0, 1.0), (9.0, 1.0), (9.0, 9.0)])
    assert tiles_of(inside, 10.0) == [inside]


def street(there, back):
    """A road of 100 m to the east with some lanes, and the way back north of y = 0."""
    lanes: list[Lane] = []
    edges = []
    for name, count, ends in (("there", there, ("A", "B")), ("back", back, ("B", "A"))):
        first = len(lanes)
        for position in range(count):
            y_m = 3.5 * (count - position) - 1.75
            points = [(0.0, -y_m), (100.0, -y_m)] if name == "there" else [(100.0, y_m), (0.0, y_m)]
            kind, centre = LaneKind.DRIVING, Polyline.through(points)
            lanes.append(
                Lane(len(lanes), f"{name}_{position}", len(edges), position, kind, centre, 3.5, 14.0, True, True)
            )
        edges.append(Edge(len(edges), name, tuple(range(first, len(lanes))), *ends, internal=False))
    return RoadNetwork(tuple(lanes), tuple(edges), (), {}, (0.0, 0.0), "!")


def with_short_approach(length_m):
    """The crossing with a shorter approach from the south."""
    network = crossing()
    for lane in network.lanes[:3]:
        end = lane.centre.points[-1]
        object.__setattr__(lane, "centre", Polyline.through(np.array([end - (0.0, length_m), end])))
    return network


def painted(network):
    """Areas of both colours, with their middles and the number of parts."""
    config, centres = SceneConfig(), drawn_centres(network, 0.0)
    markings = road_markings(network, centres, road_surfaces(network, centres, config), config)
    both = (markings.white, markings.yellow)
    return [
        (area.area, shapely.get_num_geometries(area), *area.bounds, area.centroid.x, area.centroid.y) for area in both
    ]


def test_markings(network):
    """Stop lines, dashes, edge lines, arrows and stripes of crossings, and of roads with one or two lanes each way."""
    networks = {
        "signals": crossing(), "stop sign": crossing(JunctionKind.PRIORITY_STOP), "legs": network,
        "one and one": street(1, 1), "two and one": street(2, 1), "one and two": street(1, 2),
        "no room for arrows": with_short_approach(12.5), "room for arrows": with_short_approach(13.5),
    }  # fmt: skip
    known = {name: painted(one) for name, one in networks.items()}
    centre = Polyline.through([(0.0, 0.0), (0.0, 50.0)])
    known["arrows"] = [part.bounds for part in arrow(centre, 30.0, {"t", "s", "x"})]
    assert_known(Path(__file__).parent / "known" / "markings.json", known, decimals=4)


@pytest.mark.parametrize("left_m", [1.0, -2.0])
def test_a_ribbon_turns_corners_on_the_bisector(left_m):
    """East, then north: a strip 0.2 m wide beside the line has mitred corners and the parts' lengths."""
    strip = ribbon(Polyline.through([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)]), 2.0, 15.0, left_m, 0.2)
    corner = np.array([10.0 - left_m, left_m])
    expected = shapely.LineString([(2.0, left_m), corner, (corner[0], 5.0)]).buffer(
        0.1, cap_style="flat", join_style="mitre"
    )
    assert strip.symmetric_difference(expected).area < 1e-6
