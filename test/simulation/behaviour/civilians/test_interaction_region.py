import numpy as np
import pytest

from siren_ros.simulation.behaviour.civilians.yield_manager import EmvRoad, region_members, way_from_emv_m
from siren_ros.simulation.scenario.paper import PAPER_CONSTANTS
from siren_ros.simulation.world.actors import ActorClass

AMBULANCE = ActorClass.AMBULANCE


def view_of(lab, cars, network=None):
    network = network or lab.straight_road()
    return lab.view(network, lab.L2, cars)


def test_region_has_hysteresis(lab):
    def members(distance, before):
        view = view_of(lab, [lab.Car(1, 0, 50, 8, (0,), AMBULANCE), lab.Car(2, 0, 50 + distance, 2, (0,))])
        return region_members(view.seen, 0, np.array(before, dtype=np.uint32), PAPER_CONSTANTS).tolist()

    assert (members(39.9, []), members(40.1, []), members(40.1, [2])) == ([2], [], [2])
    assert (members(50.0, [2, 9]), members(50.1, [2])) == ([2], [])


def test_way_is_along_the_emvs_path(lab, junction):
    cars = [
        *[lab.Car(1, 0, 100, 8, (0, 4), AMBULANCE), lab.Car(2, 7, 20, 5, (0, 4))],
        *[lab.Car(3, 1, 130, 5, (0, 2)), lab.Car(4, 4, 20, 5, (2,))],
    ]
    view = view_of(lab, cars, junction)
    road = EmvRoad.ahead_of(view.ego(0), None)
    way = way_from_emv_m(view, 0, road.lane_start_m)
    assert way[1] == pytest.approx(50.0 + junction.lanes[6].length_m + 20.0 - 4.75 / 2.0 - 6.5 / 2.0, abs=0.05)
    assert np.isinf(way[2:]).all()
    beside = way_from_emv_m(view, 0, road.road_start_m)
    assert beside[2] == pytest.approx(30.0 - 4.75 / 2.0 - 6.5 / 2.0, abs=0.01)
    assert np.isinf(beside[3])
    assert road.on_road[[0, 4]].all()
    assert not road.on_road[2]


def test_road_is_kept_while_lane_and_route_stay(lab):
    view = view_of(lab, [lab.Car(1, 0, 100, 8, (0,), AMBULANCE)])
    road = EmvRoad.ahead_of(view.ego(0), None)
    assert EmvRoad.ahead_of(view.ego(0), road) is road
    assert EmvRoad.ahead_of(view_of(lab, [lab.Car(1, 1, 100, 8, (0,), AMBULANCE)]).ego(0), road) is not road


def test_between_both_distances_the_members_alone_belong_to_the_region(lab):
    """Actors 2, 5 and 7 are 45 m away on every side, 3 and the EMV's fellow 4 are near."""
    cars = [lab.Car(1, 0, 150, 8, (0,), AMBULANCE), lab.Car(4, 1, 140, 8, (0,), AMBULANCE)]
    cars += [lab.Car(actor, 0, place, 2, (0,)) for actor, place in ((2, 195), (3, 180), (5, 105), (7, 195.5))]
    view = view_of(lab, cars)

    def members(*before):
        return region_members(view.seen, 0, np.array(before, dtype=np.uint32), PAPER_CONSTANTS).tolist()

    assert (members(), members(2), members(5, 6)) == ([3], [2, 3], [3, 5])
    assert (members(1, 4, 7, 9), members(6, 8)) == ([3, 7], [3])


def test_the_edge_of_the_emv_and_the_two_before_it_are_still_its_road(lab):
    road = lab.RoadBuilder()
    for place in range(5):
        road.edge([[100.0 * place, 0.0], [100.0 * place + 100.0, 0.0]], 1, (f"N{place}", f"N{place + 1}"))
    for place in range(4):
        road.connect(place, place + 1)
    network = road.built()
    before = None
    for edge in range(5):
        car = lab.Car(1, edge, 10.0, 8, tuple(range(edge, 5)), AMBULANCE)
        before = EmvRoad.ahead_of(view_of(lab, [car], network).ego(0), before)
        assert before.left_edges == tuple(range(edge, max(edge - 3, -1), -1))
        behind = [place for place in range(edge) if before.on_road[place]]
        assert behind == [place for place in (edge - 2, edge - 1) if place >= 0]
