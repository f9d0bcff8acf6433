"""CommonRoad scenarios: lanelets, traffic, planning problems; the library reads them."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree.ElementTree import Element, fromstring

import numpy as np
import pytest
import shapely
from datasets.made_bag import Export
from datasets.made_tracks import LANE, made_record, made_tracks
from evaluation.made_records import moving, record_with
from hand_made_record import EAST, RIGHT, RIGHT_X_M, SHOULDER_X_M, STRAIGHT, crossing
from reader_environments import read_with
from shapely.geometry import Point, Polygon

from siren_ros.base.numerics.arrays import Points
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.data.datasets.commonroad import (
    CommonRoadExporter,
    add_obstacle,
    add_problem,
    benchmark_id,
    lanelet_id,
    mirror_commonroad,
    obstacle_type,
    scenario_root,
)
from siren_ros.data.datasets.files import document
from siren_ros.data.datasets.lane_graph import (
    BORDER_M,
    Bounds,
    border_strips,
    junction_surfaces,
    lane_graph,
    lanelet_bounds,
    without_holes,
)
from siren_ros.data.tracks import Track, tracks_of
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import EMERGENCY_CLASSES, ActorClass

RECORD = made_record()
ROOT = scenario_root(RECORD, RECORD.description)
LANELETS = {int(lanelet.attrib["id"]) - 1: lanelet for lanelet in ROOT.findall("lanelet")}
PATHS = 12


def points(bound: Element) -> list[list[float]]:
    return [[float(point.findtext("x", "")), float(point.findtext("y", ""))] for point in bound.findall("point")]


def refs(element: Element, tag: str) -> list[int]:
    return [int(reference.attrib["ref"]) - 1 for reference in element.findall(tag)]


def test_a_lanelet_has_bounds_followers_and_neighbours():
    lane = LANELETS[LANE]
    left, right = lane.find("leftBound"), lane.find("rightBound")
    assert points(left) == [[3.5, -120.0], [3.5, -20.0]]
    assert points(right) == [[7.0, -120.0], [7.0, -20.0]]
    assert (left.findtext("lineMarking"), right.findtext("lineMarking")) == ("dashed", "dashed")
    assert refs(lane, "successor") == [PATHS + STRAIGHT, PATHS + RIGHT]
    assert (refs(lane, "adjacentLeft"), refs(lane, "adjacentRight")) == ([2], [0])
    assert lane.find("adjacentLeft").attrib["drivingDir"] == "same"
    outer = LANELETS[0].find("rightBound")
    assert outer.findtext("lineMarking") == "solid"
    assert [lanelet.findtext("laneletType") for lanelet in (LANELETS[0], lane, LANELETS[PATHS])] == [
        "shoulder",
        "urban",
        "intersection",
    ]
    assert [lanelet.findtext("userOneWay") for lanelet in (LANELETS[0], lane)] == ["priorityVehicle", "vehicle"]
    path = LANELETS[PATHS].find("leftBound")
    assert path.findtext("lineMarking") == "no_marking"
    assert lanelet_id(0) == 1


def test_opposite_lanes_share_their_left_bounds():
    """South of the junction the two directions meet at x = 0; here they lead from and to one place."""
    for lane in (LANELETS[2], LANELETS[9]):
        assert lane.find("adjacentLeft") is None, "by their junctions they are different roads"
    network = RECORD.network
    edges = tuple(replace(edge, to_junction="s_in") if edge.edge_id == "s_out" else edge for edge in network.edges)
    root = scenario_root(replace(RECORD, network=replace(network, edges=edges)), RECORD.description)
    lanes = {int(lanelet.attrib["id"]) - 1: lanelet for lanelet in root.findall("lanelet")}
    for lane, other in ((2, 9), (9, 2)):
        neighbour = lanes[lane].find("adjacentLeft")
        assert (int(neighbour.attrib["ref"]) - 1, neighbour.attrib["drivingDir"]) == (other, "opposite")


def test_stop_lines_and_lights_stand_at_the_end():
    lane = LANELETS[LANE]
    line = lane.find("stopLine")
    assert points(line) == [[3.5, -20.0], [7.0, -20.0]]
    lights = {int(light.attrib["id"]): light for light in ROOT.findall("trafficLight")}
    light_ids = [int(reference.attrib["ref"]) for reference in lane.findall("trafficLightRef")]
    assert [lights[number].findtext("direction") for number in light_ids] == ["straight", "right"]
    straight, right = (lights[number] for number in light_ids)
    cycle = [(element.findtext("duration"), element.findtext("color")) for element in straight.iter("cycleElement")]
    assert cycle == [("10", "yellow"), ("11", "green")]
    assert [(element.findtext("duration"), element.findtext("color")) for element in right.iter("cycleElement")] == [
        ("21", "red")
    ]
    position = straight.find("position")
    assert points(position) == [[7.0, -20.0]]


def test_the_intersection_knows_who_comes_and_where_one_goes():
    (crossing,) = ROOT.findall("intersection")
    arms = {tuple(refs(arm, "incomingLanelet")): arm for arm in crossing.findall("incoming")}
    south, west = arms[0, 1, 2], arms[(7,)]
    assert refs(south, "outgoingStraight") == [PATHS, PATHS + 1]
    assert refs(south, "outgoingRight") == [PATHS + 2, PATHS + 3]
    assert refs(south, "outgoingLeft") == []
    assert refs(west, "outgoingStraight") == [PATHS + EAST]
    assert len({arm.attrib["id"] for arm in crossing.findall("incoming")}) == len(arms)
    older = scenario_root(RECORD, RECORD.description, "successors")
    assert [element.tag for element in older.iter() if element.tag.startswith("outgoing")] == []
    cycle = [element.attrib for element in older.iter("successorsStraight")]
    assert cycle == [element.attrib for element in ROOT.iter("outgoingStraight")]


def test_speed_limits_are_signs():
    (sign,) = ROOT.findall("trafficSign")
    element = sign.find("trafficSignElement")
    assert (element.findtext("trafficSignID"), element.findtext("additionalValue")) == ("274", "13.9")
    lanes = [lanelet for number, lanelet in LANELETS.items() if number < 500_000]
    assert {lane.find("trafficSignRef").attrib["ref"] for lane in lanes} == {sign.attrib["id"]}


def exact(state: Element, tag: str) -> float:
    return float(state.findtext(f"{tag}/exact", "nan"))


def test_obstacles_have_their_states_from_their_first_frame_on():
    root = Element("root")
    car = made_tracks()[1]
    add_obstacle(root, car)
    (obstacle,) = root.findall("dynamicObstacle")
    states = [obstacle.find("initialState"), *obstacle.findall("trajectory/state")]
    present = [state for state in states if state is not None]
    assert [exact(state, "time") for state in present] == list(range(5, 21))
    assert [exact(state, "velocity") for state in present] == pytest.approx(8.0 + 0.05 * np.arange(16))
    assert {exact(state, "orientation") for state in present} == {1.0}
    assert {exact(state, "acceleration") for state in present} == {0.5}
    assert [float(state.findtext("position/point/x", "")) for state in present] == pytest.approx(car.x_m)
    assert (obstacle.findtext("type"), obstacle.findtext("shape/rectangle/length")) == ("car", "4")
    assert int(obstacle.attrib["id"]) % 1_000_000 == 5


def test_the_problem_is_to_be_where_the_vehicle_was_at_the_end():
    """Of one that drives at 1 rad from frame 5 to frame 20."""
    root, car = Element("root"), made_tracks()[1]
    add_problem(root, car)
    start, goal = root.find("planningProblem/initialState"), root.find("planningProblem/goalState")
    told = [exact(start, tag) for tag in ("time", "velocity", "acceleration", "orientation", "yawRate")]
    assert told == [5.0, 8.0, 0.5, 1.0, 0.0]
    rectangle = [float(goal.findtext(f"position/rectangle/{tag}", "nan")) for tag in ("orientation", "length", "width")]
    assert rectangle == [1.0, 10.0, 4.0]
    centre = [float(goal.findtext(f"position/rectangle/center/{tag}", "nan")) for tag in ("x", "y")]
    assert centre == pytest.approx([car.x_m[-1], car.y_m[-1]], abs=1e-6)
    assert (goal.findtext("time/intervalStart"), goal.findtext("time/intervalEnd")) == ("10", "20")


def test_types_and_names():
    kinds = {kind: obstacle_type(kind) for kind in ActorClass}
    assert {kind for kind in kinds if kinds[kind] == "priorityVehicle"} == EMERGENCY_CLASSES
    assert [kinds[kind] for kind in (ActorClass.SEDAN, ActorClass.VAN, ActorClass.BUS)] == ["car", "car", "bus"]
    assert [kinds[kind] for kind in (ActorClass.MOTORCYCLE, ActorClass.BICYCLE)] == ["motorcycle", "bicycle"]
    assert benchmark_id(RECORD.description) == "ZAM_SirenS2made-1_1_T-1"


def test_the_library_reads_the_scenario_of_an_episode(exported: Export, tracked_bag: Path, tracked_tracks: list[Track]):
    """The schema lets obstacles begin at time 0 alone; the reader takes later ones."""
    file = exported("commonroad", tracked_bag) / "train" / "S3_L1_seed0_town.xml"
    read = read_with("commonroad", "read_commonroad.py", file)
    assert (read["warnings"], read["crossed"]) == ([], [])
    assert all("dynamicObstacle" in error and "initialState/time" in error for error in read["errors"])
    assert (read["id"], read["dt"]) == ("ZAM_SirenS3town-1_1_T-1", 0.1)
    assert read["both_ways"] == read["successors"] > 100
    assert min(read["behind_arms"]) > 10
    assert read["adjacent"] > 20
    assert min(read["opposite"], read["intersections"], read["lights"]) > 5
    assert read["signs"] > 0
    assert {sum(duration for _, duration in cycle) for cycle in read["light_cycles"]} == {140}, "14 s at 10 Hz"
    assert any(len(cycle) > 1 for cycle in read["light_cycles"])
    tracks = {track.actor.actor_id: track for track in tracked_tracks}
    emv = tracks.pop(1)
    assert {int(key) for key in read["obstacles"]} == tracks.keys()
    for key, (kind, first, last, place) in read["obstacles"].items():
        track = tracks[int(key)]
        assert kind == obstacle_type(track.actor.actor_class)
        assert (first, last) == (track.frame[0], track.frame[-1])
        assert place == pytest.approx((track.x_m[-1], track.y_m[-1]), abs=1e-4)
    assert read["on_lanelet"] >= 0.9 * len(tracks)
    assert read["start"] == pytest.approx((emv.x_m[0], emv.y_m[0]), abs=1e-4)
    assert read["goal"] == pytest.approx((emv.x_m[-1], emv.y_m[-1]), abs=1e-3)
    assert read["goal_reached_by"] == emv.frame[-1]


def test_where_traffic_keeps_left_the_scenario_is_the_mirror_image():
    root = scenario_root(RECORD, RECORD.description)
    for track in made_tracks():
        add_obstacle(root, track)
    text = document(root)
    mirror_commonroad(root)
    lane = next(lanelet for lanelet in root.findall("lanelet") if lanelet.get("id") == str(lanelet_id(LANE)))
    assert points(lane.find("rightBound")) == [[3.5, 120.0], [3.5, 20.0]]
    assert points(lane.find("leftBound")) == [[7.0, 120.0], [7.0, 20.0]]
    assert (refs(lane, "adjacentLeft"), refs(lane, "adjacentRight")) == ([0], [2])
    order = ["leftBound", "rightBound", "predecessor", "successor", "adjacentLeft", "adjacentRight", "stopLine"]
    for lanelet in root.findall("lanelet"):
        places = [order.index(child.tag) for child in lanelet if child.tag in order]
        assert places == sorted(places), "the order of the schema"
    for arm in root.iter("incoming"):
        sides = [child.tag.removeprefix("outgoing") for child in arm if child.tag.startswith("outgoing")]
        assert sides == sorted(sides, key=("Right", "Straight", "Left").index)
    state = root.find("dynamicObstacle/initialState")
    first = made_tracks()[0]
    assert float(state.findtext("position/point/y")) == -first.xy_m[0][1]
    assert float(state.findtext("orientation/exact")) == -first.yaw_rad[0]
    mirror_commonroad(root)
    assert document(root).replace(b">-0.0<", b">0.0<") == text.replace(b">-0.0<", b">0.0<")


SHOULDER, RIGHT_LANE, LEFT_LANE, N_RIGHT = 0, 1, 2, 3
SURFACE_PATHS = 12


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


def test_a_path_begins_and_ends_with_its_lanes():
    """Paths that begin three centimetres beside their lane and end three beside the next one."""
    network = crossing()
    aside = network.lanes[SURFACE_PATHS + STRAIGHT].centre.points + np.array((0.03, 0.0))
    bounds = lanelet_bounds(lane_graph(bent(network, **{f"lane{SURFACE_PATHS + STRAIGHT}": aside})), {})
    path, before, after = bounds[SURFACE_PATHS + STRAIGHT], bounds[RIGHT_LANE], bounds[N_RIGHT]
    assert (path.left[0].tolist(), path.right[0].tolist()) == (before.left[-1].tolist(), before.right[-1].tolist())
    assert (path.left[-1].tolist(), path.right[-1].tolist()) == (after.left[0].tolist(), after.right[0].tolist())
    far = bent(network, **{f"lane{SURFACE_PATHS + STRAIGHT}": aside + np.array((1.5, 0.0))})
    assert lanelet_bounds(lane_graph(far), {})[SURFACE_PATHS + STRAIGHT].left[0, 0] == pytest.approx(5.03), (
        "that is another place"
    )
    for to_right_m, edges_m in ((1.2, (3.5, 9.4)), (-1.2, (1.1, 7.0))):  # one edge is the road's, the other is far away
        lanes = [
            *bent(network, **{f"lane{SURFACE_PATHS + STRAIGHT}": aside + np.array((to_right_m - 0.03, 0.0))}).lanes
        ]
        lanes[SURFACE_PATHS + STRAIGHT] = replace(lanes[SURFACE_PATHS + STRAIGHT], width_m=5.9)
        path = lanelet_bounds(lane_graph(replace(network, lanes=tuple(lanes))), {})[SURFACE_PATHS + STRAIGHT]
        assert (path.left[0, 0], path.right[0, 0]) == pytest.approx(edges_m)


def test_the_inner_boundary_of_a_tight_bend_does_not_run_backwards():
    """A turn of 1 m, narrower than half the lane."""
    network = crossing()
    tight = np.array([(5.25, -20.0), *((6.25, -16.0) + arc(1.0, 9)[::-1] * (-1.0, 1.0))[::-1], (20.0, -15.0)])
    graph = lane_graph(bent(network, **{f"lane{SURFACE_PATHS + RIGHT}": tight}))
    lane = graph[SURFACE_PATHS + RIGHT]
    assert not Bounds(lane.left, lane.right).polygon().is_valid
    assert lanelet_bounds(graph, {})[SURFACE_PATHS + RIGHT].polygon().is_valid


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
    paths = shapely.union_all([lanelet.polygon() for key, lanelet in bounds.items() if key >= SURFACE_PATHS])
    paved = paths.intersection(Polygon(outline))
    assert area.buffer(1e-6).contains(paved)
    gap = Point(7.42, -8.86)
    assert not paths.contains(gap)
    assert area.contains(gap)
    assert not area.contains(Point(-9.0, 9.0))
    for surface in surfaces(outline):
        assert len(surface.left) == len(surface.right)
        assert surface.polygon().is_valid


def test_islands_are_no_part_of_the_surface():
    """A lanelet has no holes, so the area around each is cut in two."""
    islands = Point(1.0, 2.0).buffer(3.0).union(Point(-6.0, -2.0).buffer(1.5))
    ring = Point(0.0, 0.0).buffer(10.0).difference(islands)
    pieces = without_holes(ring, 0.01)
    assert (len(pieces), sum(len(piece.interiors) for piece in pieces)) == (3, 0)
    assert sum(piece.area for piece in pieces) == pytest.approx(ring.area)
    for piece in pieces:
        bounds = Bounds.around(piece)
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
    root = scenario_root(record, record.description)
    emv, *others = tracks_of(record)
    for track in others:
        add_obstacle(root, track)
    add_problem(root, emv)
    for lanelet in root.findall("lanelet"):
        kind = lanelet.findtext("laneletType")
        if (kind == "border" or (kind == "intersection" and lanelet.find("successor") is None)) and kind in dropped:
            root.remove(lanelet)
    file = folder / f"scenario{len(dropped)}.xml"
    file.write_bytes(document(root))
    return file


def test_the_drivability_checker_finds_who_touches_the_boundary(tmp_path):
    """Nobody does; without the borders and the surface of the junction, two do."""
    files = scenario_file(tmp_path), scenario_file(tmp_path, "border", "intersection")
    reading = read_with("commonroad_drivability", "read_commonroad_drivability.py", *files)
    assert [(found["obstacles"], set(found["touching"])) for found in reading] == [(3, set()), (3, {"5", "7"})]


@pytest.mark.parametrize("emv_ids", [(1, 3), (3, 1)])
def test_the_problem_of_two_emvs_is_that_of_the_first_and_the_others_are_obstacles(emv_ids) -> None:
    emvs = {number: moving(10.0 * number, -5.0, 5.0, is_emv=True) for number in emv_ids}
    record = record_with({**emvs, 2: moving(90.0, -5.0, 5.0)}, crossing())
    record = replace(record, description=replace(record.description, emv_ids=emv_ids))
    source: Any = SimpleNamespace(record=lambda: record, network=record.network, description=record.description)
    written: dict[str, bytes] = {}
    files: Any = SimpleNamespace(write=written.__setitem__)
    CommonRoadExporter("incoming").write_episode(source, "one", files)
    root = fromstring(written["one.xml"])  # noqa: S314 - our own
    place = {axis: float(root.findtext(f"planningProblem/initialState/position/point/{axis}", "")) for axis in "xy"}
    assert place == {"x": pytest.approx(10.0), "y": pytest.approx(-5.0)}
    assert len(root.findall("dynamicObstacle")) == 2
