"""Shares of attentive drivers."""

from dataclasses import replace

import numpy as np

from siren_ros.traffic.demand.attention import with_attention
from siren_ros.traffic.demand.driver_models import load_drivers
from siren_ros.traffic.demand.plan import PlannedVehicle, Spot, TrafficPlan
from siren_ros.world.actors import ActorClass


def plan(background: int, groups: int = 0) -> TrafficPlan:
    driver = load_drivers().draw(ActorClass.SEDAN, np.random.default_rng(0))
    car = PlannedVehicle("car", ActorClass.SEDAN, 4.6, 1.8, 1.5, (9, 9, 9), driver, ("e",), Spot(0, 10.0, 5.0))
    emv = replace(car, name="emv", is_emv=True)
    return TrafficPlan((emv,), (car,) * groups, (car,) * background, (car,) * 10, (), 20, 0, 40.0)


def attentive(vehicles: tuple[PlannedVehicle, ...]) -> list[bool]:
    return [vehicle.attentive for vehicle in vehicles]


def test_by_default_everybody_is_attentive() -> None:
    assert with_attention(plan(30), 1.0, 0) == plan(30)


def test_the_share_is_met_and_the_emv_is_not_drawn() -> None:
    drawn = with_attention(plan(2000, 5), 0.3, 0)
    assert 0.26 < sum(attentive(drawn.background)) / 2000 < 0.34
    assert attentive(drawn.emvs) == [True]
    assert attentive(with_attention(plan(50, 5), 0.0, 0).groups) == [False] * 5


def test_each_driver_has_a_draw_of_its_own() -> None:
    few, many = with_attention(plan(10, 3), 0.5, 4), with_attention(plan(30, 5), 0.5, 4)
    assert attentive(many.background)[:10] == attentive(few.background)
    assert attentive(many.groups)[:3] == attentive(few.groups)
    assert attentive(with_attention(plan(30), 0.5, 5).background) != attentive(many.background)
