"""What happens to an episode when something breaks: named within seconds, nothing lost, nothing left behind."""

import os
import pty
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from faulty_episodes import ANSWER_S, Episode, mounted, next_episode_starts
from live_episodes import Domain, cosim, recording, wait_until, without_waiting

from siren_ros.recording.bag_reader import read_episode
from siren_ros.recording.recover import recover_bag

DOMAIN = Domain()
NODES = ("sumo_bridge", "sensor_sim", "recorder")
"""A node that others wait for at each step, one that trails the step, and the one that writes the bag.

SUMO runs within ``sumo_bridge``: to kill that process is to kill SUMO.
"""


@pytest.fixture
def episodes() -> Iterator[list[Episode]]:
    """Episodes of the test; all their processes are gone afterwards."""
    started: list[Episode] = []
    yield started
    for episode in started:
        episode.kill_all()


def start(episodes: list[Episode], folder: Path, *parameters: str, **options: object) -> Episode:
    episodes.append(Episode(DOMAIN, folder, *parameters, **options))  # type: ignore[arg-type] # forwarded
    return episodes[-1]


def error_of(episode: Episode) -> str:
    """The line on stderr that ``cosim`` ends with; nothing of Python's is beside it."""
    assert episode.process.returncode not in {0, None}
    assert "Traceback" not in episode.err
    lines = [line for line in without_waiting(episode.err.splitlines()) if line.startswith("cosim: ")]
    assert len(lines) == 1, episode.err
    return lines[0]


@pytest.mark.parametrize("node", NODES)
def test_a_killed_node_ends_the_episode_by_name(node: str, episodes: list[Episode], tmp_path: Path) -> None:
    episode = start(episodes, tmp_path, "processes:=true")
    episode.wait_until_recorded()
    episode.fault(lambda: os.kill(episode.process_of(node), signal.SIGKILL))
    episode.wait_until_gone()
    assert error_of(episode) == f"cosim: {node}: its process ended early (killed by SIGKILL)"
    if node == "recorder":
        assert "siren recover" in episode.out
        assert recover_bag(episode.working).steps >= 20
        next_episode_starts(episode)
    assert read_episode(tmp_path / "bags" / "bag.partial").steps >= 20


@pytest.mark.parametrize("processes", ["false", "true"])
def test_a_second_ctrl_c_at_once_changes_nothing(processes: str, episodes: list[Episode], tmp_path: Path) -> None:
    episode = start(episodes, tmp_path, f"processes:={processes}")
    episode.wait_until_recorded()
    episode.fault(lambda: [(episode.process.send_signal(signal.SIGINT), time.sleep(0.1)) for _ in range(3)])
    episode.wait_until_gone()
    assert error_of(episode) == "cosim: stopped by SIGINT"
    assert read_episode(tmp_path / "bags" / "bag.partial").steps >= 20
    assert not episode.working.exists()


def test_who_waits_is_told_for_what_and_may_stop_before_the_first_step(episodes: list[Episode], tmp_path: Path) -> None:
    episode = start(episodes, tmp_path, "av:=civilian")
    episode.wait_until_told("cosim: waiting for av_controller to publish /av/control_cmd, at most 120 s (")
    episode.fault(lambda: episode.process.send_signal(signal.SIGINT))
    episode.wait_until_gone()
    assert episode.process.returncode == 1
    assert error_of(episode) == "cosim: stopped by SIGINT"
    assert "episode interrupted after 0.00 s (0 steps): stopped by SIGINT" in episode.out
    assert episode.out.splitlines()[-1] == "exit code 1: the episode was interrupted"
    assert list(episode.folder.rglob("*bag*")) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_before_anything_is_loaded(number: signal.Signals, episodes: list[Episode], tmp_path: Path) -> None:
    episode = start(episodes, tmp_path)
    episode.wait_until_it_catches(signal.SIGTERM)
    episode.process.send_signal(number)
    assert episode.process.wait(90.0) == 1
    assert error_of(episode) == f"cosim: stopped by {number.name}"
    assert episode.out.splitlines()[-1] == "exit code 1: the episode was interrupted"
    assert list(episode.folder.rglob("*bag*")) == []


