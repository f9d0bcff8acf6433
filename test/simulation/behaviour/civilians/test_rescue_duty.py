"""Civilians who keep a rescue lane open before they hear an EMV."""

from dataclasses import replace

import pytest
from behaviour.lab import L3, Car, RoadBuilder, traffic_of, view_in, world_of

from siren_ros.simulation.behaviour.civilians.yield_lane_change import kept_offset_m, needs_no_siren, rescue_side
from siren_ros.simulation.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.roads.routing import rescue_sides
from siren_ros.simulation.world.actors import ActorClass

WIDTH_M = 3.75
SEDAN_WIDTH_M = 1.83
AT_SIDE_M = 0.5 * (WIDTH_M - SEDAN_WIDTH_M) - 0.2


def road(lanes: int = 3, limit_mps: float = 36.1) -> RoadNetwork:
    network = (
        RoadBuilder().edge([[0.0, 0.0], [300.0, 400.0]], lanes + 1, ("A", "B"), shoulder=True, width=WIDTH_M).built()
    )
    return replace(network, lanes=tuple(replace(lane, speed_limit_mps=limit_mps) for lane in network.lanes))


@pytest.mark.parametrize(
    ("lanes", "limit_mps", "sides"),
    [
        *[(2, 36.1, [0, -1, 1]), (3, 36.1, [0, -1, -1, 1]), (4, 22.2, [0, -1, -1, -1, 1]), (1, 36.1, [0, 0])],
        (3, 13.9, [0, 0, 0, 0]),
    ],
)
def test_the_leftmost_lane_goes_left_and_all_others_right(lanes, limit_mps, sides):
    assert rescue_sides(road(lanes, limit_mps)).tolist() == sides


def test_a_path_over_a_joint_has_the_side_of_its_lane():
    builder = RoadBuilder().edge([[0, 0], [100, 0]], 2, ("A", "J"))
    builder.edge([[100, 0], [104, 0]], 2, ("J", "J"), internal=True).edge([[104, 0], [200, 0]], 2, ("J", "B"))
    network = builder.connect(0, 4, via=(2,)).connect(1, 5, via=(3,)).built()
    fast = replace(network, lanes=tuple(replace(lane, speed_limit_mps=36.1) for lane in network.lanes))
    assert rescue_sides(fast).tolist() == [-1, 1, -1, 1, -1, 1]


def ego_of(left_m: float, speed_mps: float, lane: int = 3, *, duty: bool = True):
    car = Car(2, lane, 100.0, speed_mps, (0,), left=left_m)
    return view_in(world_of(road(), L3, duty=duty), [car]).ego(0)


@pytest.mark.parametrize("speed_mps", [0.0, 2.0, 8.2])
@pytest.mark.parametrize(("lane", "side"), [(1, -1), (2, -1), (3, 1)])
def test_who_keeps_to_the_side_has_made_way_already(lane, side, speed_mps):
    tolerance_m = 0.25
    for off_m, kept in ((0.0, True), (tolerance_m - 0.02, True), (tolerance_m + 0.02, False), (-0.2, True)):
        ego = ego_of(side * (AT_SIDE_M - off_m), speed_mps, lane)
        assert needs_no_siren(ego) is kept
        assert rescue_side(ego, lane) == side
        assert kept_offset_m(ego, lane) == pytest.approx(side * AT_SIDE_M)
    assert not needs_no_siren(ego_of(-side * AT_SIDE_M, speed_mps, lane)), "on the other side"


def test_flowing_traffic_does_not_stop_and_keeps_to_the_middle():
    ego = ego_of(0.0, 8.4)
    assert needs_no_siren(ego)
    assert kept_offset_m(ego, 3) == 0.0


def test_without_the_duty_everybody_waits_for_the_siren():
    ego = ego_of(AT_SIDE_M, 1.0, duty=False)
    assert not needs_no_siren(ego)
    assert (rescue_side(ego, 3), kept_offset_m(ego, 3)) == (0, 0.0)


def test_the_siren_asks_those_alone_who_are_in_the_way():
    world = world_of(road(), L3, duty=True)
    emv = Car(1, 3, 60.0, 8.0, (0,), ActorClass.AMBULANCE)
    cars = [emv, Car(2, 3, 85.0, 1.0, (0,), left=AT_SIDE_M), Car(3, 2, 85.0, 1.0, (0,), left=0.0)]
    state, commands = step_yield(YieldState(), traffic_of(world.network, cars), world)
    assert set(state.units) == {3}
    assert {event.actor_id for event in commands.events} == {3}
    without = world_of(road(), L3)
    state, _ = step_yield(YieldState(), traffic_of(without.network, cars), without)
    assert set(state.units) == {2, 3}
