"""CommonRoad scenarios: the EMV is the planning problem, all other vehicles are obstacles on the lanelet network.

Format: CommonRoad 2020a, https://commonroad.in.tum.de. Intersections follow commonroad-io 2026.1, which calls the
``successors`` of an arm its ``outgoing`` lanelets and warns of each older name.
"""

from collections import Counter
from collections.abc import Mapping
from itertools import count, groupby
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from siren_ros.base.numerics.arrays import Points
from siren_ros.data.datasets.files import FileWriter, child, children, document
from siren_ros.data.datasets.formats import EpisodeReport, FilesExporter
from siren_ros.data.datasets.lane_graph import (
    Bounds,
    GraphLane,
    border_strips,
    junction_surfaces,
    lane_graph,
    lanelet_bounds,
)
from siren_ros.data.episode_source import EpisodeSource
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import FRAME_S, LOG_PERIOD_STEPS, Track, tracks_of
from siren_ros.errors import BagError
from siren_ros.simulation.roads.road_network import OTHER_SIDE, Connection, LaneKind, RoadNetwork, negated
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.world.actors import EMERGENCY_CLASSES, ActorClass, by_class

_BORDERS, _SURFACES = 600_000, 800_000
_SIGNS, _LIGHTS, _JUNCTIONS, _INCOMINGS = 1_000_000, 2_000_000, 3_000_000, 4_000_000
"""First ids of each kind of element; all ids of a scenario must differ."""
_COLOUR: Final = {"r": "red", "u": "redYellow", "y": "yellow", "g": "green", "s": "green", "o": "inactive"}
"""CommonRoad's colour for each of SUMO's letters, in either case; ``s`` is a green arrow."""
_DIRECTION: Final = {"s": "straight", "l": "left", "L": "left", "t": "left", "r": "right", "R": "right"}
_KIND: Final = {LaneKind.INTERNAL: "intersection", LaneKind.SHOULDER: "shoulder"}
_UNMARKED: Final = ("no_marking", "no_marking")
_OPPOSITE_M: Final = 1.0
"""Left boundaries of opposite lanes that are nearer than this count as one line."""
VERSION: Final = "2020a"
_TYPE_OF_CLASS: Final = by_class(
    {
        ActorClass.TRUCK: "truck",
        ActorClass.BUS: "bus",
        ActorClass.MOTORCYCLE: "motorcycle",
        ActorClass.BICYCLE: "bicycle",
        ActorClass.PEDESTRIAN: "pedestrian",
    }
)
_PROBLEM: Final = 5_000_000
_OBSTACLES: Final = 6_000_000
_GOAL_LENGTH_M: Final = 10.0
_GOAL_WIDTH_M: Final = 4.0
_UNKNOWN_PLACE: Final = {"geoNameId": -999, "gpsLatitude": 999, "gpsLongitude": 999}
"""Values that CommonRoad uses for a map without a place on earth."""


def lanelet_id(lane: int) -> int:
    """Id of a lane's lanelet."""
    return lane + 1


def add_network(root: Element, record: EpisodeRecord, arm_names: str) -> None:
    """Add lanelets, signs, lights and intersections, in the order of the schema.

    ``arm_names`` is the head of the names of the lanelets that leave an arm of an intersection.
    """
    network = record.network
    graph = lane_graph(network)
    limits = sorted({lane.lane.speed_limit_mps for lane in graph.values()})
    signs = {limit: _SIGNS + number for number, limit in enumerate(limits)}
    lights = _lights(network, graph)
    opposite = _opposite_lanes(network, graph)
    bounds = lanelet_bounds(graph, opposite)
    for index, lane in graph.items():
        lanelet = _add_lanelet(root, lanelet_id(index), bounds[index], _markings(lane))
        _describe(lanelet, lane, signs[lane.lane.speed_limit_mps], lights.get(index, {}), opposite.get(index))
    for number, strip in enumerate(border_strips(graph, bounds, opposite)):
        child(_add_lanelet(root, _BORDERS + number, strip, _UNMARKED), "laneletType", "border")
    for number, surface in enumerate(junction_surfaces(network, bounds)):
        child(_add_lanelet(root, _SURFACES + number, surface, _UNMARKED), "laneletType", "intersection")
    for limit, number in signs.items():
        first = next(lane for lane in graph.values() if lane.lane.speed_limit_mps == limit)
        sign = child(root, "trafficSign", id=number)
        children(child(sign, "trafficSignElement"), trafficSignID="274", additionalValue=limit)
        _add_point(child(sign, "position"), first.right[0])
        child(sign, "virtual", text=True)
    cycles = _cycles(record)
    for lane_lights in lights.values():
        for number, connection in lane_lights.items():
            _add_light(root, number, connection, graph, cycles)
    _add_intersections(root, network, graph, arm_names)


