"""Checkouts, variables and programs that the tests of the environment share."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from program_output import next_line
from repository import REPOSITORY

TOOLS = REPOSITORY / "tools"
STEPS = TOOLS / "environment"
TIMEOUT_S = 60.0

# Stands for tools/environment/make.sh: makes in a moment what ./env compares, and writes down how it was called.
MAKE_STANDIN = """#!/usr/bin/env bash
set -eu
printf '%s %s%s\\n' "$(basename "$2")" "$3" "$(shift 4; printf ' %s' "$@" | sed 's/ $//')" >>"$1/calls"
while [ -n "${MAKE_WAITS_FOR-}" ] && [ ! -e "$1/$MAKE_WAITS_FOR" ]; do sleep 0.01; done
if [ -n "${MAKE_FAILS-}" ]; then exit 5; fi
mkdir -p "$2/bin" "$2/.siren"
ln -sf /bin/true "$2/bin/python"
echo 'export MADE=yes' >"$2/.siren/environment.sh"
echo "${SIREN_PYTHON-}" >"$2/.siren/asked_python"
echo "$4" >"$2/.siren/complete"
state=$2/.siren
shift 4
printf '%s\\n' "$@" >>"$state/extras"
"""


def clean_environment(**changes: str) -> dict[str, str]:
    """The variables of this process without those that a ROS, or ./env itself, would have set."""
    ros = ("ROS_", "FASTDDS_", "FASTRTPS_", "AMENT_", "CMAKE_PREFIX", "COLCON_")
    prefixes = (*ros, "SIREN_", "VIRTUAL_ENV", "PYTHONPYCACHE", "PYTHONDONT")
    return {name: value for name, value in os.environ.items() if not name.startswith(prefixes)} | changes


def run_shell(
    script: str, tmp_path: Path, *, user: str | None = None, **variables: str
) -> "subprocess.CompletedProcess[str]":
    """Runs shell lines after the environment's functions were read."""
    venv = tmp_path / "venv"
    prelude = f"""
        set -euo pipefail
        root={REPOSITORY} venv={venv} ros=wheels state={venv}/.siren here={STEPS}
        asked_extras=() extras=()
        for name in progress system browser steps runnables; do source "$here/$name.sh"; done
    """
    return subprocess.run(
        ["bash", "-c", prelude + script],
        env=clean_environment(**variables),
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
        user=user,
        cwd="/",
    )


class Checkout:
    """A copy of the files that define the environment, with a stand-in for what makes it."""

    def __init__(self, root: Path) -> None:
        self.root = root
        for name in ("env", "pyproject.toml", "setup.py", "setup.cfg"):
            shutil.copy(REPOSITORY / name, root / name)
        for name in ("tools/environment", "msg_defs"):
            shutil.copytree(REPOSITORY / name, root / name)
        (root / "tools/environment/make.sh").write_text(MAKE_STANDIN)

    def env(
        self, *arguments: str, stderr: IO[str] | int = subprocess.PIPE, **variables: str
    ) -> "subprocess.CompletedProcess[str]":
        """Runs ./env from another folder."""
        return subprocess.run(
            [self.root / "env", *arguments],
            env=clean_environment(**variables),
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
            cwd="/",
        )

    def calls(self) -> list[str]:
        """How often, and with what, the environment was made: one ``FOLDER wheels|sourced [EXTRA...]`` per call."""
        path = self.root / "calls"
        return path.read_text().splitlines() if path.exists() else []


def ros_variables(domain_id: str) -> dict[str, str]:
    """What separates the tests' ROS graph from every other one."""
    return {
        "ROS_DOMAIN_ID": domain_id,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(TOOLS.parent / "params/fastdds_localhost.xml"),
        "PYTHONPATH": os.pathsep.join(filter(None, [str(TOOLS), os.environ.get("PYTHONPATH", "")])),
    }


@contextmanager
def running(program: str, domain_id: str) -> "Iterator[subprocess.Popen[str]]":
    """A Python program in a process of its own, from when it has said that it is ready."""
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        env={**os.environ, **ros_variables(domain_id)},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert next_line(process.stdout) == "ready\n"
        yield process
    finally:
        process.kill()
        process.communicate()


TALKER = """
import sys, time
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from std_msgs.msg import UInt8MultiArray

rclpy.init()
node = rclpy.create_node("talker")
chatter = node.create_publisher(String, "/test/chatter", 10)
latched = node.create_publisher(
    String, "/test/latched", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
)
latched.publish(String(data="said once"))
unreliable = node.create_publisher(
    UInt8MultiArray, "/test/unreliable", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
)
print("ready", flush=True)
while True:
    chatter.publish(String(data="grüezi"))
    unreliable.publish(UInt8MultiArray(data=list(range(200))))
    rclpy.spin_once(node, timeout_sec=0.0)
    time.sleep(0.02)
"""
