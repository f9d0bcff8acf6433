"""The surface of CommonRoad's lanelets: no slit between lanes, no gap in a junction, a border beside the road."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from evaluation.made_records import moving, record_with
from hand_made_record import RIGHT, RIGHT_X_M, SHOULDER_X_M, STRAIGHT, crossing
from reader_environments import read_with
from shapely.geometry import Point, Polygon

from siren_ros.base.numerics.arrays import Points
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.data.datasets.commonroad import _add_obstacle, _add_problem, _root
from siren_ros.data.datasets.commonroad_surface import (
    BORDER_M,
    Bounds,
    _as_bounds,
    _without_holes,
    border_strips,
    junction_surfaces,
    lanelet_bounds,
)
from siren_ros.data.datasets.files import document
from siren_ros.data.datasets.lane_graph import lane_graph
from siren_ros.data.record.tracks import tracks_of
from siren_ros.simulation.roads.road_network import RoadNetwork

SHOULDER, RIGHT_LANE, LEFT_LANE, N_RIGHT = 0, 1, 2, 3
PATHS = 12


def bent(network: RoadNetwork, **centres: Points) -> RoadNetwork:
    """The crossing with other centre lines, by ``lane<index>``."""
    lanes = list(network.lanes)
    for name, points in centres.items():
        index = int(name.removeprefix("lane"))
        lanes[index] = replace(lanes[index], centre=Polyline.through(points))
    return replace(network, lanes=tuple(lanes))


def arc(radius_m: float, points: int) -> Points:
    """A quarter circle around the origin."""
    angle = np.linspace(0.0, np.pi / 2.0, points)
    return np.stack((radius_m * np.cos(angle), radius_m * np.sin(angle)), axis=-1)


def test_neighbours_share_a_boundary_though_their_centre_lines_have_other_vertices():
    """In a bend of 40 m the vertices of the one lane lie on the chords of the other."""
    network = bent(crossing(), lane0=arc(43.0, 9), lane1=arc(40.0, 11), lane2=arc(36.5, 14))
    graph = lane_graph(network)
    loose = shapely.union_all([Polygon(np.vstack((graph[i].left, graph[i].right[::-1]))) for i in (0, 1, 2)])
    assert shapely.get_num_interior_rings(shapely.get_parts(loose)).sum() > 3, "slits"
    bounds = lanelet_bounds(graph, {})
    assert np.array_equal(bounds[SHOULDER].left, bounds[RIGHT_LANE].right)
    assert np.array_equal(bounds[RIGHT_LANE].left, bounds[LEFT_LANE].right)
    assert len({len(line) for lane in (0, 1, 2) for line in (bounds[lane].left, bounds[lane].right)}) == 1
    road = shapely.union_all([bounds[lane].polygon() for lane in (0, 1, 2)])
    assert (road.geom_type, len(road.interiors)) == ("Polygon", 0)
    assert road.area == pytest.approx(loose.area, rel=0.02)
    middle = np.hypot(*bounds[RIGHT_LANE].left.T)
    assert middle == pytest.approx(np.full(len(middle), 38.25), abs=0.2)


def test_opposite_directions_share_their_middle_line():
    """A bend of 38.25 m whose two directions have vertices of their own."""
    graph = lane_graph(bent(crossing(), lane2=arc(40.0, 12), lane9=arc(36.5, 15)[::-1]))
    bounds = lanelet_bounds(graph, {2: 9, 9: 2})
    assert np.array_equal(bounds[9].left, bounds[2].left[::-1])
    assert np.hypot(*bounds[9].left.T) == pytest.approx(np.full(len(bounds[9].left), 38.25), abs=0.2)
    assert np.hypot(*bounds[9].right.T).max() < 36.5
    assert np.hypot(*bounds[2].right.T).min() > 40.0


def test_straight_lanes_keep_their_two_ends_alone():
    bounds = lanelet_bounds(lane_graph(crossing()), {})
    assert bounds[RIGHT_LANE].left.tolist() == [[3.5, -120.0], [3.5, -20.0]]
    assert bounds[RIGHT_LANE].right.tolist() == [[7.0, -120.0], [7.0, -20.0]]


def test_a_path_begins_and_ends_with_its_lanes():
    """Paths that begin three centimetres beside their lane and end three beside the next one."""
    network = crossing()
    aside = network.lanes[PATHS + STRAIGHT].centre.points + np.array((0.03, 0.0))
    bounds = lanelet_bounds(lane_graph(bent(network, **{f"lane{PATHS + STRAIGHT}": aside})), {})
    path, before, after = bounds[PATHS + STRAIGHT], bounds[RIGHT_LANE], bounds[N_RIGHT]
    assert (path.left[0].tolist(), path.right[0].tolist()) == (before.left[-1].tolist(), before.right[-1].tolist())
    assert (path.left[-1].tolist(), path.right[-1].tolist()) == (after.left[0].tolist(), after.right[0].tolist())
    far = bent(network, **{f"lane{PATHS + STRAIGHT}": aside + np.array((1.5, 0.0))})
    assert lanelet_bounds(lane_graph(far), {})[PATHS + STRAIGHT].left[0, 0] == pytest.approx(5.03), (
        "that is another place"
    )


def test_the_inner_boundary_of_a_tight_bend_does_not_run_backwards():
    """A turn of 1 m, narrower than half the lane."""
    network = crossing()
    tight = np.array([(5.25, -20.0), *((6.25, -16.0) + arc(1.0, 9)[::-1] * (-1.0, 1.0))[::-1], (20.0, -15.0)])
    graph = lane_graph(bent(network, **{f"lane{PATHS + RIGHT}": tight}))
    lane = graph[PATHS + RIGHT]
    assert not Bounds(lane.left, lane.right).polygon().is_valid
    assert lanelet_bounds(graph, {})[PATHS + RIGHT].polygon().is_valid


def test_borders_lie_beside_the_road_but_not_between_its_directions():
    graph = lane_graph(crossing())
    bounds = lanelet_bounds(graph, {})
    strips = border_strips(graph, bounds, {})
    assert len(strips) == 16, "two at each of the eight roads"
    ours = [strip for strip in strips if Polygon(strip.polygon()).intersects(Point(9.5 + BORDER_M / 2.0, -50.0))]
    (outer,) = ours
    assert outer.left.tolist() == bounds[SHOULDER].right.tolist()
    assert outer.right[:, 0] == pytest.approx([9.5 + BORDER_M] * 2)
    divided = border_strips(graph, bounds, {LEFT_LANE: 9, 9: LEFT_LANE})
    assert len(divided) == 14
    assert not any(strip.polygon().contains(Point(-BORDER_M / 2.0, -50.0)) for strip in divided)


def surfaces(outline: Points) -> list[Bounds]:
    network = crossing()
    junctions = {key: replace(junction, outline=outline) for key, junction in network.junctions.items()}
    return junction_surfaces(network, lanelet_bounds(lane_graph(replace(network, junctions=junctions)), {}))


def test_a_junction_is_paved_between_its_paths():
    """Between the ways to the north, to the east and around the corner lies a triangle that no path crosses."""
    outline = np.array([(-10.0, -20.0), (20.0, -20.0), (20.0, 10.0), (-10.0, 10.0)])
    area = shapely.union_all([surface.polygon() for surface in surfaces(outline)])
    bounds = lanelet_bounds(lane_graph(crossing()), {})
    paths = shapely.union_all([lanelet.polygon() for key, lanelet in bounds.items() if key >= PATHS])
    paved = paths.intersection(Polygon(outline))
    assert area.buffer(1e-6).contains(paved)
    gap = Point(7.42, -8.86)
    assert not paths.contains(gap)
    assert area.contains(gap)
    assert not area.contains(Point(-9.0, 9.0))
    for surface in surfaces(outline):
        assert len(surface.left) == len(surface.right)
        assert surface.polygon().is_valid


def test_an_island_is_no_part_of_the_surface():
    """A lanelet has no holes, so the area around one is cut in two."""
    ring = Point(0.0, 0.0).buffer(10.0).difference(Point(1.0, 2.0).buffer(3.0))
    pieces = _without_holes(ring)
    assert (len(pieces), sum(len(piece.interiors) for piece in pieces)) == (2, 0)
    assert sum(piece.area for piece in pieces) == pytest.approx(ring.area)
    for piece in pieces:
        bounds = _as_bounds(piece)
        assert len(bounds.left) == len(bounds.right)
        assert bounds.polygon().symmetric_difference(piece).area == pytest.approx(0.0, abs=1e-6)


def scenario_file(folder: Path, *dropped: str) -> Path:
    """Three vehicles: over the edge of the shoulder, on the line between two lanes, across the junction."""
    steps = 30
    tracks = {
        1: moving(RIGHT_X_M, -100.0, 10.0, yaw_rad=np.pi / 2.0, steps=steps, is_emv=True),
        5: moving(SHOULDER_X_M + 0.7, -60.0, 2.0, yaw_rad=np.pi / 2.0, steps=steps),
        6: moving(3.5, -60.0, 2.0, yaw_rad=np.pi / 2.0, steps=steps),
        7: moving(6.9, -9.5, 0.5, yaw_rad=np.pi / 4.0, steps=steps),
    }
    record = record_with(tracks, crossing())
    root = _root(record, record.description)
    emv, *others = tracks_of(record)
    for track in others:
        _add_obstacle(root, track)
    _add_problem(root, emv)
    for lanelet in root.findall("lanelet"):
        kind = lanelet.findtext("laneletType")
        if (kind == "border" or (kind == "intersection" and lanelet.find("successor") is None)) and kind in dropped:
            root.remove(lanelet)
    file = folder / "scenario.xml"
    file.write_bytes(document(root))
    return file


@pytest.mark.parametrize(("dropped", "touching"), [((), set()), (("border",), {"5"}), (("intersection",), {"7"})])
def test_the_drivability_checker_finds_who_touches_the_boundary(tmp_path, dropped, touching):
    file = scenario_file(tmp_path, *dropped)
    reading = read_with("commonroad_drivability", "read_commonroad_drivability.py", file)
    assert (reading["obstacles"], set(reading["touching"])) == (3, touching)
