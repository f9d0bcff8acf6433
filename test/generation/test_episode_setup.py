"""What an episode's setup makes of the map."""

from siren_ros.generation.episode_setup import set_up_episode
from siren_ros.roads.road_network import LaneKind
from siren_ros.scenario.episode import EpisodeRequest


def test_nobody_drives_on_shoulders_where_the_template_says_that_they_are_in_use() -> None:
    for name, free in (("S2", False), ("S7", True)):
        network = set_up_episode(EpisodeRequest(name, "", 0, sensors="none")).network
        assert any(lane.kind is LaneKind.SHOULDER and lane.emergency_allowed for lane in network.lanes) is free
