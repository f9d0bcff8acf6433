"""The option that says how many processes work."""

import argparse

import pytest

from siren_ros.cli.options.processes import add_processes, processes_of
from siren_ros.errors import InputError


def read(*words: str) -> argparse.Namespace:
    line = argparse.ArgumentParser()
    add_processes(line)
    return line.parse_args(words)


def test_the_default_is_the_processors_at_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 3, 5})
    assert processes_of(read()) == 3


def test_one_process_is_enough() -> None:
    assert processes_of(read("--jobs", "1")) == 1


@pytest.mark.parametrize("jobs", ["0", "-2"])
def test_no_process_is_refused(jobs: str) -> None:
    with pytest.raises(InputError, match=r"jobs: .* 1 or more"):
        processes_of(read("--jobs", jobs))
