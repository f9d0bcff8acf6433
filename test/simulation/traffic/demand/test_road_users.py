"""Vehicles, their sizes and their routes; pedestrians."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from made_streets import (
    A_RIGHT,
    B_LEFT,
    B_RIGHT,
    STRAIGHT,
    TURN,
    A,
    B,
    C,
    D,
    same_drivers,
    streets,
)
from traffic_helpers import DIMENSIONS, load_map

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError, MapError
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.roads.road_network import Connection, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import EdgeGraph, connections_between, driving_lanes, route_path
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.traffic.demand.plan import PlannedWalker, load_drivers
from siren_ros.simulation.traffic.demand.road_users import (
    WIDEST_M,
    RouteChooser,
    VehicleFactory,
    largest,
    plan_walkers,
    tightest_radius_m,
    varied_size,
)
from siren_ros.simulation.world.actors import ActorClass

CAR_M, BUS_M = 4.5, 12.0


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    return load_map(None)[1]


@pytest.fixture(scope="module")
def graph(network: RoadNetwork) -> EdgeGraph:
    return EdgeGraph.of(network)


@pytest.fixture(scope="module")
def chooser(network: RoadNetwork, graph: EdgeGraph) -> RouteChooser:
    return RouteChooser(network, graph)


def movements(network: RoadNetwork, edge: int, following: int) -> list[Connection]:
    """Movements of civilians from one edge to another."""
    ways = connections_between(network, edge, following)
    return [way for way in ways if network.lanes[way.from_lane].civilian_allowed]


def starts(network: RoadNetwork, graph: EdgeGraph) -> list[Lane]:
    """Driving lanes from which one can drive on."""
    edges = [edge.index for edge in network.edges if graph.successors[edge.index]]
    return [lane for edge in edges for lane in driving_lanes(network, edge)]


def test_every_route_can_be_driven_lane_by_lane_and_is_long_enough(
    network: RoadNetwork, graph: EdgeGraph, chooser: RouteChooser
) -> None:
    for number, start in enumerate(starts(network, graph)):
        route = chooser.draw((start.edge,), 900.0, np.random.default_rng(number), CAR_M)
        assert route == chooser.draw((start.edge,), 900.0, np.random.default_rng(number), CAR_M)
        assert graph.route_length_m(route) >= 900.0 or not graph.successors[route[-1]]
        assert route[0] == start.edge
        lanes = [network.lanes[index] for index in route_path(network, route, start.index)]
        for lane, ahead in pairwise(lanes):
            if lane.edge == ahead.edge:
                assert abs(lane.position - ahead.position) == 1
            else:
                assert np.linalg.norm(lane.centre.points[-1] - ahead.centre.points[0]) < 0.1
        driven = dict.fromkeys(lane.edge for lane in lanes if lane.kind is LaneKind.DRIVING)
        assert list(driven) == list(dict.fromkeys(route))


def arc(radius_m: float, start_rad: float, end_rad: float) -> np.ndarray:
    """To the left, from heading east at the origin on; points every 2 cm or so."""
    angle = np.linspace(start_rad, end_rad, 1 + int(radius_m * (end_rad - start_rad) / 0.02))
    return radius_m * np.stack((np.sin(angle), 1.0 - np.cos(angle)), axis=-1)


@pytest.mark.parametrize("radius_of_bend_m", [5.0, 12.5, 60.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_arc_has_its_radius(radius_of_bend_m: float, side: float) -> None:
    bend = arc(radius_of_bend_m, 0.0, 1.5) * (1.0, side)
    assert tightest_radius_m(Polyline.through(bend)) == pytest.approx(radius_of_bend_m, rel=0.01)


@pytest.mark.parametrize(("straight_m", "bend_m", "radius_m"), [(20.0, 6.0, 8.0), (20.0, 3.0, 16.0), (0.0, 2.0, 8.0)])
def test_a_bend_at_either_end_counts_over_6_m_or_over_the_whole_path(
    straight_m: float, bend_m: float, radius_m: float
) -> None:
    """A radius of 8 m: half a measure of bend is a bend of twice the radius."""
    points = np.concatenate((np.array([(-straight_m, 0.0)]), arc(8.0, 0.0, bend_m / 8.0)[int(straight_m == 0.0) :]))
    for way in (points, points[::-1]):
        assert tightest_radius_m(Polyline.through(way)) == pytest.approx(radius_m, rel=0.02)


@pytest.mark.parametrize(
    ("vehicle_m", "radius_m", "edge"),
    [(CAR_M, None, D), (BUS_M, None, C), (CAR_M, 5.0, D), (CAR_M, 4.5, D), (CAR_M, 3.0, C), (BUS_M, 5.0, C)],
)
def test_in_a_lane_that_only_turns_tightly_cars_turn_slowly_and_who_cannot_goes_on_from_the_next_lane(
    vehicle_m: float, radius_m: float | None, edge: int
) -> None:
    """The right lane leads south alone, round a corner; the left one goes straight on. Cars can steer 4.1 m."""
    roads = streets()
    turn, lanes = roads.connections[TURN], list(roads.lanes)
    corner = lanes[turn.from_lane].centre.points[-1]
    end = lanes[turn.to_lane].centre.points[0]
    if radius_m is not None:
        turned = np.linspace(0.0, 0.5 * np.pi, 20)
        arc = np.column_stack(
            (end[0] + radius_m * (np.sin(turned) - 1.0), corner[1] + radius_m * (np.cos(turned) - 1.0))
        )
        lanes[turn.via[0]] = replace(lanes[turn.via[0]], centre=Polyline.through([corner, *arc, end]))
    ways = (*roads.connections[:STRAIGHT], *roads.connections[STRAIGHT + 1 :])
    roads = replace(roads, connections=ways, lanes=tuple(lanes))
    chooser = RouteChooser(roads, EdgeGraph.of(roads))
    for seed in range(5):
        assert chooser.draw([A, B], 350.0, np.random.default_rng(seed), vehicle_m, B_RIGHT)[2] == edge
        assert chooser.draw([A, B], 350.0, np.random.default_rng(seed), vehicle_m, B_LEFT)[2] == C
    assert chooser.draw([A], 150.0, np.random.default_rng(1), vehicle_m, A_RIGHT) == (A,)


def test_a_class_without_dimensions_is_refused() -> None:
    with pytest.raises(InputError, match="dimensions: 'BUS'"):
        VehicleFactory(streets(), same_drivers(), {}).size(ActorClass.BUS)


def test_who_does_not_turn_left_goes_on_otherwise_where_there_is_a_way(
    network: RoadNetwork, graph: EdgeGraph, chooser: RouteChooser
) -> None:
    lefts = 0
    for number, lane in enumerate(starts(network, graph)):
        rng = np.random.default_rng(number)
        for edge, following in pairwise(chooser.draw((lane.edge,), 1000.0, rng, CAR_M, turns_left=False)):
            directions = {way: movements(network, edge, way)[0].direction for way in graph.successors[edge]}
            lefts += directions[following] == "l"
            assert directions[following] != "l" or set(directions.values()) == {"l"}
    assert lefts == 0 or "l" in {movement.direction for movement in network.connections}


SEDAN = (4.75, 1.83, 1.45)
BUS = (12.0, 2.55, 3.1)


def test_sizes_fill_the_spread_and_differ_by_seed_and_name() -> None:
    sizes = [varied_size(SEDAN, 0.1, seed, f"background{number}") for seed in range(10) for number in range(30)]
    assert sizes[0] == varied_size(SEDAN, 0.1, 0, "background0")
    assert len(set(sizes)) == len(sizes)
    shares = np.array(sizes) / SEDAN
    assert (np.abs(shares.min(axis=0) - 0.9) < 0.01).all()
    assert (np.abs(shares.max(axis=0) - 1.1) < 0.01).all()
    assert shares.mean(axis=0) == pytest.approx([1.0] * 3, abs=0.02)


def test_no_bus_is_wider_than_the_law_allows() -> None:
    widths = [varied_size(BUS, 0.1, seed, "bus")[1] for seed in range(50)]
    assert max(widths) == WIDEST_M
    assert min(widths) < 2.4


def test_traffic_is_planned_for_the_largest() -> None:
    planned = largest({ActorClass.SEDAN: SEDAN}, 0.1)[ActorClass.SEDAN]
    assert planned == pytest.approx((5.225, 2.013, 1.595))
    assert largest({ActorClass.SEDAN: SEDAN}, 0.0) == {ActorClass.SEDAN: SEDAN}


def test_only_sizes_change_where_an_episode_asks_for_them() -> None:
    plain = set_up_episode(EpisodeRequest("S2", seed=3, sensors="none")).plan
    varied = set_up_episode(EpisodeRequest("S2", seed=3, sensors="none", values="demand.variety.size_spread=0.1")).plan
    of_class = {kind: one.length_m for kind, one in load_vehicle_parameters().items()}
    assert all(one.length_m == of_class[one.actor_class] for one in (*plain.emvs, *plain.background))
    everybody = (*varied.emvs, *varied.groups, *varied.background, *varied.reserve)
    shares = [one.length_m / of_class[one.actor_class] for one in everybody]
    assert 0.9 - 1e-3 < min(shares) < 0.95
    assert 1.05 < max(shares) < 1.1 + 1e-3
    assert len(set(shares)) > 0.8 * len(shares)


CITY = load_map(Path("city"))[1]
STREETS = [lane for edge in CITY.edges for lane in driving_lanes(CITY, edge.index)[:1]]


def planned(count: int, seed: int = 0, near: list[Lane] = STREETS) -> tuple[PlannedWalker, ...]:
    factory = VehicleFactory(CITY, load_drivers(), DIMENSIONS)
    people, kept = plan_walkers(CITY, near, count, 1.0, seed, factory)
    assert len(people) == 2 * kept
    return people


def test_there_are_as_many_again_in_reserve_and_the_seed_decides() -> None:
    people = planned(30)
    assert len(people) == 60
    assert len({walker.name for walker in people}) == 60
    assert planned(30) == people
    assert planned(30, seed=1) != people
    assert planned(0) == ()


def test_a_few_sidewalks_have_room_for_few() -> None:
    walks = [CITY.lanes[CITY.edges[STREETS[0].edge].lanes[0]]]
    assert len(planned(400, near=STREETS[:1])) == 2 * int(walks[0].length_m / 4.0)


def test_a_street_without_sidewalk_has_no_people() -> None:
    bare = [lane for lane in CITY.lanes if lane.kind is LaneKind.INTERNAL][:3]
    with pytest.raises(MapError, match="sidewalks"):
        planned(5, near=bare)
