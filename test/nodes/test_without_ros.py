"""The node graph and the library without ROS make the same episode: the same bytes, whatever is measured."""

from pathlib import Path

import pytest
from live_episodes import Domain, digest

from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.generation.recorded_episode import record_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest

DOMAIN = Domain()


@pytest.mark.parametrize(
    "request_",
    [
        EpisodeRequest("S2", duration_s=4.0, sensors="none"),
        EpisodeRequest("S1", "L1", seed=3, duration_s=2.0, sensors="front", look="night"),
        EpisodeRequest("S6", seed=1, duration_s=2.0, sensors="none", preset="realistic", values="emv.speed_mps=14.5"),
    ],
    ids=lambda request: request.template,
)
def test_both_ways_write_the_same_bytes(request_: EpisodeRequest, tmp_path: Path) -> None:
    by_nodes, without_ros = tmp_path / "nodes" / "bag", tmp_path / "library" / "bag"
    # An empty text is no value on ROS's command line, and is the default of these parameters.
    asked = [f"{name}:={value}" for name, value in request_.to_json().items() if value != ""]
    run = DOMAIN.run(*asked, f"bag:={by_nodes}", "kitti:=false")
    assert run.code == 0, run.err
    recorded = record_episode(set_up_episode(request_), without_ros)
    assert recorded.bag is not None
    assert recorded.bag.path == without_ros
    assert digest(by_nodes) == digest(without_ros)