def _add_lanelet(root: Element, number: int, bounds: Bounds, markings: tuple[str, str]) -> Element:
    lanelet = child(root, "lanelet", id=number)
    for tag, points, marking in zip(("leftBound", "rightBound"), (bounds.left, bounds.right), markings, strict=True):
        bound = child(lanelet, tag)
        for place in points:
            _add_point(bound, place)
        child(bound, "lineMarking", marking)
    return lanelet


def _markings(lane: GraphLane) -> tuple[str, str]:
    """Line markings of the left and the right boundary."""
    if lane.in_junction:
        return _UNMARKED
    left, right = (
        "solid" if neighbour is None else "dashed" for neighbour in (lane.left_neighbour, lane.right_neighbour)
    )
    return left, right


def _describe(
    lanelet: Element, lane: GraphLane, sign: int, lights: Mapping[int, Connection], opposite: int | None
) -> None:
    for tag, others in (("predecessor", lane.predecessors), ("successor", lane.successors)):
        for other in others:
            child(lanelet, tag, ref=lanelet_id(other))
    if lane.left_neighbour is not None:
        child(lanelet, "adjacentLeft", ref=lanelet_id(lane.left_neighbour), drivingDir="same")
    elif opposite is not None:
        child(lanelet, "adjacentLeft", ref=lanelet_id(opposite), drivingDir="opposite")
    if lane.right_neighbour is not None:
        child(lanelet, "adjacentRight", ref=lanelet_id(lane.right_neighbour), drivingDir="same")
    if lights:
        line = child(lanelet, "stopLine")
        _add_point(line, lane.left[-1])
        _add_point(line, lane.right[-1])
        child(line, "lineMarking", "solid")
        for light in lights:
            child(line, "trafficLightRef", ref=light)
    child(lanelet, "laneletType", _KIND.get(lane.lane.kind, "urban"))
    child(lanelet, "userOneWay", "vehicle" if lane.lane.civilian_allowed else "priorityVehicle")
    child(lanelet, "trafficSignRef", ref=sign)
    for light in lights:
        child(lanelet, "trafficLightRef", ref=light)


def _lights(network: RoadNetwork, graph: Mapping[int, GraphLane]) -> dict[int, dict[int, Connection]]:
    """Traffic lights by the lane at which they stand and by their ids; one light per direction."""
    by_direction: dict[tuple[int, str], Connection] = {}
    for connection in network.connections:
        if connection.signal_id is not None and connection.from_lane in graph:
            direction = _DIRECTION.get(connection.direction, "all")
            by_direction.setdefault((connection.from_lane, direction), connection)
    lights: dict[int, dict[int, Connection]] = {}
    for number, ((lane, _), connection) in enumerate(by_direction.items(), start=_LIGHTS):
        lights.setdefault(lane, {})[number] = connection
    return lights


def _cycles(record: EpisodeRecord) -> dict[str, list[str]]:
    """State strings of each signal at 10 Hz."""
    cycles: dict[str, list[str]] = {}
    for traffic in record.traffic:
        if traffic.step % LOG_PERIOD_STEPS == 0:
            for signal in traffic.signals:
                cycles.setdefault(signal.signal_id, []).append(signal.state)
    return cycles


def _add_light(
    root: Element, number: int, connection: Connection, graph: Mapping[int, GraphLane], cycles: Mapping[str, list[str]]
) -> None:
    """Add a light whose cycle is the recorded one, from the start of the episode to its end."""
    states = cycles.get(str(connection.signal_id), [])
    colours = [_COLOUR.get(state[connection.signal_link].lower(), "inactive") for state in states] or ["inactive"]
    light_element = child(root, "trafficLight", id=number)
    cycle = child(light_element, "cycle")
    for colour, same in groupby(colours):
        children(child(cycle, "cycleElement"), duration=len(list(same)), color=colour)
    _add_point(child(light_element, "position"), graph[connection.from_lane].right[-1])
    children(light_element, direction=_DIRECTION.get(connection.direction, "all"), active=True)


