import math

import numpy as np
import pytest
from traffic_helpers import MAPS, load_map, named_map

from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.roads.site_finder import require_site
from siren_ros.simulation.roads.sites import SiteKind
from siren_ros.simulation.scenario.scenario import EmvDemand
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.emv_start import (
    EMV_ACCEL_MPS2,
    EmvStart,
    emv_start,
    start_m_of,
    unhindered_arrival_s,
    way_to_stop_line_m,
)


@pytest.fixture(scope="module")
def town() -> RoadNetwork:
    return load_map(None)[1]


def demand(start_m: float, speed_mps: float = 10.0, depart_mps: float = 10.0) -> EmvDemand:
    emv = load_template("S4").emv
    return EmvDemand(emv.actor_class, 1, start_m, speed_mps, depart_mps, 3.0, emv.start_from)


def straight_start(network: RoadNetwork) -> tuple[EmvStart, float]:
    lane = next(
        lane
        for lane in network.lanes
        if lane.kind is LaneKind.DRIVING
        and lane.length_m > 100.0
        and np.ptp(np.unwrap(lane.centre.heading_rad(lane.centre.arc_m))) < 1e-6
    )
    return EmvStart(lane.index, lane.length_m - 80.0, (lane.edge,), (lane.index,)), 80.0


def test_constant_speed_takes_distance_over_speed(town: RoadNetwork) -> None:
    start, way_m = straight_start(town)
    assert way_to_stop_line_m(town, start) == pytest.approx(way_m)
    assert unhindered_arrival_s(town, start, demand(-way_m)) == pytest.approx(way_m / 10.0, abs=0.06)


def test_speeding_up_follows_the_constant_acceleration(town: RoadNetwork) -> None:
    start, way_m = straight_start(town)
    accel = EMV_ACCEL_MPS2
    changing_m = (12.0**2 - 6.0**2) / (2.0 * accel)
    expected_s = (12.0 - 6.0) / accel + (way_m - changing_m) / 12.0
    arrival_s = unhindered_arrival_s(town, start, demand(-way_m, 12.0, 6.0))
    assert arrival_s == pytest.approx(expected_s, abs=0.15)


def test_bends_take_longer_than_the_same_way_straight(town: RoadNetwork) -> None:
    bent = max(
        (lane for lane in town.lanes if lane.kind is LaneKind.DRIVING and lane.length_m > 60.0),
        key=lambda lane: float(np.ptp(np.unwrap(lane.centre.heading_rad(lane.centre.arc_m)))),
    )
    start = EmvStart(bent.index, 0.0, (bent.edge,), (bent.index,))
    arrival_s = unhindered_arrival_s(town, start, demand(0.0, 20.0, 20.0))
    assert arrival_s > 1.1 * bent.length_m / 20.0


@pytest.mark.parametrize("kind", [SiteKind.SIGNAL_JUNCTION, SiteKind.STOP_JUNCTION, SiteKind.QUEUED_APPROACH])
@pytest.mark.parametrize("name", MAPS)
def test_start_before_the_stop_line_is_as_far_back_as_the_template_says_or_as_the_approach_reaches(
    kind: SiteKind, name: str
) -> None:
    _, network = named_map(name)
    site = require_site(network, kind)
    ways = []
    for back_m in range(10, 100, 10):
        start = emv_start(network, site, start_m_of(network, site, demand(-back_m)))
        ways.append(way_to_stop_line_m(network, start))
        across = (network.lanes[lane] for lane in start.lanes_to_site)
        junction_m = sum(lane.length_m for lane in across if lane.kind is LaneKind.INTERNAL)
        # A start inside a junction is put before it, 20 m at most.
        assert min(back_m - 8.0, 0.6 * back_m) - 0.01 <= ways[-1] <= back_m + junction_m + 20.01
        assert start.front_m > 0.0
    assert ways == sorted(ways)
    far = emv_start(network, site, start_m_of(network, site, demand(-500.0)))
    assert 25.0 < way_to_stop_line_m(network, far) < math.inf
    assert far.front_m >= 8.0 - 1e-6
    assert far.route[-1] == site.route[-1]


def test_nobody_starts_on_a_shoulder(town: RoadNetwork) -> None:
    """The site is a turn along the shoulder; the EMV comes in the lane next to it and has to choose the shoulder."""
    site = require_site(town, SiteKind.SHOULDER_RIGHT_TURN)
    start = emv_start(town, site, start_m_of(town, site, demand(-70.0)))
    shoulder, lane = town.lanes[site.approach_lane], town.lanes[start.lane]
    assert shoulder.kind is LaneKind.SHOULDER
    assert lane.kind is LaneKind.DRIVING
    assert town.neighbour(town.lanes[start.lanes_to_site[-1]], -1) == shoulder
