"""An external controller drives one civilian in lockstep."""

import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_episodes import EXAMPLES, Domain, Run, digest, finish, recording, wait_until

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.conversions import from_av_control
from siren_ros.data.recording.bag_reader import open_bag, read_episode
from siren_ros.errors import EpisodeError
from siren_ros.running.generation.closed_loop import record_episode
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.generation.replay_check import repeat_episode
from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.seated import answers_of
from siren_ros.running.studies.av_program import episode_with_program
from siren_ros.scoring.judging.verify import verify_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.actors import Lights, Mode, Owner
from siren_ros.simulation.world.commands import AV_SOURCE

DOMAIN = Domain()
POLICY = str(EXAMPLES / "av_policy.py")
STEPS = 120
PATIENCE_S = 60.0
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


def test_the_controller_owns_the_vehicle_from_the_first_step_in_a_sound_record(record: Any) -> None:
    assert [str(part) for part in verify_episode(record).checks if not part.holds] == []
    assert repeat_episode(record) is None
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


def test_the_same_controller_gives_the_same_bytes(driven: Any, tmp_path: Path) -> None:
    assert drive(tmp_path, "processes:=true").code == 0
    assert digest(tmp_path) == digest(driven[1])


def test_a_controller_that_does_not_answer_is_named(tmp_path: Path) -> None:
    with (
        DOMAIN.episode(*DRIVEN, "step_timeout_s:=8.0", "duration_s:=60.0", cwd=tmp_path) as episode,
        DOMAIN.running(POLICY, cwd=tmp_path) as policy,
    ):
        wait_until(recording(tmp_path, 300_000), episode)
        policy.send_signal(signal.SIGSTOP)
        run = finish(episode)
    assert run.code == 1
    assert f": {AV_SOURCE} (node av_policy): did not finish step" in run.out
    assert "within 8 s" in run.out


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


REQUEST = EpisodeRequest(av="civilian", sensors="none", duration_s=STEPS / 20)
STACK = f"{sys.executable} {EXAMPLES / 'lawful_stack.py'}"


def test_the_answers_of_a_live_episode_give_the_same_bytes_without_ros(driven: Any, tmp_path: Path) -> None:
    with open_bag(driven[1] / "bag") as bag:
        answers = [from_av_control(message.read()) for message in bag.messages([topics.AV_CONTROL.name])]
    assert [answer.step for answer in answers] == list(range(STEPS))
    setup = set_up_episode(REQUEST)
    record_episode(setup, tmp_path / "bag", lambda step: {setup.description.av_id: answers[step.states.step]})
    assert digest(tmp_path) == digest(driven[1])


def test_a_stack_in_ros_and_its_driver_without_ros_give_the_same_bytes(tmp_path: Path) -> None:
    made = episode_with_program(REQUEST, tmp_path / "ros" / "bag", STACK)
    assert made.answers is not None
    assert 0.0 <= made.answers.median_ms <= made.answers.p95_ms <= made.answers.worst_ms
    assert made.outcome.steps == STEPS
    setup = set_up_episode(REQUEST)
    record_episode(setup, tmp_path / "alone" / "bag", answers_of(setup, driver_of("lawful-california")))
    assert digest(tmp_path / "ros") == digest(tmp_path / "alone")


def test_a_program_that_fails_gives_its_last_words(tmp_path: Path) -> None:
    program = tmp_path / "broken.py"
    program.write_text(
        f"import sys\nsys.path.insert(0, {str(EXAMPLES)!r})\nimport av_policy\n\n"
        "def answer(*_):\n    raise RuntimeError('no plan')\n\nav_policy.AvPolicy.answer = answer\nav_policy.main()\n"
    )
    with pytest.raises(EpisodeError, match=r"(is gone|ended before the episode).*exit code 1: RuntimeError: no plan"):
        episode_with_program(REQUEST, tmp_path / "bag", f"{sys.executable} {program}")


def processes_of(word: str) -> list[str]:
    """Running processes whose command line has a word."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if word.encode() in (place / "cmdline").read_bytes() and " Z " not in (place / "stat").read_text():
                found.append(place.name)
    return found


def test_what_an_episode_has_started_ends_when_it_is_killed(tmp_path: Path) -> None:
    program = f"{sys.executable} -c 'import time; time.sleep(600)' {tmp_path}"
    code = (
        "from pathlib import Path\nfrom siren_ros.simulation.scenario.episode import EpisodeRequest\n"
        "from siren_ros.running.studies.av_program import episode_with_program\n"
        f"request, bag = EpisodeRequest(av='civilian', sensors='none'), Path({str(tmp_path / 'bag')!r})\n"
        f"episode_with_program(request, bag, {program!r})"
    )
    episode = subprocess.Popen([sys.executable, "-c", code])
    try:
        deadline_s = time.monotonic() + PATIENCE_S
        while len(processes_of(str(tmp_path))) < 3:  # itself, cosim and the program
            assert time.monotonic() < deadline_s
            assert episode.poll() is None
            time.sleep(0.1)
        time.sleep(1.0)
    finally:
        episode.kill()
        episode.wait()
    deadline_s = time.monotonic() + PATIENCE_S
    while processes_of(str(tmp_path)):
        assert time.monotonic() < deadline_s
        time.sleep(0.1)
