"""Classes and paints by their shares, and bodies of their classes."""

from collections import Counter

import numpy as np
import pytest
from made_streets import A_LEFT, A_RIGHT, A, B, same_drivers, streets
from traffic_helpers import DIMENSIONS

from siren_ros.errors import InputError
from siren_ros.traffic.demand.demand_config import DemandConfig
from siren_ros.traffic.demand.plan import Spot
from siren_ros.traffic.demand.vehicle_factory import VehicleFactory
from siren_ros.world.actors import ActorClass

NETWORK = streets()
FACTORY = VehicleFactory(NETWORK, same_drivers(), DIMENSIONS, DemandConfig())
DRAWS = 4000


def test_classes_come_by_their_shares_whatever_the_sum() -> None:
    shares = [(ActorClass.SEDAN, 6.0), (ActorClass.BUS, 1.0), (ActorClass.TRUCK, 3.0)]
    rng = np.random.default_rng(0)
    counts = Counter(FACTORY.draw_class(shares, rng) for _ in range(DRAWS))
    for kind, share in shares:
        assert counts[kind] / DRAWS == pytest.approx(share / 10.0, abs=0.03)


def test_a_class_without_dimensions_is_refused() -> None:
    with pytest.raises(InputError, match="dimensions: 'BUS'"):
        VehicleFactory(NETWORK, same_drivers(), {}, DemandConfig()).size(ActorClass.BUS)


def test_a_body_has_the_size_of_its_class_and_paints_come_by_their_shares() -> None:
    rng = np.random.default_rng(1)
    driver = FACTORY.draw_driver(ActorClass.BUS, rng)
    spot = Spot(A_LEFT, 30.0, 5.0)
    cars = [FACTORY.civilian("c", ActorClass.BUS, driver, ("a",), spot, rng) for _ in range(DRAWS)]
    assert (cars[0].length_m, cars[0].width_m, cars[0].height_m) == DIMENSIONS[ActorClass.BUS]
    assert not cars[0].is_emv
    paints = Counter(car.colour_rgb for car in cars)
    assert paints[236, 236, 234] / DRAWS == pytest.approx(0.26, abs=0.03)
    assert paints[176, 84, 32] / DRAWS == pytest.approx(0.01, abs=0.006)
    emv = FACTORY.emv("e", ActorClass.AMBULANCE, driver, ("a",), spot)
    assert emv.is_emv
    assert (emv.length_m, emv.width_m, emv.height_m) == DIMENSIONS[ActorClass.AMBULANCE]
    assert emv.colour_rgb == (240, 240, 236)


def test_a_way_is_as_long_as_its_edges() -> None:
    lengths = [NETWORK.lanes[NETWORK.edges[edge].lanes[0]].length_m for edge in (A, B)]
    assert FACTORY.length_m((A,)) == pytest.approx(lengths[0])
    assert FACTORY.length_m((A, B)) >= sum(lengths)
    assert FACTORY.leads_on(A)


@pytest.mark.parametrize("lane", [A_LEFT, A_RIGHT])
def test_a_civilians_route_begins_where_it_should(lane: int) -> None:
    route = FACTORY.draw_route((A, B), 10.0, np.random.default_rng(0), lane, ActorClass.SEDAN)
    assert route == (NETWORK.edges[A].edge_id, NETWORK.edges[B].edge_id)
