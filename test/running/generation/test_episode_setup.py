"""What an episode's setup makes of the map."""

from dataclasses import replace

from siren_ros.running.generation.episode_setup import plan_length, set_up_episode
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.scenario.episode import EpisodeRequest


def test_nobody_drives_on_shoulders_where_the_template_says_that_they_are_in_use() -> None:
    for name, free in (("S2", False), ("S7", True)):
        network = set_up_episode(EpisodeRequest(name, "", 0, sensors="none")).network
        assert any(lane.kind is LaneKind.SHOULDER and lane.emergency_allowed for lane in network.lanes) is free


def test_an_episode_lasts_until_the_last_emv_has_had_as_long_as_the_first() -> None:
    alone = plan_length(EpisodeRequest("S2", sensors="none"))
    several = EpisodeRequest("S2", sensors="none", values="emv.count=3,emv.headway_s=4")
    assert plan_length(several) == alone + 2 * 80
    assert plan_length(replace(several, duration_s=5.0)) == 100
