"""An external controller drives one civilian in lockstep."""

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_episodes import EXAMPLES, Domain, Run, digest, finish, recording, wait_until

from siren_ros.generation.replay_check import repeat_episode
from siren_ros.judging.verify import verify_episode
from siren_ros.recording.bag_reader import read_episode
from siren_ros.world.actors import Lights, Mode, Owner
from siren_ros.world.commands import AV_SOURCE

DOMAIN = Domain()
POLICY = str(EXAMPLES / "av_policy.py")
STEPS = 120
DRIVEN = ("av:=civilian", "sensors:=none", "bag:=bag")


def drive(folder: Path, *more: str) -> Run:
    """An episode with the example's policy at the wheel."""
    with (
        DOMAIN.episode(*DRIVEN, f"duration_s:={STEPS / 20}", *more, cwd=folder) as episode,
        DOMAIN.running(POLICY, cwd=folder) as policy,
    ):
        run, driver = finish(episode), finish(policy)
    assert driver.code == 0, driver.err
    return run


@pytest.fixture(scope="module", name="driven")
def _driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Path]:
    folder = tmp_path_factory.mktemp("driven")
    run = drive(folder)
    assert run.code == 0, run.err + run.out
    return run, folder


@pytest.fixture(scope="module", name="record")
def _record(driven: Any) -> Any:
    return read_episode(driven[1] / "bag")


def test_the_record_is_sound(record: Any) -> None:
    assert [str(part) for part in verify_episode(record).checks if not part.holds] == []


def test_the_controller_owns_the_vehicle_from_the_first_step(record: Any) -> None:
    av = record.track(record.description.av_id)
    assert record.actors[record.description.av_id].name == "platoon0"
    assert len(av) == STEPS
    assert np.all(av.owner == Owner.ROS)
    assert np.all(av.mode == Mode.EXTERNAL)
    assert [command.step for command in record.commands[AV_SOURCE]] == list(range(STEPS))
    for command in record.commands["yield_manager"]:
        assert record.description.av_id not in command.actor_id


def test_it_moves_as_it_is_told_one_step_later(record: Any) -> None:
    av = record.track(record.description.av_id)
    shown = [int(lights) & ~Lights.BRAKE for lights in av.lights]
    asked = [int(command.lights[0]) for command in record.commands[AV_SOURCE]]
    assert shown == [0, *asked[:-1]]


def test_the_record_holds_how_it_yielded(record: Any) -> None:
    measures = record.outcome.measures
    assert measures["av.heard_s"] == 0.0
    assert measures["av.speed_drop_mps"] > 2.0
    assert 0.4 < measures["av.moved_right_m"] < 1.0
    assert measures["av.collisions"] == 0
    assert measures["av.passed_after_s"] == -1.0


def test_the_episode_can_be_simulated_again_from_its_record(record: Any) -> None:
    assert repeat_episode(record) is None


def test_the_same_controller_gives_the_same_bytes(driven: Any, tmp_path: Path) -> None:
    assert drive(tmp_path, "processes:=true").code == 0
    assert digest(tmp_path) == digest(driven[1])


def test_a_controller_that_does_not_answer_is_named(tmp_path: Path) -> None:
    with (
        DOMAIN.episode(*DRIVEN, "step_timeout_s:=2.0", "duration_s:=60.0", cwd=tmp_path) as episode,
        DOMAIN.running(POLICY, cwd=tmp_path) as policy,
    ):
        wait_until(recording(tmp_path, 300_000), episode)
        policy.send_signal(signal.SIGSTOP)
        run = finish(episode)
    assert run.code == 1
    assert f": {AV_SOURCE} (node av_policy): did not finish step" in run.out
    assert "within 2 s" in run.out


def test_a_controller_that_leaves_is_named(tmp_path: Path) -> None:
    with (
        DOMAIN.episode(*DRIVEN, "duration_s:=60.0", cwd=tmp_path) as episode,
        DOMAIN.running(POLICY, cwd=tmp_path) as policy,
    ):
        wait_until(recording(tmp_path, 100_000), episode)
        policy.send_signal(signal.SIGINT)
        run = finish(episode)
    assert run.code == 1
    assert f": {AV_SOURCE} (node av_policy): its publisher of /av/control_cmd is gone" in run.out
