import numpy as np
import pytest

from siren_ros.behaviour.civilians.interaction_region import EmvRoad, region_members, way_from_emv_m
from siren_ros.world.actors import ActorClass

AMBULANCE = ActorClass.AMBULANCE


def view_of(lab, cars, network=None):
    network = network or lab.straight_road()
    return lab.view_of(lab.world_of(network, lab.L2), lab.traffic_of(network, cars))


def test_region_has_hysteresis(lab):
    def members(distance, before):
        view = view_of(lab, [lab.Car(1, 0, 50, 8, (0,), AMBULANCE), lab.Car(2, 0, 50 + distance, 2, (0,))])
        return region_members(view.seen, 0, np.array(before, dtype=np.uint32), 40.0, 50.0).tolist()

    assert members(39.9, []) == [2]
    assert members(40.1, []) == []
    assert members(40.1, [2]) == [2]
    assert members(50.0, [2, 9]) == [2]
    assert members(50.1, [2]) == []


def test_way_is_along_the_emvs_path(lab):
    network = lab.junction_road()
    cars = [
        lab.Car(1, 0, 100, 8, (0, 4), AMBULANCE),
        lab.Car(2, 7, 20, 5, (0, 4)),
        lab.Car(3, 1, 130, 5, (0, 2)),
        lab.Car(4, 4, 20, 5, (2,)),
    ]
    view = view_of(lab, cars, network)
    road = EmvRoad.ahead_of(view, 0, None)
    way = way_from_emv_m(view, 0, road.lane_start_m)
    turn = network.lanes[6].length_m
    assert way[1] == pytest.approx(50.0 + turn + 20.0 - 4.75 / 2.0 - 6.5 / 2.0, abs=0.05)
    assert np.isinf(way[2:]).all()
    beside = way_from_emv_m(view, 0, road.road_start_m)
    assert beside[2] == pytest.approx(30.0 - 4.75 / 2.0 - 6.5 / 2.0, abs=0.01)
    assert np.isinf(beside[3])
    assert road.on_road[[0, 4]].all()
    assert not road.on_road[2]


def test_road_is_kept_while_lane_and_route_stay(lab):
    view = view_of(lab, [lab.Car(1, 0, 100, 8, (0,), AMBULANCE)])
    road = EmvRoad.ahead_of(view, 0, None)
    assert EmvRoad.ahead_of(view, 0, road) is road
    other = view_of(lab, [lab.Car(1, 1, 100, 8, (0,), AMBULANCE)])
    assert EmvRoad.ahead_of(other, 0, road) is not road
