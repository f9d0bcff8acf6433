"""Argoverse 2's map of a small crossing: lanes, marks, and the area without holes."""

import numpy as np
import pytest
from hand_made_record import STRAIGHT, crossing, line
from shapely import Polygon, unary_union

from siren_ros.datasets.argoverse2.map_json import _crossing, _without_holes, map_json, resampled
from siren_ros.datasets.sources.lane_graph import lane_graph

MAP = map_json(crossing())
PATHS = 12


def xy(points: list[dict[str, float]]) -> np.ndarray:
    return np.array([(one["x"], one["y"]) for one in points])


def test_lanes_have_their_kind_marks_and_neighbours() -> None:
    shoulder, right, left = (MAP["lane_segments"][str(index)] for index in range(3))
    assert [one["lane_type"] for one in (shoulder, right, left)] == ["BUS", "VEHICLE", "VEHICLE"]
    assert (right["left_neighbor_id"], right["right_neighbor_id"]) == (2, 0)
    assert (right["left_lane_mark_type"], right["right_lane_mark_type"]) == ("DASHED_WHITE", "DASHED_WHITE")
    assert (left["left_lane_mark_type"], shoulder["right_lane_mark_type"]) == ("SOLID_YELLOW", "SOLID_WHITE")
    path = MAP["lane_segments"][str(PATHS + STRAIGHT)]
    assert (path["is_intersection"], right["is_intersection"]) == (True, False)
    assert (path["left_lane_mark_type"], path["right_lane_mark_type"]) == ("NONE", "NONE")
    assert (path["predecessors"], path["successors"]) == ([1], [3])


def test_lines_are_in_the_lanes_direction_to_the_millimetre() -> None:
    right = MAP["lane_segments"]["1"]
    for name, x_m in (("centerline", 5.25), ("left_lane_boundary", 3.5), ("right_lane_boundary", 7.0)):
        points = xy(right[name])
        assert set(points[:, 0].tolist()) == {x_m}
        assert (points[0, 1], points[-1, 1]) == (-120.0, -20.0)
        assert np.ptp(np.diff(points[:, 1])) < 0.0021, "rounded to a millimetre"
    third = map_json(crossing())["lane_segments"][str(PATHS + 3)]["centerline"]
    assert all(round(one[axis], 3) == one[axis] for one in third for axis in ("x", "y"))
    assert all(any(round(one[axis], 2) != one[axis] for one in third) for axis in ("x", "y"))
    assert {one["z"] for one in third} == {0.0}


def test_lines_have_points_at_equal_distances() -> None:
    found = resampled(line((0.0, 0.0), (3.0, 0.0), (3.0, 3.0)), 5)
    assert found == pytest.approx(np.array([(0.0, 0.0), (1.5, 0.0), (3.0, 0.0), (3.0, 1.5), (3.0, 3.0)]))


def test_the_drivable_area_covers_lanes_and_junctions() -> None:
    areas = [Polygon(xy(one["area_boundary"])) for one in MAP["drivable_areas"].values()]
    whole = unary_union(areas)
    for lane in lane_graph(crossing()).values():
        assert whole.buffer(0.05).contains(Polygon(np.vstack((lane.left, lane.right[::-1]))))
    assert whole.buffer(0.05).contains(Polygon([(-10, -20), (20, -20), (20, 10), (-10, 10)]))
    assert [one["id"] for one in MAP["drivable_areas"].values()] == list(range(len(areas)))


def test_the_drivable_area_ends_where_lanes_and_junctions_end() -> None:
    """All outlines are made 0.05 m wider, so that neighbours join, and simplified by as much."""
    network = crossing()
    shapes = [Polygon(np.vstack((lane.left, lane.right[::-1]))) for lane in lane_graph(network).values()]
    shapes += [Polygon(junction.outline) for junction in network.junctions.values()]
    whole = unary_union([Polygon(xy(one["area_boundary"])) for one in MAP["drivable_areas"].values()])
    assert unary_union(shapes).buffer(0.15).contains(whole)


def test_a_hole_is_cut_open_and_stays_a_hole() -> None:
    ring = Polygon(
        [(0, 0), (10, 0), (10, 10), (0, 10)], [[(3, 3), (3, 6), (6, 6), (6, 3)], [(7, 7), (7, 9), (9, 9), (9, 7)]]
    )
    pieces = _without_holes(ring)
    assert all(not piece.interiors for piece in pieces)
    assert sum(piece.area for piece in pieces) == pytest.approx(ring.area)
    assert unary_union(pieces).symmetric_difference(ring).area == pytest.approx(0.0)


@pytest.mark.parametrize("first", range(4))
def test_a_crossing_has_its_long_edges_in_one_direction(first: int) -> None:
    """4 m wide, 12 m long, its outline from any corner on."""
    outline = np.roll(np.array([(0.0, 0.0), (12.0, 0.0), (12.0, 4.0), (0.0, 4.0)]), -first, axis=0)
    found = _crossing(7, outline)
    edges = [xy(found[name]) for name in ("edge1", "edge2")]
    assert found["id"] == 7
    assert [float(np.hypot(*(edge[1] - edge[0]))) for edge in edges] == [12.0, 12.0]
    assert (edges[0][1] - edges[0][0]).tolist() == (edges[1][1] - edges[1][0]).tolist()
    assert {edges[0][0][1], edges[1][0][1]} == {0.0, 4.0}
