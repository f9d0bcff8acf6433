"""One recorded episode, end to end, on the real parts; without ROS it has the same bytes."""

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_episodes import Domain, digest, finish, wait_until
from rosbags.highlevel import AnyReader

from siren_ros.cli.main import main
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.measurements import from_point_cloud
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.sensor_messages.sensor_topics import recorded_topics
from siren_ros.running.generation.closed_loop import record_episode
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.sensing.suite import load_suite
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeRequest

SHORT = ("template:=S2", "duration_s:=2.0")
STEPS = 40


def message_counts(bag: Path) -> dict[str, int]:
    with AnyReader([bag]) as reader:
        return {connection.topic: connection.msgcount for connection in reader.connections}


@pytest.fixture(scope="module")
def episode(cosim: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A short episode with everything that the default run has."""
    folder = tmp_path_factory.mktemp("default")
    run = cosim(*SHORT, cwd=folder)
    assert run.code == 0, run.err
    return run, folder


def test_the_summary_tells_what_was_made(episode: Any) -> None:
    run, _ = episode
    for part in (
        "episode complete after 2.00 s (40 steps)",
        "bag: bags/S2_L2_seed0",
        "real-time factor",
        "interaction:",
    ):
        assert part in run.out
    for node in ("sumo_bridge", "emv_controller", "yield_manager", "vehicle_dynamics", "sensor_sim", "recorder"):
        assert node in run.out
    assert run.error_lines == []


def test_the_bag_holds_every_message_of_every_topic(episode: Any) -> None:
    bag = episode[1] / "bags" / "S2_L2_seed0"
    expected = {
        topic.name: 1 if topic.latched else -(-STEPS // topic.period_steps)
        for topic in (*recorded_topics(load_suite("front")), topics.EPISODE_END)
    }
    assert message_counts(bag) == expected


def test_the_sweeps_see_the_labelled_vehicles(episode: Any) -> None:
    bag = episode[1] / "bags" / "S2_L2_seed0"
    with AnyReader([bag]) as reader:
        names = {topics.GROUND_TRUTH.name, "/emv/lidar/points"}
        messages: dict[str, dict[int, Any]] = {name: {} for name in names}
        connections = [connection for connection in reader.connections if connection.topic in names]
        for connection, time_ns, raw in reader.messages(connections=connections):
            messages[connection.topic][time_ns] = reader.deserialize(raw, connection.msgtype)
    hits = 0
    for time_ns, truth in messages[topics.GROUND_TRUTH.name].items():
        points = from_point_cloud(messages["/emv/lidar/points"][time_ns])
        counted = np.bincount(points["instance"].astype(int), minlength=int(max(truth.actor_id, default=0)) + 1)
        assert np.array_equal(counted[truth.actor_id], truth.lidar_points)
        hits += int(np.sum(truth.lidar_points))
    assert hits > 1000


def test_live_and_offline_kitti_are_the_same(episode: Any, tmp_path: Path) -> None:
    bags = episode[1] / "bags"
    assert main(["export", "kitti", str(bags / "S2_L2_seed0"), "--out", str(tmp_path / "kitti")]) == 0
    live = digest(bags / "S2_L2_seed0_kitti" / "training")
    assert digest(tmp_path / "kitti" / "training") == live
    assert len(live) == 5 * STEPS // 2


def test_the_same_bytes_come_from_a_process_for_each_node_and_without_ros(
    episode: Any, cosim: Callable[..., Any], tmp_path: Path
) -> None:
    run = cosim(*SHORT, "processes:=true", cwd=tmp_path)
    assert run.code == 0, run.err
    assert digest(tmp_path / "bags") == digest(episode[1] / "bags")
    record_episode(set_up_episode(EpisodeRequest("S2", duration_s=2.0, sensors="front")), tmp_path / "S2_L2_seed0")
    assert digest(tmp_path / "S2_L2_seed0") == digest(episode[1] / "bags" / "S2_L2_seed0")


@pytest.mark.parametrize("sealed", [False, True])
def test_without_ros_an_episode_that_differs_in_all_from_the_default_has_the_same_bytes(
    sealed: bool, tmp_path: Path
) -> None:
    """Of a sealed one, its topic does not tell the nodes what it is."""
    salt = tmp_path / "salt"
    salt.write_text("5a" * 16)
    request = EpisodeRequest(
        *("S1", "L1", 3),
        duration_s=3.0,
        sensors="none" if sealed else "lidar",
        look="night",
        preset="realistic",
        values="emv.speed_mps=14.5",
        salt=str(salt) if sealed else "",
    )
    # An empty text is no value on ROS's command line, and is the default of these parameters.
    asked = [f"{name}:={value}" for name, value in request.to_json().items() if value != ""]
    more = [f"salt:={salt}"] if sealed else []
    run = Domain().run(*asked, *more, f"bag:={tmp_path / 'nodes' / 'bag'}", "kitti:=false")
    assert run.code == 0, run.err
    record_episode(set_up_episode(request), tmp_path / "library" / "bag")
    assert digest(tmp_path / "nodes") == digest(tmp_path / "library")
    description = read_episode(tmp_path / "nodes" / "bag").description
    assert description.template == ("sealed" if sealed else "S1")


def test_a_bag_that_exists_is_not_touched(episode: Any, cosim: Callable[..., Any]) -> None:
    before = digest(episode[1])
    run = cosim(*SHORT, cwd=episode[1])
    assert run.code == 2
    assert run.error_lines == [
        (
            "bag: 'bags/S2_L2_seed0' cannot be used; allowed: the path of a new folder; "
            "overwrite (overwrite:=true, --overwrite) replaces this episode, "
            "and `siren replay bags/S2_L2_seed0 --check` makes it again and compares"
        )
    ]
    assert digest(episode[1]) == before


REFUSING = Domain()


@pytest.mark.parametrize(
    ("parameter", "named", "allowed"),
    [
        ("template:=S99", "template: 'S99'", "S2"),
        ("duration_s:=-3.0", "duration_s: -3.0", "a number from 0 to 3600"),
        ("processes:=maybe", "processes: 'maybe'", "true or false"),
        ("map:=notes.xodr", "map: ", ""),
        ("bag:=/proc/nowhere/bag", "bag: '/proc/nowhere/bag'", "a place that can be written"),
        ("external:=[recorder]", "external: 'recorder' cannot be used", ""),
        ("external:=[a, a]", "external: 'a' cannot be used", ""),
        ("external:=['no name']", "external: 'no name' cannot be used", ""),
        ("tempalte:=S2", "tempalte: 'S2'", "one of the parameters"),
    ],
)
def test_bad_input_gets_one_line_that_names_it(parameter: str, named: str, allowed: str, tmp_path: Path) -> None:
    (tmp_path / "notes.xodr").write_text("no map", encoding="utf-8")
    run = REFUSING.run(parameter, cwd=tmp_path)
    assert run.code == 2
    (line,) = run.error_lines
    assert line.startswith(named)
    assert allowed in line
    assert [path.name for path in tmp_path.iterdir()] == ["notes.xodr"]


def test_an_interrupted_episode_leaves_a_readable_partial_bag_and_no_export(tmp_path: Path) -> None:
    bags = tmp_path / "bags"

    def recording() -> bool:
        sweeps = list(bags.rglob("velodyne/*.bin"))
        return bool(sweeps) and any(file.stat().st_size > 1_000_000 for file in bags.rglob("*.mcap"))

    with Domain().episode("sensors:=lidar", "kitti_layout:=paper", cwd=tmp_path) as process:
        wait_until(recording, process)
        process.send_signal(signal.SIGTERM)
        run = finish(process)
    assert run.code == 1
    assert "stopped by SIGTERM" in run.out
    assert run.out.splitlines()[-1] == "exit code 1: the episode was interrupted"
    assert sorted(path.name for path in bags.iterdir()) == ["S2_L2_seed0.partial"]
    record = read_episode(bags / "S2_L2_seed0.partial")
    assert not record.complete
    assert record.outcome is not None
    assert record.outcome.end is EpisodeEnd.INTERRUPTED
    assert record.steps > 1
