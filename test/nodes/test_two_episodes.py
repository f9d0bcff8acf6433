"""Two episodes at once on one machine do not hear each other."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from live_episodes import Domain, cosim, finish, recording, wait_until

from siren_ros.running.ros.transport.dds import DOMAIN_VARIABLE, LARGEST_DOMAIN, claimed_domain

HERE = Domain()
SHORT = ("sensors:=none", "duration_s:=1.0", "bag:=bag")
LONGER = ("sensors:=none", "duration_s:=2.0", "bag:=bag", "realtime_factor:=1.0", "step_timeout_s:=600.0")


def test_further_episodes_in_one_domain_are_refused_and_leave_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(DOMAIN_VARIABLE, str(HERE.number))
    with (
        claimed_domain(),
        HERE.episode(*SHORT, cwd=tmp_path) as first,
        HERE.episode(*SHORT, "processes:=true", cwd=tmp_path) as second,
    ):
        refusals = [finish(first), finish(second)]
    for refused in refusals:
        assert refused.code == 2
        (line,) = [line for line in refused.err.splitlines() if line.startswith("ROS_DOMAIN_ID")]
        assert line.startswith(f"ROS_DOMAIN_ID: {HERE.number} cannot be used")
        assert f"for example ROS_DOMAIN_ID={(HERE.number + 1) % (LARGEST_DOMAIN + 1)}" in line
    assert list(tmp_path.iterdir()) == []


def test_episodes_without_a_chosen_domain_take_one_each(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    second.mkdir()
    unset = {name: value for name, value in HERE.environment.items() if name != "ROS_DOMAIN_ID"}
    with subprocess.Popen([sys.executable, *cosim(LONGER)], env=unset, cwd=first, stderr=subprocess.DEVNULL) as episode:
        try:
            wait_until(recording(first), episode)
            episode.send_signal(signal.SIGSTOP)  # it gets no further, however long the other one takes
            other = subprocess.run(
                [sys.executable, *cosim(SHORT)], env=unset, cwd=second, capture_output=True, text=True, check=False
            )
            episode.send_signal(signal.SIGCONT)
            assert episode.wait(timeout=120.0) == 0
        finally:
            episode.kill()
    assert other.returncode == 0, other.stderr
    (line,) = [line for line in other.stderr.splitlines() if "ROS_DOMAIN_ID" in line]
    assert re.fullmatch(r"cosim: lower DDS domains are in use .* ROS_DOMAIN_ID=[1-9]\d*", line)
