"""Two episodes at once on one machine do not hear each other."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from live_episodes import Domain, cosim, finish, recording, wait_until

from siren_ros.running.ros.transport.dds import LARGEST_DOMAIN

HERE = Domain()
SHORT = ("sensors:=none", "duration_s:=1.0", "bag:=bag")
LONGER = ("sensors:=none", "duration_s:=2.0", "bag:=bag", "realtime_factor:=1.0", "step_timeout_s:=600.0")


@contextmanager
def standing_still(process: "subprocess.Popen[Any]") -> Iterator[None]:
    """A running program that keeps what it has and gets no further, however long the others take."""
    process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        process.send_signal(signal.SIGCONT)


def test_further_episodes_in_one_domain_are_refused_and_harm_nothing(tmp_path: Path) -> None:
    first, *others = folders = [tmp_path / name for name in ("first", "second", "third")]
    for folder in folders:
        folder.mkdir()
    with HERE.episode(*LONGER, cwd=first) as episode:
        wait_until(recording(first), episode)
        with (
            standing_still(episode),
            HERE.episode(*SHORT, cwd=others[0]) as first_refused,
            HERE.episode(*SHORT, "processes:=true", cwd=others[1]) as second_refused,
        ):
            refusals = [finish(first_refused), finish(second_refused)]
        run = finish(episode)
    for refused in refusals:
        assert refused.code == 2
        (line,) = [line for line in refused.err.splitlines() if line.startswith("ROS_DOMAIN_ID")]
        assert line.startswith(f"ROS_DOMAIN_ID: {HERE.number} cannot be used")
        assert f"for example ROS_DOMAIN_ID={(HERE.number + 1) % (LARGEST_DOMAIN + 1)}" in line
    assert [list(folder.iterdir()) for folder in others] == [[], []]
    assert run.code == 0, run.err
    assert "episode complete after 2.00 s" in run.out


def test_episodes_without_a_chosen_domain_take_one_each(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    second.mkdir()
    unset = {name: value for name, value in HERE.environment.items() if name != "ROS_DOMAIN_ID"}
    with subprocess.Popen([sys.executable, *cosim(LONGER)], env=unset, cwd=first, stderr=subprocess.DEVNULL) as episode:
        try:
            wait_until(recording(first), episode)
            with standing_still(episode):
                other = subprocess.run(
                    [sys.executable, *cosim(SHORT)], env=unset, cwd=second, capture_output=True, text=True, check=False
                )
            assert episode.wait(timeout=120.0) == 0
        finally:
            episode.kill()
    assert other.returncode == 0, other.stderr
    (line,) = [line for line in other.stderr.splitlines() if "ROS_DOMAIN_ID" in line]
    assert re.fullmatch(r"cosim: lower DDS domains are in use .* ROS_DOMAIN_ID=[1-9]\d*", line)
