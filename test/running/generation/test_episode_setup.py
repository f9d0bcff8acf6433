"""What an episode's setup makes of the map."""

from dataclasses import replace

import pytest

from siren_ros.errors import InputError
from siren_ros.running.generation.behaviour_setup import behaviour_world
from siren_ros.running.generation.episode_setup import plan_length, set_up_episode
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.scenario.driver_parameters import DriverParameters
from siren_ros.simulation.scenario.episode import EpisodeRequest, values_of


def test_nobody_drives_on_shoulders_where_the_template_says_that_they_are_in_use() -> None:
    for name, free in (("S2", False), ("S7", True)):
        network = set_up_episode(EpisodeRequest(name, "", 0, sensors="none")).network
        assert any(lane.kind is LaneKind.SHOULDER and lane.emergency_allowed for lane in network.lanes) is free


def test_an_episode_lasts_until_the_last_emv_has_had_as_long_as_the_first() -> None:
    alone = plan_length(EpisodeRequest("S2", sensors="none"))
    several = EpisodeRequest("S2", sensors="none", values="emv.count=3,emv.headway_s=4")
    assert plan_length(several) == alone + 2 * 80
    assert plan_length(replace(several, duration_s=5.0)) == 100


def test_parameters_of_drivers_reach_the_controllers_and_the_record() -> None:
    usual = set_up_episode(EpisodeRequest("S2", sensors="none"))
    values = "emv_driver.corridor.speed_mps=6.0,civilian_driver.driving.headway_s=1.4,sumo.tau_s=2.0"
    setup = set_up_episode(EpisodeRequest("S2", sensors="none", values=values))
    assert setup.description.template_values == {**usual.description.template_values, **values_of(values)}
    world = behaviour_world(setup.description, setup.compiled_map.read_bytes())
    assert world.speeds.emv_copy_sumo_mps == 6.0
    assert world.config == DriverParameters().with_values(values_of(values))
    before, after = usual.plan.emvs[0].driver, setup.plan.emvs[0].driver
    assert after == replace(before, tau_s=2.0) != before
    assert replace(setup.plan, emvs=()) == replace(usual.plan, emvs=())
    with pytest.raises(InputError, match="tight_gap_m"):
        set_up_episode(EpisodeRequest("S2", sensors="none", values="emv_driver.corridor.tight_gap_m=0.9"))
