"""Modules of the lab under the short names that users type."""

import subprocess
import sys
from importlib import import_module

import pytest

import siren_ros  # noqa: F401 - its import makes the short names known
from siren_ros.base.short_names import SHORT_NAMES, allow_short_names


@pytest.mark.parametrize("below", ["benchmarks.sensors", "learning", "learning.options", "training.settings"])
def test_a_module_is_the_same_under_both_names(below: str) -> None:
    module = import_module(f"siren_ros.{below}")
    assert module is import_module(f"siren_ros.lab.{below}")
    assert module.__name__ == module.__spec__.name == f"siren_ros.lab.{below}"


def test_what_is_not_there_is_not_found() -> None:
    for name in ("siren_ros.benchmarks.no_such_module", "siren_ros.learnin", "siren_ros.reproduction"):
        with pytest.raises(ModuleNotFoundError, match=name.split(".")[-1]):
            import_module(name)


def test_the_names_are_made_known_once() -> None:
    finders = list(sys.meta_path)
    allow_short_names()
    assert sys.meta_path == finders


@pytest.mark.parametrize("short", sorted(SHORT_NAMES))
def test_a_program_starts_under_its_short_name(short: str) -> None:
    """Python says that a package has no program; it found the package."""
    done = subprocess.run([sys.executable, "-m", short], check=False, capture_output=True, text=True)
    assert f"No module named {short}.__main__" in done.stderr


def test_a_benchmark_starts_under_its_short_name() -> None:
    command = [sys.executable, "-m", "siren_ros.benchmarks.sensors", "--help"]
    assert "usage" in subprocess.run(command, check=True, capture_output=True, text=True).stdout
