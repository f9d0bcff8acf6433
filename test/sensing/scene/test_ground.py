"""The ground's triangles: heights and materials at places of a small crossing, areas without gaps."""

import numpy as np
import pytest
import shapely
from hand_made_record import crossing
from shapely.geometry import Polygon

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.sensing.meshes.mesh import Material
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


def surface_at(mesh, x_m, y_m):
    """Height and material of the topmost level triangle over a place."""
    corners = triangles(mesh)
    level = np.ptp(corners[:, :, 2], axis=1) < 1e-6
    there = [
        (float(corners[row, 0, 2]), Material(int(mesh.material[row])))
        for row in np.flatnonzero(level).tolist()
        if shapely.contains_xy(Polygon(corners[row, :, :2]).buffer(1e-6), x_m, y_m)
    ]
    return max(there)


@pytest.mark.parametrize(
    ("place", "material"),
    [
        *[((5.25, -70.0), Material.ASPHALT), ((8.25, -70.0), Material.SHOULDER_ASPHALT)],
        *[((5.25, -5.0), Material.ASPHALT), ((3.5, -30.0), Material.MARKING_WHITE)],
        *[((0.15, -70.0), Material.MARKING_YELLOW), ((-60.0, -8.0), Material.GROUND)],
        ((-60.0, 60.0), Material.GRASS),
    ],
)
def test_every_region_is_plane_and_has_its_material(place, material):
    assert surface_at(BARE[1], *place) == (pytest.approx(0.0), material)


def test_sidewalks_stand_a_kerb_above_the_road(network):
    """The legs of this crossing have 7 m of lanes, 2 m of shoulder and 2.5 m of sidewalk on each side."""
    _, mesh = ground_of(network)
    assert surface_at(mesh, 60.0, 10.5) == (pytest.approx(TOP_M), Material.SIDEWALK)
    assert surface_at(mesh, 60.0, 9.07) == (pytest.approx(TOP_M), Material.KERB)
    assert surface_at(mesh, 60.0, 8.0) == (pytest.approx(0.0), Material.SHOULDER_ASPHALT)
    assert surface_at(mesh, 60.0, 12.0) == (pytest.approx(0.0), Material.GRASS)
    upright = np.ptp(triangles(mesh)[:, :, 2], axis=1) > 1e-6
    assert set(mesh.material[upright].tolist()) == {int(Material.KERB)}
    heights = triangles(mesh)[upright][:, :, 2]
    assert (heights.min(), heights.max()) == (pytest.approx(0.0), pytest.approx(TOP_M))


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


def markings_of(network):
    config, centres = SceneConfig(), drawn_centres(network, 0.0)
    return road_markings(network, centres, road_surfaces(network, centres, config), config)


SIGNALLED = markings_of(crossing())
SIGNED = markings_of(crossing(JunctionKind.PRIORITY_STOP))
"""The stop sign is for those from the south alone. Their lanes: shoulder 7 to 9.5 m, right to 7 m, left 0 to 3.5 m."""


def painted(area, *places):
    return [bool(shapely.contains_xy(area, *place)) for place in places]


def along(area, x_m, ys_m):
    """The painted share of a line to the north."""
    return float(np.mean([shapely.contains_xy(area, x_m, y_m) for y_m in ys_m]))


def test_stop_lines_are_half_a_metre_deep_over_driving_lanes_that_wait():
    across = [(0.4, -20.25), (5.25, -20.25), (6.8, -20.25), (5.25, -20.45), (5.25, -20.05)]
    assert painted(SIGNALLED.white, *across) == painted(SIGNED.white, *across) == [True] * 5
    beyond = [(5.25, -20.6), (5.25, -19.9), (8.25, -20.25), (5.25, 109.75), (5.25, -119.75)]
    assert painted(SIGNALLED.white, *beyond) == [False] * 5, "not on the shoulder, not where nobody waits"
    from_the_west = [(-10.25, -5.25), (-10.25, -6.7), (-10.25, -3.8)]
    assert painted(SIGNALLED.white, *from_the_west) == [True] * 3
    assert painted(SIGNED.white, *from_the_west) == [False] * 3


def test_dashes_are_3_m_with_gaps_of_6_m_and_solid_for_20_m_before_the_line():
    """Between the two lanes from the south, at x = 3.5 m, from y = −120 m on."""
    for number in range(8):
        start = -120.0 + 9.0 * number
        assert along(SIGNALLED.white, 3.5, np.linspace(start + 0.05, start + 2.95, 20)) == 1.0
        assert along(SIGNALLED.white, 3.5, np.linspace(start + 3.05, start + 8.95, 20)) == 0.0
    assert along(SIGNALLED.white, 3.5, np.linspace(-39.95, -20.05, 60)) == 1.0
    assert painted(SIGNALLED.white, (3.45, -30.0), (3.55, -30.0)) == [True, True]
    assert painted(SIGNALLED.white, (3.42, -30.0), (3.58, -30.0)) == [False, False]
    # Northwards nobody waits: dashes up to the end.
    assert along(SIGNALLED.white, 3.5, np.linspace(10.05, 99.95, 900)) == pytest.approx(1.0 / 3.0, abs=0.01)
    assert along(SIGNALLED.white, 3.5, np.linspace(103.1, 108.9, 20)) == 0.0


