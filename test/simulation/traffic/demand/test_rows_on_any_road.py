"""Rows of lanes in which groups start, on a straight approach to a signal."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.roads.road_network import Connection, Edge, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.sites import Site, SiteKind
from siren_ros.simulation.scenario.scenario import DemandGroup, GroupAnchor, Placement
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.emv_start import EmvStart
from siren_ros.simulation.traffic.demand.group_demand import GroupRow, group_rows

WIDTH_M = 3.5


class _Road:
    def __init__(self) -> None:
        self.lanes: list[Lane] = []
        self.edges: list[Edge] = []
        self.connections: list[Connection] = []

    def edge(self, from_m: float, to_m: float, offsets: tuple[int, ...], kind: LaneKind = LaneKind.DRIVING) -> None:
        edge, first = len(self.edges), len(self.lanes)
        for position, offset in enumerate(offsets):
            centre = Polyline.through(np.array([[from_m, WIDTH_M * offset], [to_m, WIDTH_M * offset]]))
            name = f"e{edge}_{position}"
            self.lanes.append(Lane(first + position, name, edge, position, kind, centre, WIDTH_M, 8.3, True, True))
        lanes = tuple(range(first, len(self.lanes)))
        self.edges.append(Edge(edge, f"e{edge}", lanes, f"J{edge}", f"J{edge + 1}", kind is LaneKind.INTERNAL))

    def connect(self, source: int, target: int, via: tuple[int, ...] = ()) -> None:
        junction = f"J{self.lanes[target].edge}"
        self.connections.append(Connection(source, target, via, "s", None, -1, False, junction))

    def site(self, edges: tuple[int, ...], approach_lane: int, movements: tuple[int, ...]) -> Site:
        edge = self.lanes[approach_lane].edge
        where = (edges, edges.index(edge), edge, (edge,), approach_lane)
        return Site(SiteKind.QUEUED_APPROACH, "here", "J", *where, 100.0, movements, (), 1.0)

    def built(self) -> RoadNetwork:
        return RoadNetwork(tuple(self.lanes), tuple(self.edges), tuple(self.connections), {}, (0.0, 0.0), "!")


def rows_of(road: _Road, site: Site, start: EmvStart, group: DemandGroup, arrival_s: float = 8.0) -> list[GroupRow]:
    return group_rows(road.built(), site, start, group, arrival_s, np.random.default_rng(0))


def test_the_second_queue_of_s1_stands_in_one_lane_next_to_the_emvs() -> None:
    road = _Road()
    road.edge(0.0, 200.0, (0, 1, 2, 3))
    road.edge(200.0, 400.0, (0, 1, 2, 3))
    for lane in range(4):
        road.connect(lane, 4 + lane)
    group = next(group for group in load_template("S1").demand.groups if group.name == "queue_right")
    start = EmvStart(3, 50.0, (0, 1), (3,))
    assert [row.chain.lanes[0] for row in rows_of(road, road.site((0, 1), 3, (0, 1, 2, 3)), start, group)] == [2]
    pocket = road.site((0, 1), 2, (0, 1, 2))
    (row,) = rows_of(road, pocket, replace(start, lane=2, lanes_to_site=(2,)), group)
    assert row.chain.lanes[0] == 1, "the lane on the left leads elsewhere"


def fanning_road() -> "_Road":
    """One lane for 100 m, then a junction of 20 m and two lanes up to the site."""
    road = _Road()
    road.edge(0.0, 100.0, (0,))
    road.edge(120.0, 150.0, (0, 1))
    road.edge(150.0, 300.0, (0, 1))
    for source, target in ((0, 1), (0, 2), (1, 3), (2, 4)):
        road.connect(source, target)
    return road


@pytest.mark.parametrize("approach_lane", [1, 2])
@pytest.mark.parametrize("arrival_s", [10.0, 20.0])
def test_a_stream_that_the_emv_comes_up_next_to_starts_where_it_comes_with_the_emv(
    approach_lane: int, arrival_s: float
) -> None:
    road, group = fanning_road(), load_template("S3").demand.groups[0]
    assert (group.placement, group.anchor) == (Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL)
    start = EmvStart(0, 10.0, (0, 1, 2), (0, approach_lane))
    (row,) = rows_of(road, road.site((0, 1, 2), approach_lane, (2, 3)), start, group, arrival_s)
    assert approach_lane not in row.chain.lanes
    line_m = sum(road.lanes[lane].length_m for lane in row.chain.lanes[:2])
    early_m = group.first_gap_m - (0.0 - 8.0)  # its junctions have no paths
    assert row.anchor_m == pytest.approx(line_m - group.speed_mps * arrival_s - early_m, abs=1.0)


def test_a_stream_in_the_emvs_only_lane_is_followed() -> None:
    road = _Road()
    road.edge(0.0, 100.0, (0,))
    road.edge(100.0, 300.0, (0,))
    road.connect(0, 1)
    start = EmvStart(0, 10.0, (0, 1), (0,))
    (row,) = rows_of(road, road.site((0, 1), 0, (0,)), start, load_template("S3").demand.groups[0])
    assert row.anchor_m == pytest.approx(10.0 - 6.0)
