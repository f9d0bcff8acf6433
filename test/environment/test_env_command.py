"""./env: when the environment is made, when it is not, and what becomes of the command."""

import shutil
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from environment_support import Checkout


def test_makes_the_environment_once_and_sources_what_it_sets(checkout: Checkout) -> None:
    assert checkout.env().returncode == 0
    assert checkout.env("bash", "-c", "echo $MADE").stdout == "yes\n"
    assert checkout.calls() == [".venv wheels"]


def test_a_changed_definition_makes_it_again(checkout: Checkout) -> None:
    added = checkout.root / "msg_defs/msg/Added.msg"
    for name in ("env", "setup.py", "setup.cfg", "tools/environment/lock.txt", "msg_defs/package.xml", added.name):
        checkout.env("true")
        before = len(checkout.calls())
        with (added if name == added.name else checkout.root / name).open("a") as file:
            file.write("# changed\n")
        for _ in range(2):
            checkout.env("true")
            assert len(checkout.calls()) == before + 1, name
    added.unlink()
    checkout.env("true")
    assert len(checkout.calls()) == before + 2


def test_changed_ranges_of_packages_make_it_again_and_settings_of_tools_do_not(checkout: Checkout) -> None:
    checkout.env("true")
    project = checkout.root / "pyproject.toml"
    project.write_text(project.read_text().replace("line-length = 120", "line-length = 100"))
    checkout.env("true")
    assert len(checkout.calls()) == 1
    project.write_text(project.read_text().replace("numpy>=1.26", "numpy>=1.27"))
    checkout.env("true")
    assert len(checkout.calls()) == 2


def test_a_checkout_that_moved_makes_it_again(checkout: Checkout, tmp_path: Path) -> None:
    checkout.env("true")
    moved = tmp_path / "moved"
    shutil.copytree(checkout.root, moved, symlinks=True)
    assert subprocess.run([moved / "env", "true"], check=False).returncode == 0
    assert (moved / "calls").read_text().count("\n") == 2


def test_a_making_that_fails_runs_nothing_and_is_done_again(checkout: Checkout) -> None:
    failed = checkout.env("echo", "ran", MAKE_FAILS="yes")
    assert failed.returncode == 5
    assert failed.stdout == ""
    assert checkout.env("echo", "ran").stdout == "ran\n"
    assert len(checkout.calls()) == 2


def test_two_at_once_make_it_once(checkout: Checkout) -> None:
    errors = checkout.root / "errors"
    with ThreadPoolExecutor() as pool, errors.open("a") as together:
        results = [pool.submit(checkout.env, "echo", "ran", stderr=together, MAKE_WAITS_FOR="go") for _ in range(3)]
        while errors.read_text().count("waiting") < 2 and not any(result.done() for result in results):
            time.sleep(0.01)
        (checkout.root / "go").touch()
    assert [result.result().stdout for result in results] == ["ran\n"] * 3
    assert len(checkout.calls()) == 1
    assert errors.read_text().count("waiting") == 2


def test_another_interpreter_makes_it_again(checkout: Checkout) -> None:
    checkout.env("true")
    checkout.env("true", SIREN_PYTHON="/opt/python3.12")
    checkout.env("true", SIREN_PYTHON="/opt/python3.12")
    checkout.env("true")
    assert len(checkout.calls()) == 2


def test_exit_code_output_and_arguments_pass_through(checkout: Checkout) -> None:
    result = checkout.env("bash", "-c", 'printf "<%s>" "$@"; exit 7', "bash", "a b", "*", "")
    assert result.returncode == 7
    assert result.stdout == "<a b><*><>"
    assert checkout.env("no-such-command").returncode == 127
    assert checkout.env("bash", "-c", "kill -TERM $$").returncode == -signal.SIGTERM, "the command replaces ./env"


def test_an_extra_is_asked_for_once(checkout: Checkout) -> None:
    for _ in range(2):
        assert checkout.env("--with", "models", "--with", "readers", "echo", "ran").stdout == "ran\n"
        assert checkout.env("--with", "models", "true").returncode == 0
        assert checkout.env("true").returncode == 0
    assert checkout.calls() == [".venv wheels models readers"]


@pytest.mark.parametrize(
    ("commands", "extra"),
    [
        (["pytest", "ruff", "mypy", "colcon", "tools/check_workspace.sh", "tools/mutants.sh"], " dev"),
        (["mkdocs"], " docs"),
        (["ros2", "siren", "python"], ""),
    ],
)
def test_a_command_brings_its_extra(checkout: Checkout, commands: list[str], extra: str) -> None:
    for command in commands:
        shutil.rmtree(checkout.root / ".venv", ignore_errors=True)
        checkout.env(command, "--version")
    assert checkout.calls() == [f".venv wheels{extra}"] * len(commands)


def test_help_and_what_is_refused_make_nothing(checkout: Checkout, tmp_path: Path) -> None:
    assert "./env pytest" in checkout.env("--help").stdout
    for arguments in (("--with",), ("--with", ""), ("--with", "-x"), ("--with", "a b", "true"), ("--no-such-option",)):
        result = checkout.env(*arguments)
        assert (result.returncode, result.stderr.count("\n")) == (2, 1)
        assert arguments[0] in result.stderr
    result = checkout.env("true", **sourced_ros(tmp_path, "humble"))
    assert result.returncode == 2
    assert result.stderr == (
        "env: ROS_DISTRO: 'humble' cannot be used; allowed: jazzy, or a shell in which no ROS is sourced\n"
    )
    assert checkout.calls() == []


def sourced_ros(tmp_path: Path, distro: str) -> dict[str, str]:
    prefix = tmp_path / "ros"
    (prefix / "share/rclpy").mkdir(parents=True)
    (prefix / "share/rclpy/package.xml").touch()
    return {"ROS_DISTRO": distro, "AMENT_PREFIX_PATH": f"{tmp_path / 'overlay'}:{prefix}"}


def test_a_sourced_ros_gets_an_environment_of_its_own(checkout: Checkout, tmp_path: Path) -> None:
    variables = sourced_ros(tmp_path, "jazzy")
    checkout.env("true", **variables)
    checkout.env("true")
    checkout.env("true", **variables)
    assert checkout.calls() == [".venv.jazzy sourced", ".venv wheels"]


def test_the_environment_itself_is_no_sourced_ros(checkout: Checkout) -> None:
    (checkout.root / ".venv/share/rclpy").mkdir(parents=True)
    (checkout.root / ".venv/share/rclpy/package.xml").touch()
    checkout.env("true", ROS_DISTRO="jazzy", AMENT_PREFIX_PATH=str(checkout.root / ".venv"))
    assert checkout.calls() == [".venv wheels"]