def _opposite_lanes(network: RoadNetwork, graph: Mapping[int, GraphLane]) -> dict[int, int]:
    """For each leftmost lane, the lane of the opposite direction that shares its left boundary."""
    outer: dict[tuple[str, str], list[int]] = {}
    for index, lane in graph.items():
        edge = network.edges[lane.lane.edge]
        if lane.left_neighbour is None and not edge.internal:
            outer.setdefault((edge.from_junction, edge.to_junction), []).append(index)
    opposite = {}
    for (start, end), lanes in outer.items():
        for index in lanes:
            for other in outer.get((end, start), []):
                line, other_line = graph[index].left, graph[other].left
                if max(np.hypot(*(line[0] - other_line[-1])), np.hypot(*(line[-1] - other_line[0]))) < _OPPOSITE_M:
                    opposite[index] = other
    return opposite


def _add_intersections(root: Element, network: RoadNetwork, graph: Mapping[int, GraphLane], arm_names: str) -> None:
    """Add junctions with their incoming lanes by road, and the first lanelets of each direction."""
    by_junction: dict[str, dict[int, list[Connection]]] = {}
    for connection in network.connections:
        if connection.via and connection.from_lane in graph and connection.via[0] in graph:
            edge = network.lanes[connection.from_lane].edge
            if not network.edges[edge].internal:
                by_junction.setdefault(connection.junction, {}).setdefault(edge, []).append(connection)
    numbers = count(_INCOMINGS)
    for junction, edges in enumerate(by_junction.values()):
        intersection = child(root, "intersection", id=_JUNCTIONS + junction)
        for connections in edges.values():
            incoming = child(intersection, "incoming", id=next(numbers))
            for lane in sorted({connection.from_lane for connection in connections}):
                child(incoming, "incomingLanelet", ref=lanelet_id(lane))
            ways = {(_DIRECTION.get(item.direction, "straight"), item.via[0]) for item in connections}
            for tag in ("Right", "Straight", "Left"):
                for lane in sorted(lane for direction, lane in ways if direction == tag.lower()):
                    child(incoming, f"{arm_names}{tag}", ref=lanelet_id(lane))


def _add_point(parent: Element, place: Points) -> None:
    children(child(parent, "point"), x=place[0], y=place[1])


class CommonRoadExporter(FilesExporter):
    """Writes one XML file per episode."""

    by_split = True

    def __init__(self, intersections: str) -> None:
        self._arm_names = intersections

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Write the scenario; all tracks of the episode are in memory."""
        record = source.record().right_hand
        tracks = tracks_of(record)
        emv_id = min(record.emv_ids)
        emv = next((track for track in tracks if track.actor.actor_id == emv_id), None)
        if emv is None or len(emv) < 2:
            raise BagError(str(source.path), "an episode in which the EMV drives")
        root = scenario_root(record, source.description, self._arm_names)
        others = [track for track in tracks if track is not emv and len(track) > 1]
        for track in others:
            add_obstacle(root, track)
        add_problem(root, emv)
        if source.network.left_hand:
            mirror_commonroad(root)
        files.write(f"{episode_id}.xml", document(root))
        types = Counter(obstacle_type(track.actor.actor_class) for track in others)
        return EpisodeReport({"scenarios": 1, "obstacles": len(others)}, dict(types))


def obstacle_type(actor_class: ActorClass) -> str:
    """CommonRoad's type of a vehicle; emergency vehicles are ``priorityVehicle``."""
    if actor_class in EMERGENCY_CLASSES:
        return "priorityVehicle"
    return _TYPE_OF_CLASS.get(actor_class, "car")


def benchmark_id(description: EpisodeDescription) -> str:
    """Benchmark id such as ``ZAM_SirenS2town-1_1_T-1``; ZAM is CommonRoad's country code for fictitious places."""
    letters = "".join(letter for letter in f"{description.template}{description.map_name}" if letter.isalnum())
    return f"ZAM_Siren{letters}-{description.seed + 1}_1_T-1"


