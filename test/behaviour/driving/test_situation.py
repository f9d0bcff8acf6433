"""What all guards share: times in steps, and each vehicle's own steering."""

from dataclasses import replace

import pytest

from siren_ros.world.actors import ActorClass


def test_the_cooldown_is_the_papers_time_in_steps(lab):
    world = lab.world_of(lab.straight_road(), lab.L2)
    longer = replace(world, constants=replace(world.constants, lane_change_cooldown_s=3.0))
    assert longer.cooldown_steps == 60
    assert world.cooldown_steps == round(world.constants.lane_change_cooldown_s / 0.05)


def test_emvs_and_civilians_have_their_own_navigator_with_the_limit_of_their_steering(lab):
    cars = [lab.Car(1, 0, 50, 5, (0,), ActorClass.FIRE_TRUCK), lab.Car(2, 0, 90, 5, (0,), ActorClass.BUS)]
    network = lab.straight_road()
    view = lab.view_of(lab.world_of(network, lab.L2), lab.traffic_of(network, cars))
    config = view.world.config
    for row, kind, base in (
        (0, ActorClass.FIRE_TRUCK, config.emv.navigator),
        (1, ActorClass.BUS, config.civilian_navigator),
    ):
        vehicle = lab.vehicles[kind]
        rate = base.steer_rate_share * vehicle.max_steer_rate_radps / vehicle.wheelbase_m
        assert view.navigator_config(row) == replace(base, curvature_rate_1pms=rate)
        assert view.vehicle(row) == vehicle
    assert view.navigator_config(0).standstill_gap_m == 4.0
    assert view.navigator_config(1).standstill_gap_m == 2.0
    assert view.pose(1) == pytest.approx((90.0, 0.0, 0.0))
    assert view.world.edge_of_lane.tolist() == [0, 0]
