"""The civilian that the AV drives, and its way."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_streets import (
    A_LEFT,
    A_RIGHT,
    B_LEFT,
    B_RIGHT,
    FAR,
    NEAR,
    group,
    same_drivers,
    signal_site,
    streets,
    template_with,
)
from traffic_helpers import DIMENSIONS, load_map, plan_s2

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.roads.road_network import Lane, LaneKind
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.scenario import GroupAnchor, Placement
from siren_ros.simulation.traffic.demand.av_way import av_way, choose_av, way_to_lane
from siren_ros.simulation.traffic.demand.demand import plan_traffic
from siren_ros.simulation.traffic.demand.plan import Spot

STREETS = streets()


@pytest.fixture(scope="module", name="town")
def _town() -> Any:
    network = load_map(None)[1]
    return network, plan_s2(network)[0]


def test_the_first_vehicle_of_the_platoon_is_chosen(town: Any) -> None:
    network, plan = town
    assert choose_av(network, plan) == "platoon0"
    assert choose_av(network, replace(plan, groups=plan.groups[::-1])) == "platoon0"


def test_a_template_without_vehicles_around_its_emv_is_refused(town: Any) -> None:
    network, plan = town
    with pytest.raises(InputError, match="av: 'civilian'"):
        choose_av(network, replace(plan, groups=()))


@pytest.mark.parametrize("template", ["S1", "S2", "S3", "S4", "S5", "S6", "S7"])
def test_every_template_has_an_av_with_a_way_without_jumps(template: str) -> None:
    setup = set_up_episode(EpisodeRequest(template, sensors="none", av="civilian"))
    av = next(vehicle for vehicle in setup.plan.groups if vehicle.name == setup.plan.av)
    assert setup.description.av_id == len(setup.plan.emvs) + 1
    way = av_way(setup.network, setup.plan)
    start = setup.network.lanes[av.spot.lane].centre.at(av.spot.front_m)
    assert abs(float(way.project(start)[1])) < 2.0
    turns = np.abs(np.diff(np.unwrap(way.resampled(0.5).heading_rad(way.resampled(0.5).arc_m))))
    assert turns.max() < 0.5


def test_the_way_begins_at_the_rear_of_the_av_or_where_its_lane_begins(town: Any) -> None:
    network, plan = town
    av = next(vehicle for vehicle in plan.groups if vehicle.name == "platoon0")
    way = av_way(network, replace(plan, av=av.name))
    rear = network.lanes[av.spot.lane].centre.at(av.spot.front_m - av.length_m)
    assert way.points[0] == pytest.approx(rear, abs=1e-6)
    early = replace(av, spot=replace(av.spot, front_m=0.5 * av.length_m))
    way = av_way(network, replace(plan, av=av.name, groups=(early,)))
    assert way.points[0] == pytest.approx(network.lanes[av.spot.lane].centre.points[0], abs=1e-6)


@pytest.mark.parametrize("turn", [0.0, 0.8, -2.0])
def test_a_lane_change_on_the_way_is_half_a_cosine(turn: float) -> None:
    """From 20 m of the right lane to the end of the left one, 3.5 m aside at 100 m."""
    along, left = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    centres = [Polyline.through([i * 3.5 * left, 100.0 * along + i * 3.5 * left]) for i in (0, 1)]
    lanes = [Lane(i, f"l{i}", 0, i, LaneKind.DRIVING, centres[i], 3.5, 14.0, True, True) for i in (0, 1)]
    for origin, target, start in ((0, 1, 0.0), (1, 0, 3.5)):
        way = way_to_lane(lanes[origin], lanes[target], 20.0)
        s = (way.points - 20.0 * along) @ along
        aside = start + (3.5 - 2.0 * start) * (0.5 - 0.5 * np.cos(np.pi * s / 80.0))
        assert way.points @ left == pytest.approx(aside, abs=1e-6)
        assert (s[0], s[-1]) == pytest.approx((0.0, 80.0))


def chosen(*places: tuple[str, int, float]) -> str:
    """Of vehicles on two streets that cross; the EMV's front is 110 m after the beginning of its lane."""
    template = template_with(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=1), start_m=-200.0)
    plan = plan_traffic(STREETS, signal_site(), template, 3, same_drivers(), DIMENSIONS)
    (emv,), (neighbour, *_) = plan.emvs, plan.groups
    assert emv.spot.lane == A_LEFT
    emv = replace(emv, spot=replace(emv.spot, front_m=110.0))
    groups = tuple(replace(neighbour, name=name, spot=Spot(lane, front_m, 5.0)) for name, lane, front_m in places)
    return choose_av(STREETS, replace(plan, emvs=(emv,), groups=groups))


@pytest.mark.parametrize(
    ("places", "name"),
    [
        # The EMV's lane comes before the others of its way, however far ahead.
        ([("a", A_RIGHT, 115.0), ("b", A_LEFT, 180.0)], "b"),
        ([("a", B_RIGHT, 5.0), ("b", B_LEFT, 90.0)], "b"),
        # In each of them the nearest counts, also on the next edge.
        ([("a", B_LEFT, 60.0), ("b", B_LEFT, 20.0)], "b"),
        ([("a", B_LEFT, 20.0), ("b", A_LEFT, 190.0)], "b"),
        ([("a", A_RIGHT, 160.0), ("b", A_RIGHT, 130.0)], "b"),
        # Who is behind or just abreast is not passed.
        ([("a", A_LEFT, 110.0), ("b", A_LEFT, 150.0)], "b"),
        ([("a", A_LEFT, 109.5), ("b", A_RIGHT, 190.0)], "b"),
        ([("a", A_LEFT, 90.0), ("b", A_RIGHT, 111.0)], "b"),
        # Where nobody is on the way, the nearest on the side road: it comes from the north, 190 m and then 100 m.
        ([("a", FAR, 150.0), ("b", NEAR, 80.0)], "b"),
        ([("a", NEAR, 80.0), ("b", FAR, 150.0)], "a"),
    ],
)
def test_the_emvs_lane_comes_first_then_its_way_then_the_nearest(places: Any, name: str) -> None:
    assert chosen(*places) == name
