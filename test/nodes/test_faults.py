"""What happens to an episode when something breaks: named within seconds, nothing lost, nothing left behind."""

import os
import pty
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from faulty_episodes import Start, mounted, next_episode_starts
from live_episodes import Domain, cosim, recording, wait_until

from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.recover import recover_bag

DOMAIN = Domain()


@pytest.mark.parametrize("node", ["sumo_bridge", "recorder"])
def test_a_killed_node_ends_the_episode_by_name(node: str, start: Start) -> None:
    """The one in which SUMO runs, which others wait for at each step, and the one that writes the bag."""
    episode = start("processes:=true")
    episode.wait_until_recorded()
    os.kill(episode.process_of(node), signal.SIGKILL)
    episode.wait_until_gone()
    assert episode.error == f"cosim: {node}: its process ended early (killed by SIGKILL)"
    if node == "recorder":
        assert "siren recover" in episode.out
        assert recover_bag(episode.working).steps >= 20
        next_episode_starts(episode)
    assert episode.saved_steps >= 20


def test_a_second_ctrl_c_at_once_changes_nothing(start: Start) -> None:
    episode = start("processes:=true")
    episode.wait_until_recorded()
    for _ in range(3):
        episode.process.send_signal(signal.SIGINT)
        time.sleep(0.1)
    episode.wait_until_gone()
    assert episode.error == "cosim: stopped by SIGINT"
    assert episode.saved_steps >= 20
    assert not episode.working.exists()


def test_who_waits_is_told_for_what_and_may_stop_before_the_first_step(start: Start) -> None:
    episode = start("av:=civilian")
    episode.wait_until_told("cosim: waiting for av_controller to publish /av/control_cmd, at most 120 s (")
    episode.process.send_signal(signal.SIGINT)
    episode.wait_until_gone()
    assert episode.process.returncode == 1
    assert episode.error == "cosim: stopped by SIGINT"
    assert "episode interrupted after 0.00 s (0 steps): stopped by SIGINT" in episode.out
    assert episode.out.splitlines()[-1] == "exit code 1: the episode was interrupted"
    assert list(episode.folder.rglob("*bag*")) == []


def test_a_signal_before_anything_is_loaded(start: Start) -> None:
    episode = start(programs=subprocess.Popen)
    episode.wait_until_it_catches(signal.SIGTERM)
    episode.process.send_signal(signal.SIGTERM)
    assert episode.process.wait(90.0) == 1
    assert episode.error == "cosim: stopped by SIGTERM"
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
        assert process.wait(timeout=60.0) == 1
    finally:
        process.kill()
        process.wait()
    metadata = (tmp_path / "bag.partial" / "metadata.yaml").read_text(encoding="utf-8")
    assert "stopped by SIGHUP" in metadata
    assert read_episode(tmp_path / "bag.partial").steps >= 20
    assert not list(tmp_path.glob(".bag*"))


def test_a_killed_episode_leaves_its_record_and_nothing_else(start: Start) -> None:
    episode = start()
    episode.wait_until_recorded()
    episode.process.kill()
    episode.wait_until_gone()
    assert recover_bag(episode.bag).steps >= 20
    assert not episode.working.exists()
    assert episode.saved_steps >= 20
    next_episode_starts(episode)


def test_a_node_that_is_stopped_does_not_outlive_a_killed_episode(start: Start) -> None:
    episode = start("processes:=true")
    episode.wait_until_recorded()
    os.kill(episode.process_of("vehicle_dynamics"), signal.SIGSTOP)
    episode.process.kill()
    episode.wait_until_gone()
    for node in ("recorder", "vehicle_dynamics"):
        assert f"{node}: stopped by the end of the program that started it" in episode.err
    assert not episode.working.exists()
    assert episode.saved_steps >= 20


def test_a_node_that_hangs_is_named(start: Start) -> None:
    """The one that writes the bag; that others are named which the step waits for, an AV that does not answer shows."""
    episode = start("processes:=true", "step_timeout_s:=8.0")
    episode.wait_until_recorded()
    os.kill(episode.process_of("recorder"), signal.SIGSTOP)
    episode.wait_until_gone()
    assert episode.error.startswith("cosim: recorder: did not finish step ")
    assert episode.error.endswith(" within 8 s")
    recover_bag(episode.working)
    assert episode.saved_steps >= 20


HANGING_CONTROLLER = """
import time
from siren_nodes.emv_controller import EmvController
act = EmvController.on_step
EmvController.on_step = lambda node, step, inputs: time.sleep(1000) if step == 50 else act(node, step, inputs)
"""


def test_a_node_that_hangs_in_the_one_process_is_named(start: Start) -> None:
    episode = start("step_timeout_s:=8.0", prelude=HANGING_CONTROLLER)
    episode.wait_until_recorded()
    episode.wait_until_gone()
    assert episode.error.startswith("cosim: emv_controller: did not finish step 50 within 8 s; ")
    assert episode.out.splitlines()[-1] == "exit code 1: the episode failed"
    assert recover_bag(episode.bag).steps >= 20


def test_a_full_disk_is_named_and_the_bag_on_it_is_readable(start: Start, tmp_path: Path) -> None:
    disk = tmp_path / "bags"
    disk.mkdir()
    if not mounted(disk, "4m"):
        pytest.skip("a small disk needs the right to mount one")
    try:
        episode = start("realtime_factor:=0.0", sensors="lidar")
        episode.wait_until_recorded()
        episode.wait_until_gone()
        assert "the disk is full" in episode.error
        assert episode.saved_steps >= 2
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_bag_that_is_taken_away_is_named_and_saved(start: Start, tmp_path: Path) -> None:
    episode = start()
    episode.wait_until_recorded()
    shutil.rmtree((tmp_path / "bags").rename(tmp_path / "taken"))
    episode.wait_until_gone()
    assert "its folder has disappeared" in episode.error
    assert episode.saved_steps >= 20