def test_a_closed_terminal_ends_the_episode_in_order(tmp_path: Path) -> None:
    terminal, inside = pty.openpty()
    words = cosim(("sensors:=none", "duration_s:=40.0", "bag:=bag", "realtime_factor:=1.0"))
    process = subprocess.Popen(
        [sys.executable, *words], env=DOMAIN.environment, cwd=tmp_path, stdout=inside, stderr=inside
    )
    try:
        os.close(inside)
        wait_until(recording(tmp_path, 150_000), process)
        os.close(terminal)
        process.send_signal(signal.SIGHUP)
        assert process.wait(timeout=ANSWER_S + 30.0) == 1
    finally:
        process.kill()
        process.wait()
    metadata = (tmp_path / "bag.partial" / "metadata.yaml").read_text(encoding="utf-8")
    assert "stopped by SIGHUP" in metadata
    assert read_episode(tmp_path / "bag.partial").steps >= 20
    assert not list(tmp_path.glob(".bag*"))


def test_a_killed_episode_leaves_its_record_and_nothing_else(episodes: list[Episode], tmp_path: Path) -> None:
    episode = start(episodes, tmp_path)
    episode.wait_until_recorded()
    episode.fault(episode.process.kill)
    episode.wait_until_gone()
    assert recover_bag(episode.bag).steps >= 20
    assert not episode.working.exists()
    assert read_episode(tmp_path / "bags" / "bag.partial").steps >= 20
    next_episode_starts(episode)


def test_a_node_that_is_stopped_does_not_outlive_a_killed_episode(episodes: list[Episode], tmp_path: Path) -> None:
    episode = start(episodes, tmp_path, "processes:=true")
    episode.wait_until_recorded()
    os.kill(episode.process_of("vehicle_dynamics"), signal.SIGSTOP)
    episode.fault(episode.process.kill)
    episode.wait_until_gone()
    for node in ("recorder", "vehicle_dynamics"):
        assert f"{node}: stopped by the end of the program that started it" in episode.err
    assert not episode.working.exists()
    assert read_episode(tmp_path / "bags" / "bag.partial").steps >= 20
    next_episode_starts(episode)


def test_a_node_that_hangs_is_named(episodes: list[Episode], tmp_path: Path) -> None:
    """The one that writes the bag; that others are named which the step waits for, an AV that does not answer shows."""
    episode = start(episodes, tmp_path, "processes:=true", "step_timeout_s:=3.0")
    episode.wait_until_recorded()
    episode.fault(lambda: os.kill(episode.process_of("recorder"), signal.SIGSTOP))
    episode.wait_until_gone(3.0 + ANSWER_S)
    assert error_of(episode).startswith("cosim: recorder: did not finish step ")
    assert error_of(episode).endswith(" within 3 s")
    recover_bag(episode.working)
    assert read_episode(tmp_path / "bags" / "bag.partial").steps >= 20


HANGING_CONTROLLER = """
import time
from siren_nodes.emv_controller import EmvController
act = EmvController.on_step
EmvController.on_step = lambda node, step, inputs: time.sleep(1000) if step == 50 else act(node, step, inputs)
"""


def test_a_node_that_hangs_in_the_one_process_is_named(episodes: list[Episode], tmp_path: Path) -> None:
    episode = start(episodes, tmp_path, "step_timeout_s:=3.0", prelude=HANGING_CONTROLLER)
    episode.wait_until_recorded()
    episode.fault(lambda: None)
    episode.wait_until_gone(50 * 0.025 + 3.0 + ANSWER_S)
    assert error_of(episode).startswith("cosim: emv_controller: did not finish step 50 within 3 s; ")
    assert episode.out.splitlines()[-1] == "exit code 1: the episode failed"
    assert recover_bag(episode.bag).steps >= 20


def test_a_full_disk_is_named_and_the_bag_on_it_is_readable(episodes: list[Episode], tmp_path: Path) -> None:
    disk = tmp_path / "bags"
    disk.mkdir()
    if not mounted(disk, "4m"):
        pytest.skip("a small disk needs the right to mount one; the limit on the size of files stands in for it")
    try:
        episode = start(episodes, tmp_path, "realtime_factor:=0.0", sensors="lidar")
        episode.wait_until_recorded()
        episode.fault(lambda: None)
        episode.wait_until_gone(20.0)
        assert "the disk is full" in error_of(episode)
        assert read_episode(disk / "bag.partial").steps >= 2
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_file_that_may_not_grow_is_named(episodes: list[Episode], tmp_path: Path) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4_000_000, 4_000_000))

    episode = start(episodes, tmp_path, "realtime_factor:=0.0", sensors="lidar", preexec_fn=limit)
    episode.wait_until_recorded()
    episode.fault(lambda: None)
    episode.wait_until_gone(20.0)
    assert "recorder: the bag bags/bag cannot be written: the limit on the size of files" in error_of(episode)
    assert read_episode(tmp_path / "bags" / "bag.partial").steps >= 2


