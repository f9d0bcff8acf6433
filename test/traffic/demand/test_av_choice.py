from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from traffic_helpers import load_map, plan_s2

from siren_ros.errors import InputError
from siren_ros.generation.episode_setup import set_up_episode
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.traffic.demand.av_choice import av_way, choose_av


@pytest.fixture(scope="module", name="town")
def _town() -> Any:
    network = load_map(None)[1]
    return network, plan_s2(network)[0]


def test_the_first_vehicle_of_the_platoon_is_chosen(town: Any) -> None:
    network, plan = town
    assert choose_av(network, plan) == "platoon0"
    assert choose_av(network, replace(plan, groups=plan.groups[::-1])) == "platoon0"


def test_without_a_platoon_it_is_the_nearest_ahead_on_the_way(town: Any) -> None:
    network, plan = town
    others = tuple(vehicle for vehicle in plan.groups if not vehicle.name.startswith("platoon"))
    chosen = next(vehicle for vehicle in others if vehicle.name == choose_av(network, replace(plan, groups=others)))
    emv = plan.emvs[0]
    ahead = [one.spot.front_m for one in others if one.route[0] == emv.route[0] and one.spot.front_m > emv.spot.front_m]
    assert chosen.spot.front_m == min(ahead)


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


def test_without_a_wish_there_is_no_av() -> None:
    setup = set_up_episode(EpisodeRequest("S2", sensors="none"))
    assert (setup.plan.av, setup.description.av_id, setup.description.av_sensor_suite) == ("", 0, "")