def scenario_root(record: EpisodeRecord, description: EpisodeDescription, arm_names: str = "outgoing") -> Element:
    """A scenario that has everything but vehicles: its head, its place and the lanelet network (``add_network``)."""
    root = Element(
        "commonRoad",
        {
            "timeStepSize": f"{FRAME_S:g}",
            "commonRoadVersion": VERSION,
            "author": "SIREN",
            "affiliation": "SIREN",
            "source": f"SIREN, template {description.template}, level {description.level.name}",
            "benchmarkID": benchmark_id(description),
            "date": "1970-01-01",
        },
    )
    origin = record.network.origin_lat_lon_deg
    known = {} if origin is None else {"gpsLatitude": origin[0], "gpsLongitude": origin[1]}
    children(child(root, "location"), **{**_UNKNOWN_PLACE, **known})
    children(child(root, "scenarioTags"), urban=None, simulated=None)
    add_network(root, record, arm_names)
    return root


def add_obstacle(root: Element, track: Track) -> None:
    """Add a vehicle that drives as its track says; whoever plans in the scenario must not hit it."""
    obstacle = child(root, "dynamicObstacle", id=_OBSTACLES + track.actor.actor_id)
    child(obstacle, "type", obstacle_type(track.actor.actor_class))
    children(child(obstacle, "shape/rectangle"), length=track.actor.length_m, width=track.actor.width_m)
    _add_state(child(obstacle, "initialState"), track, 0)
    trajectory = child(obstacle, "trajectory")
    for row in range(1, len(track)):
        _add_state(child(trajectory, "state"), track, row)


def _add_state(state: Element, track: Track, row: int) -> None:
    _add_point(child(state, "position"), track.xy_m[row])
    child(state, "orientation/exact", track.yaw_rad[row])
    child(state, "time/exact", track.frame[row])
    child(state, "velocity/exact", track.speed_mps[row])
    child(state, "acceleration/exact", track.accel_mps2[row])


def add_problem(root: Element, emv: Track) -> None:
    """Add the planning problem: from the EMV's first state to its last place, in as much time as the EMV needed."""
    problem = child(root, "planningProblem", id=_PROBLEM + emv.actor.actor_id)
    state = child(problem, "initialState")
    _add_state(state, emv, 0)
    for tag in ("yawRate", "slipAngle"):
        child(state, f"{tag}/exact", 0.0)
    goal, last = child(problem, "goalState"), int(emv.frame[-1])
    rectangle = child(goal, "position/rectangle")
    children(rectangle, length=_GOAL_LENGTH_M, width=_GOAL_WIDTH_M, orientation=emv.yaw_rad[-1])
    children(child(rectangle, "center"), x=emv.x_m[-1], y=emv.y_m[-1])
    children(child(goal, "time"), intervalStart=max(1, last // 2), intervalEnd=last)


_SIDES: Final = ("left", "right", "Left", "Right")
_LANELET: Final = ("leftBound", "rightBound", "predecessor", "successor", "adjacentLeft", "adjacentRight")
"""Tags of a lanelet that come first, in the order of the schema."""
_ARMS: Final = ("incomingLanelet", "Right", "Straight", "Left")
"""Endings of the tags of an intersection's arm, in the order of the schema."""


def mirror_commonroad(root: Element) -> None:
    """Exchange left and right in place: coordinates, angles, names and the order of elements.

    A scenario with left-hand traffic is written as the mirror image, about its x axis, of one with right-hand traffic.
    """
    for tag in ("y", "orientation", "orientation/exact"):
        for number in root.iterfind(f".//{tag}"):
            if number.text and number.text.strip():
                number.text = negated(number.text)
    for direction in root.iter("direction"):
        direction.text = OTHER_SIDE.get(direction.text or "", direction.text)
    for lanelet in root.iter("lanelet"):
        for part in lanelet:
            part.tag = _exchanged(part.tag)
        lanelet[:] = sorted(lanelet, key=lambda part: _rank(_LANELET, part.tag))
    for arm in root.iter("incoming"):
        for part in arm:
            part.tag = _exchanged(part.tag)
        arm[:] = sorted(arm, key=lambda part: _rank(_ARMS, part.tag))


def _exchanged(tag: str) -> str:
    side = next((side for side in _SIDES if tag.startswith(side) or tag.endswith(side)), "")
    return tag.replace(side, OTHER_SIDE[side]) if side else tag


def _rank(order: tuple[str, ...], tag: str) -> int:
    return next((rank for rank, end in enumerate(order) if tag.endswith(end)), len(order))