def test_a_bag_that_is_taken_away_is_named_and_saved(episodes: list[Episode], tmp_path: Path) -> None:
    episode = start(episodes, tmp_path)
    episode.wait_until_recorded()
    episode.fault(lambda: shutil.rmtree((tmp_path / "bags").rename(tmp_path / "taken")))
    episode.wait_until_gone()
    assert "its folder has disappeared" in error_of(episode)
    assert read_episode(tmp_path / "bags" / "bag.partial").steps >= 20


STRANGER = """
import sys, time
import rclpy
from siren_ros.interfaces import topics
from siren_ros.interfaces.conversions import to_actor_states
from siren_ros.interfaces.episode_conversions import from_episode_description, to_episode_description, to_step_done
from siren_ros.interfaces.episode_conversions import Phase, StepReport
from siren_ros.interfaces.messages import make_message, stamp
from siren_ros.ros.transport import wire
from siren_ros.ros.transport.endpoints import create_input, create_output
from siren_ros.scenario.paper import EmergencyLevel
from siren_ros.world.actors import ActorStates
def report(name, step):
    return wire.encode(topics.STEP_DONE, to_step_done(StepReport(step, name, Phase.STEP)))
def actors(step):
    return wire.encode(topics.ACTORS, to_actor_states(ActorStates.empty(step)))
def episode(**changed):
    from dataclasses import replace
    heard = []
    create_input(node, topics.EPISODE, heard.append)
    while not heard:
        rclpy.spin_once(node, timeout_sec=0.1)
    return wire.encode(topics.EPISODE, to_episode_description(
        replace(from_episode_description(wire.decode(topics.EPISODE, heard[0])), **changed)))
rclpy.init()
node = rclpy.create_node("stranger")
topic, payloads = eval(sys.argv[1])
publisher = create_output(node, topic)
while not publisher.get_subscription_count():
    time.sleep(0.001)
for payload in payloads:
    publisher.publish(payload)
publisher.wait_for_all_acked()
time.sleep(1.0)
"""
"""A program that nobody asked for; what it publishes is the test's own text."""


def attacked(episodes: list[Episode], folder: Path, attack: str, *parameters: str) -> Episode:
    """An episode to which a stranger has come, at its end."""
    episode = start(episodes, folder, *parameters)
    episode.wait_until_recorded()
    with DOMAIN.running("-c", STRANGER, attack, cwd=folder) as stranger:
        stranger.wait(60.0)
        episode.fault(lambda: None)
        episode.wait_until_gone()
    assert not episode.bag.exists(), "a bag under its own name is complete"
    assert read_episode(folder / "bags" / "bag.partial").steps >= 20
    return episode


@pytest.mark.parametrize("processes", ["false", "true"])
@pytest.mark.parametrize(
    ("attack", "topic"),
    [
        (
            "topics.STEP_DONE, [report(name, step) for step in range(12000) for name in ('sensor_sim', 'recorder')]",
            "step_done",
        ),
        ("topics.EPISODE, [episode(level=EmergencyLevel.L0, seed=4242)]", "episode"),
        ("topics.ACTORS, [actors(0), actors(1)]", "actor_states"),
        ("topics.STEP_DONE, [report('nobody', 0)] * 100_000", "step_done"),
    ],
    ids=["forged", "doubled", "stale", "flooded"],
)
def test_a_stranger_ends_the_episode_and_is_named(
    attack: str, topic: str, processes: str, episodes: list[Episode], tmp_path: Path
) -> None:
    episode = attacked(episodes, tmp_path, attack, f"processes:={processes}")
    error = error_of(episode)
    assert f"/siren/{topic}: " in error
    assert "that this episode does not know (node stranger)" in error


@pytest.mark.parametrize(
    ("attack", "named"),
    [
        (
            "topics.GROUND_TRUTH, [b'\\0\\1\\0\\0' + b'\\xff' * 9]",
            "recorder: /emv/ground_truth: the stamp -1 s and 4294967295 ns",
        ),
        ("topics.TF, [wire.encode(topics.TF, make_message(topics.TF.type_name, transforms=[]))]", "/tf"),
    ],
)
def test_a_strangers_measurement_ends_the_episode_and_names_the_topic(
    attack: str, named: str, episodes: list[Episode], tmp_path: Path
) -> None:
    assert named in error_of(attacked(episodes, tmp_path, attack))
