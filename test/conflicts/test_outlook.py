"""What is expected of a vehicle: its way, its right of way and the limit there, on a road with a junction."""

from dataclasses import dataclass

import numpy as np
import pytest

from siren_ros.conflicts.course import CourseBook
from siren_ros.conflicts.outlook import Outlook
from siren_ros.conflicts.right_of_way import Rank
from siren_ros.numerics.geometry import rotate
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import NO_LANE, Connection, Edge, Lane, LaneKind, RoadNetwork
from siren_ros.world.traffic_state import SignalState

HALF_LENGTH, HALF_WIDTH = np.array([2.5, 4.0]), np.array([0.9, 1.2])
TURNS = np.radians([0.0, 35.0, -120.0])


def network(turn=0.0, **control):
    """100 m, a junction of 20 m with a limit of 6 m/s, and 100 m; all straight on."""
    ways = ([[0.0, 0.0], [100.0, 0.0]], [[100.0, 0.0], [120.0, 0.0]], [[120.0, 0.0], [220.0, 0.0]])
    kinds = (LaneKind.DRIVING, LaneKind.INTERNAL, LaneKind.DRIVING)
    lanes = tuple(
        Lane(i, f"l{i}", i, 0, kind, Polyline.through(rotate(np.array(way), turn)), 3.3, limit, True, True)
        for i, (way, kind, limit) in enumerate(zip(ways, kinds, (14.0, 6.0, 9.0), strict=True))
    )
    edges = tuple(Edge(i, f"e{i}", (i,), f"J{i}", f"J{i + 1}", internal=i == 1) for i in range(3))
    plain = {"signal_id": None, "signal_link": -1, "must_stop": False}
    connection = Connection(0, 2, (1,), "s", junction="J", **{**plain, **control})
    return RoadNetwork(lanes, edges, (connection,), {}, (0.0, 0.0), "!")


@dataclass(frozen=True)
class Traffic:
    """What an outlook reads of a ``TrafficState``."""

    lane: np.ndarray
    lane_position_m: np.ndarray
    lateral_offset_m: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    yaw_rad: np.ndarray
    signals: tuple = ()

    def route_of_row(self, _row):
        return np.array([0, 2], dtype=np.int32)


def outlook_of(lane, front_m, turn=0.0, state="", left=0.4, **control):
    """The second of two vehicles is the one looked at; the first stands elsewhere."""
    x, y = rotate(np.array([front_m - 4.0, left]), turn)
    traffic = Traffic(
        lane=np.array([2, lane], np.int32),
        lane_position_m=np.array([50.0, front_m]),
        lateral_offset_m=np.array([0.0, left]),
        x_m=np.array([0.0, x]),
        y_m=np.array([0.0, y]),
        yaw_rad=np.array([0.0, turn]),
        signals=(SignalState("S", state),) if state else (),
    )
    return Outlook(traffic, CourseBook(network(turn, **control)), HALF_LENGTH, HALF_WIDTH)


@pytest.mark.parametrize("turn", TURNS)
def test_a_way_begins_at_the_bodys_centre_on_its_course(turn):
    outlook = outlook_of(0, 60.0, turn)
    assert outlook.centre_m(1) == pytest.approx(56.0)
    way = outlook.way(1, 30.0)
    assert (way.centre_m, way.left_m, way.reach_m) == pytest.approx((56.0, 0.4, 30.0))
    assert (way.half_length_m, way.half_width_m) == (4.0, 1.2)
    assert way.pose == pytest.approx((*rotate(np.array([56.0, 0.4]), turn), turn))
    np.testing.assert_allclose(way.points[round(150.0 / way.spacing_m)], rotate(np.array([150.0, 0.0]), turn), atol=0.6)


@pytest.mark.parametrize("turn", TURNS)
def test_off_the_road_the_way_is_straight_ahead_from_the_pose(turn):
    outlook = outlook_of(NO_LANE, 60.0, turn)
    assert outlook.centre_m(1) == 0.0
    way = outlook.way(1, 10.0)
    np.testing.assert_allclose(way.points[0], way.pose[:2])
    np.testing.assert_allclose(way.points[5], np.array(way.pose[:2]) + 5.0 * np.array([np.cos(turn), np.sin(turn)]))
    assert outlook.rank(1, 20.0) is Rank.PRIORITY
    assert np.isinf(outlook.limit_mps(1, 20.0))


@pytest.mark.parametrize(("way", "limit"), [(0.0, 14.0), (42.0, 14.0), (46.0, 6.0), (62.0, 6.0), (66.0, 9.0)])
def test_the_limit_is_that_of_the_lane_at_the_end_of_the_way(way, limit):
    assert outlook_of(0, 60.0).limit_mps(1, way) == limit


@pytest.mark.parametrize(("way", "rank"), [(39.9, Rank.PRIORITY), (40.1, Rank.STOP_SIGN), (70.0, Rank.STOP_SIGN)])
def test_the_movement_counts_from_where_the_front_reaches_the_junction(way, rank):
    assert outlook_of(0, 60.0, must_stop=True).rank(1, way) is rank


@pytest.mark.parametrize(("front", "rank"), [(99.9, Rank.RED), (100.0, Rank.RED), (100.1, Rank.PRIORITY)])
def test_whose_front_is_on_the_junction_already_is_let_off_it(front, rank):
    outlook = outlook_of(0, front, state="Gr", signal_id="S", signal_link=1)
    assert outlook.rank(1, 5.0) is rank
    assert outlook_of(0, front, state="GG", signal_id="S", signal_link=1).rank(1, 5.0) is Rank.PRIORITY


def test_on_the_junctions_own_lane_the_movement_is_known():
    outlook = outlook_of(1, 5.0, must_stop=True)
    assert outlook.centre_m(1) == pytest.approx(1.0)
    assert outlook.rank(1, 3.0) is Rank.PRIORITY
    assert outlook.limit_mps(1, 3.0) == 6.0


def test_a_course_is_worked_out_once():
    outlook = outlook_of(0, 60.0)
    assert outlook.course(1) is outlook.course(1)
    assert outlook.signals == {}
    assert outlook_of(0, 60.0, state="rG").signals == {"S": "rG"}
