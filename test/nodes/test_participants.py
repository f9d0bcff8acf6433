"""Programs in the lockstep are waited for, those that listen change nothing."""

import signal
import subprocess
from pathlib import Path

from live_episodes import EXAMPLES, SMALL_SUITE, Domain, digest, finish, recording, wait_until

from siren_ros.simulation.world.commands import AV_SOURCE

LISTENER = str(EXAMPLES / "av_listener.py")


def test_a_participant_hears_every_step_and_listeners_change_nothing_also_when_they_hang(tmp_path: Path) -> None:
    suite, alone, heard = (tmp_path / name for name in ("small.yaml", "alone", "heard"))
    suite.write_text(SMALL_SUITE, encoding="utf-8")
    alone.mkdir()
    heard.mkdir()
    parameters = (f"sensors:={suite}", "kitti:=false", "duration_s:=1.5", "bag:=bag")
    run = Domain().run(*parameters, cwd=alone)
    assert run.code == 0, run.err
    domain = Domain(subprocess.Popen)
    with (
        domain.running(LISTENER, cwd=heard) as asleep,
        domain.episode(*parameters, "external:=[my_stack]", cwd=heard) as episode,
        domain.running(LISTENER, "--participant", "my_stack", cwd=heard) as stack,
    ):
        wait_until(recording(heard), episode)
        asleep.send_signal(signal.SIGSTOP)
        run, listened = finish(episode), finish(stack)
        assert asleep.poll() is None
    assert run.code == 0, run.err
    assert "my_stack" in run.out
    assert digest(heard) == digest(alone)
    assert listened.code == 0, listened.err
    lines = listened.out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["0 s", "1 s"]
    assert all(int(line.split()[2]) > 100 for line in lines)


def test_a_participant_that_hangs_ends_the_episode_under_its_name(tmp_path: Path) -> None:
    domain, suite = Domain(), tmp_path / "small.yaml"
    suite.write_text(SMALL_SUITE, encoding="utf-8")
    parameters = (f"sensors:={suite}", "kitti:=false", "duration_s:=40.0", "bag:=bag", "step_timeout_s:=8.0")
    with (
        domain.episode(*parameters, "external:=[my_stack]", cwd=tmp_path) as episode,
        domain.running(LISTENER, "--participant", "my_stack", cwd=tmp_path) as stack,
    ):
        wait_until(recording(tmp_path, 200_000), episode)
        stack.send_signal(signal.SIGSTOP)
        run = finish(episode)
    assert run.code == 1
    assert "episode failed" in run.out
    assert ": my_stack: did not finish step" in run.out
    assert "within 8 s" in run.out


def test_programs_that_never_come_are_named(tmp_path: Path) -> None:
    """A participant, a predictor and an AV's controller."""
    others = ("external:=[my_stack]", "predictor:=my_predictor", "av:=civilian")
    run = Domain().run("sensors:=none", "bag:=bag", *others, "start_timeout_s:=8.0", cwd=tmp_path)
    assert run.code == 1
    assert f"{AV_SOURCE}, my_predictor, my_stack: was not ready within 8 s" in run.out
    assert list(tmp_path.iterdir()) == []
