"""Programs in the lockstep are waited for, those that listen change nothing, nodes alone write nothing."""

import signal
import subprocess
from pathlib import Path

import pytest
from live_episodes import EXAMPLES, SMALL_SUITE, Domain, digest, finish, recording, wait_until

from siren_ros.simulation.world.commands import AV_SOURCE

LISTENER = str(EXAMPLES / "av_listener.py")


@pytest.fixture(name="domain")
def _domain() -> Domain:
    """One for each test: a program that hangs and is killed may leave the shared memory of its domain locked."""
    return Domain()


@pytest.fixture(scope="module", name="suite")
def _suite(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("suite") / "small.yaml"
    path.write_text(SMALL_SUITE, encoding="utf-8")
    return str(path)


def short(suite: str, *more: str, duration_s: float = 1.5) -> tuple[str, ...]:
    return (f"sensors:={suite}", "kitti:=false", f"duration_s:={duration_s}", "bag:=bag", *more)


@pytest.fixture(scope="module", name="alone")
def _alone(suite: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The bytes of an episode that nobody listens to."""
    folder = tmp_path_factory.mktemp("alone")
    run = Domain().run(*short(suite), cwd=folder)
    assert run.code == 0, run.err
    return digest(folder)


def test_a_participant_hears_every_step_and_listeners_change_nothing_also_when_they_hang(
    alone: dict[str, str], suite: str, tmp_path: Path
) -> None:
    domain = Domain(subprocess.Popen)
    with (
        domain.running(LISTENER, cwd=tmp_path) as asleep,
        domain.episode(*short(suite, "external:=[my_stack]"), cwd=tmp_path) as episode,
        domain.running(LISTENER, "--participant", "my_stack", cwd=tmp_path) as stack,
    ):
        wait_until(recording(tmp_path), episode)
        asleep.send_signal(signal.SIGSTOP)
        run, heard = finish(episode), finish(stack)
        assert asleep.poll() is None
    assert run.code == 0, run.err
    assert "my_stack" in run.out
    assert digest(tmp_path) == alone
    assert heard.code == 0, heard.err
    lines = heard.out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["0 s", "1 s"]
    assert all(int(line.split()[2]) > 100 for line in lines)


def test_a_participant_that_hangs_ends_the_episode_under_its_name(domain: Domain, suite: str, tmp_path: Path) -> None:
    parameters = short(suite, "external:=[my_stack]", "step_timeout_s:=4.0", duration_s=40.0)
    with (
        domain.episode(*parameters, cwd=tmp_path) as episode,
        domain.running(LISTENER, "--participant", "my_stack", cwd=tmp_path) as stack,
    ):
        wait_until(recording(tmp_path, 200_000), episode)
        stack.send_signal(signal.SIGSTOP)
        run = finish(episode)
    assert run.code == 1
    assert "episode failed" in run.out
    assert ": my_stack: did not finish step" in run.out
    assert "within 4 s" in run.out


def test_programs_that_never_come_are_named(domain: Domain, tmp_path: Path) -> None:
    """A participant, a predictor and an AV's controller."""
    others = ("external:=[my_stack]", "predictor:=my_predictor", "av:=civilian")
    run = domain.run("sensors:=none", "bag:=bag", *others, "start_timeout_s:=8.0", cwd=tmp_path)
    assert run.code == 1
    assert f"{AV_SOURCE}, my_predictor, my_stack: was not ready within 8 s" in run.out
    assert list(tmp_path.iterdir()) == []