def test_edge_lines_are_white_and_yellow_towards_oncoming_traffic():
    """Those who come from the north drive at x = −1.75 m; both directions have a line 15 cm inside their lane."""
    for y_m in (-70.0, 60.0):
        assert painted(SIGNALLED.yellow, (0.15, y_m), (-0.15, y_m)) == [True, True]
        assert painted(SIGNALLED.white, (0.15, y_m), (-0.15, y_m)) == [False, False]
    # The road from the west has no oncoming traffic, and the one to the north at x = 14 m runs with its neighbours.
    assert painted(SIGNALLED.white, (-60.0, -3.65), (12.4, -70.0)) == [True, True]
    assert painted(SIGNALLED.yellow, (-60.0, -3.65), (12.4, -70.0)) == [False, False]
    assert not shapely.intersects(SIGNALLED.white, SIGNALLED.yellow.buffer(-0.001))
    assert painted(SIGNALLED.white, (7.0, -70.0), (6.9, -70.0), (7.1, -70.0)) == [True, False, False]
    # From the west there is no shoulder: the lane's right side is y = −7 m.
    assert painted(SIGNALLED.white, (-60.0, -6.85), (-60.0, -6.95), (-60.0, -6.75)) == [True, False, False]


def test_arrows_show_the_movements_8_m_before_the_line():
    """The right lane leads on and to the right, the left one on alone; shafts are 18 cm wide and end 4 m before."""
    for x_m in (1.75, 5.25):
        assert painted(SIGNALLED.white, (x_m, -28.2), (x_m, -31.9)) == [True, True]
        assert painted(SIGNALLED.white, (x_m, -27.9), (x_m, -32.2)) == [False, False]
    hook = (1.9 + 28.0, 0.75)
    assert painted(SIGNALLED.white, (5.25 + hook[1], -hook[0]), (1.75 + hook[1], -hook[0])) == [True, False]
    assert painted(SIGNALLED.white, (5.25 - hook[1], -hook[0])) == [False]
    inside = shapely.box(-9.5, -19.5, 19.5, 9.5)
    assert SIGNALLED.white.intersection(inside).area == SIGNALLED.yellow.intersection(inside).area == 0.0


def test_a_signal_of_a_map_without_crossings_gets_stripes_over_the_whole_width_of_each_leg(network):
    """Half a metre wide and as far apart, over 9 m of lanes and shoulder on each side, from 0.9 m behind the line."""
    white, depth_m = markings_of(network).white, SceneConfig().zebra_depth_m
    for along in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        for side in (1.0, -1.0):
            lefts_m = side * np.arange(0.5, 9.5, 0.5)
            ahead_m = 16.0 - 0.9 - 0.5 * depth_m
            places = [(ahead_m * along[0] - left * along[1], ahead_m * along[1] + left * along[0]) for left in lefts_m]
            assert painted(white, *places) == [True, False] * 9


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


def test_two_lanes_of_opposite_directions_share_one_dashed_line():
    """3 m of paint and 6 m of gap on the line itself."""
    markings = markings_of(street(1, 1))
    for start in (0.0, 9.0, 45.0, 90.0):
        assert painted(markings.yellow, (start + 0.1, 0.0), (start + 2.9, 0.0)) == [True, True]
        assert painted(markings.yellow, (start + 3.1, 0.0), (start + 8.9, 0.0)) == [False, False]
    assert painted(markings.yellow, (1.0, 0.05), (1.0, -0.05), (1.0, 0.07), (1.0, -0.07)) == [True, True, False, False]
    assert painted(markings.white, (1.0, 0.0), (50.0, 0.15), (50.0, -0.15)) == [False] * 3
    assert painted(markings.white, (50.0, -3.35), (50.0, 3.35)) == [True, True], "edge lines"


@pytest.mark.parametrize(("there", "back"), [(2, 1), (1, 2), (2, 2)])
def test_where_one_direction_has_more_lanes_each_has_a_solid_line(there, back):
    markings = markings_of(street(there, back))
    along_m = np.linspace(0.5, 99.5, 100)
    for y_m in (0.15, -0.15):
        assert all(shapely.contains_xy(markings.yellow, x_m, y_m) for x_m in along_m)
    assert painted(markings.yellow, (1.0, 0.0), (5.0, 0.0)) == [False, False]


def with_short_approach(length_m):
    """The crossing with a shorter approach from the south."""
    network = crossing()
    for lane in network.lanes[:3]:
        end = lane.centre.points[-1]
        object.__setattr__(lane, "centre", Polyline.through(np.array([end - (0.0, length_m), end])))
    return network


@pytest.mark.parametrize(("length_m", "there"), [(12.5, False), (13.5, True)])
def test_lanes_shorter_than_13_m_have_no_arrows(length_m, there):
    markings = markings_of(with_short_approach(length_m))
    assert painted(markings.white, (1.75, -28.5)) == [there]
    assert painted(markings.white, (1.75, -20.25)) == [True]
    assert along(markings.white, 3.5, np.linspace(-20.0 - length_m + 0.1, -20.1, 40)) == 1.0, "all of it is solid"


def test_arrows_of_two_directions_and_turnarounds():
    centre = Polyline.through([(0.0, 0.0), (0.0, 50.0)])
    left, straight = arrow(centre, 30.0, {"t", "s", "x"})
    assert straight.bounds == pytest.approx((-0.36, 26.0, 0.36, 30.0))
    assert left.bounds[0] == pytest.approx(-1.05)
    assert left.bounds[2] < 0.1
    assert list(arrow(centre, 30.0, set())) == []


@pytest.mark.parametrize("left_m", [1.0, -2.0])
def test_a_ribbon_turns_corners_on_the_bisector(left_m):
    """East, then north: a strip 0.2 m wide beside the line has mitred corners and the parts' lengths."""
    strip = ribbon(Polyline.through([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)]), 2.0, 15.0, left_m, 0.2)
    corner = np.array([10.0 - left_m, left_m])
    expected = shapely.LineString([(2.0, left_m), corner, (corner[0], 5.0)]).buffer(
        0.1, cap_style="flat", join_style="mitre"
    )
    assert strip.symmetric_difference(expected).area < 1e-6
