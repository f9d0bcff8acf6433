from pathlib import Path

import numpy as np
import pytest
from traffic_helpers import DIMENSIONS, load_map

from siren_ros.errors import MapError
from siren_ros.simulation.roads.road_network import Lane, LaneKind
from siren_ros.simulation.roads.routing import driving_lanes
from siren_ros.simulation.traffic.demand.pedestrians import PACE_MPS, plan_walkers
from siren_ros.simulation.traffic.demand.plan import PlannedWalker, load_drivers
from siren_ros.simulation.traffic.demand.vehicle_factory import VehicleFactory

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


def test_people_start_and_end_on_sidewalks_of_the_streets() -> None:
    people, edges = planned(40), {CITY.edges[lane.edge].edge_id for lane in STREETS}
    for walker in people:
        edge = CITY.edge_by_id[walker.edge]
        sidewalk = CITY.lanes[edge.lanes[0]]
        assert sidewalk.kind is LaneKind.SIDEWALK
        assert 0.0 <= walker.place_m <= sidewalk.length_m
        assert {walker.edge, *walker.goals} <= edges
        assert (walker.length_m, walker.width_m) == DIMENSIONS_OF_WALKER


DIMENSIONS_OF_WALKER = (4.6, 1.8)
"""Those that the table of these tests gives every class."""


def test_paces_are_those_of_people() -> None:
    paces = np.array([walker.speed_mps for walker in planned(400)])
    assert paces.mean() == pytest.approx(PACE_MPS.mean, abs=0.03)
    assert PACE_MPS.minimum <= paces.min() < 1.0
    assert 1.7 < paces.max() <= PACE_MPS.maximum


def test_a_street_without_sidewalk_has_no_people() -> None:
    bare = [lane for lane in CITY.lanes if lane.kind is LaneKind.INTERNAL][:3]
    with pytest.raises(MapError, match="sidewalks"):
        planned(5, near=bare)
