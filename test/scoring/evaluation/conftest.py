"""Maps that the tests of the evaluation share, and figures in place of files."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure
from synthetic_episode import NET_XML

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import Connection, Edge, Lane, LaneKind, RoadNetwork


@pytest.fixture(scope="session")
def straight_road() -> RoadNetwork:
    """Lanes eastwards at y = −5.25 and −1.75, westwards above, 300 m, 13.89 m/s."""
    return parse_road_network(NET_XML.encode())


@pytest.fixture
def figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that a test saves; their files are empty, and lie in a folder of the test."""
    kept: list[Figure] = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: (kept.append(figure), path.touch()))
    return kept


def _lane(index: int, edge: int, kind: LaneKind, points: list[tuple[float, float]]) -> Lane:
    return Lane(index, f"l{index}", edge, 0, kind, Polyline.through(points), 3.5, 10.0, True, True)


@pytest.fixture(scope="session")
def crossroads() -> RoadNetwork:
    """From lane 0 (100 m east to the origin) left to lane 1, straight on to lane 2, right to lane 3; paths 4, 5, 6."""
    lanes = (
        _lane(0, 0, LaneKind.DRIVING, [(-100.0, 0.0), (0.0, 0.0)]),
        _lane(1, 1, LaneKind.DRIVING, [(20.0, 20.0), (20.0, 120.0)]),
        _lane(2, 2, LaneKind.DRIVING, [(40.0, 0.0), (140.0, 0.0)]),
        _lane(3, 3, LaneKind.DRIVING, [(20.0, -20.0), (20.0, -120.0)]),
        _lane(4, 4, LaneKind.INTERNAL, [(0.0, 0.0), (14.0, 6.0), (20.0, 20.0)]),
        _lane(5, 5, LaneKind.INTERNAL, [(0.0, 0.0), (40.0, 0.0)]),
        _lane(6, 6, LaneKind.INTERNAL, [(0.0, 0.0), (14.0, -6.0), (20.0, -20.0)]),
    )
    edges = tuple(Edge(lane.index, f"e{lane.index}", (lane.index,), "a", "b", lane.index > 3) for lane in lanes)
    connections = tuple(
        Connection(0, to_lane, (to_lane + 3,), letter, None, -1, False, "j")
        for to_lane, letter in ((1, "l"), (2, "s"), (3, "r"))
    )
    return RoadNetwork(lanes, edges, connections, {}, (0.0, 0.0), "!")
