"""What the soak runs, and that it sees what is wrong."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from siren_ros.lab.benchmarks.soak import (
    MARK,
    SoakCase,
    SoakResult,
    WorkerMemory,
    digest,
    end_marked,
    left_behind,
    lines_of,
    lost_messages,
    marked_processes,
    mixed_cases,
    totals_of,
)

CASE = SoakCase("S2", "L2", 0, 5.0)
TEMPLATES = tuple(f"S{number}" for number in range(1, 8))


def test_the_cases_mix_everything() -> None:
    cases = mixed_cases(100, 5.0, TEMPLATES, "small.yaml", "town10.xodr")
    assert {(case.template, case.level) for case in cases} >= {
        (name, level) for name in TEMPLATES for level in ("L0", "L1", "L2", "L3")
    }
    assert {case.processes for case in cases} == {(False, False), (False, True), (True, True)}
    assert sum(case.sensors != "none" for case in cases) == 20
    assert sum(bool(case.map) for case in cases) == 10
    assert len({case.name for case in cases}) == 100
    assert "processes:=true" in cases[1].parameters(Path("bag"), 1)
    assert "processes:=false" in cases[1].parameters(Path("bag"), 0)


def test_bags_that_differ_in_a_byte_are_not_the_same(tmp_path: Path, write_bag: Callable[..., Path]) -> None:
    bags = [write_bag(tmp_path / str(run) / "bag", duration_s=0.5) for run in range(2)]
    assert digest(bags[0]) == digest(bags[1])
    assert (left_behind(bags[0]), lost_messages(tmp_path / "none")) == ([], [])
    (tmp_path / "0" / ".bag.partial").mkdir()
    (bags[0] / ".reserve").touch()
    assert [path.name for path in left_behind(bags[0])] == [".bag.partial", ".reserve"]
    assert len(lost_messages(tmp_path / "0" / ".bag.partial")) == 1, "it cannot be read"
    storage = next(bags[1].glob("*.mcap"))
    storage.write_bytes(storage.read_bytes()[:-1] + b"x")
    assert digest(bags[0]) != digest(bags[1])


@pytest.mark.skipif(sys.platform != "linux", reason="processes are found in /proc")
def test_processes_that_are_left_are_found_and_ended() -> None:
    command = [sys.executable, "-c", "print('up', flush=True); input()"]
    with subprocess.Popen(
        command, env={**os.environ, MARK: "mine"}, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as left:
        assert left.stdout is not None
        assert left.stdout.readline() == b"up\n"
        assert list(marked_processes("mine")) == [left.pid]
        assert marked_processes("min") == {}
        (said,) = end_marked("mine")
        assert "input()" in said
        assert left.wait(30.0) == -9


def test_each_fault_makes_a_result_unclean_and_is_said() -> None:
    well = SoakResult(CASE)
    assert well.clean
    assert lines_of(well) == ["ok      S2/L2/seed0/none/town/one+one"]
    faults = {"failures": ("run 1: exit code 1: why",), "hashes_differ": True, "lost": ("topic",)}
    faults |= {"processes": ("python",), "segments": 1, "locks": ("lock",)}
    results = [replace(well, **{name: fault}) for name, fault in faults.items()]
    for result in results:
        assert not result.clean
        assert len(lines_of(result)) == 2
    counts = [line.split()[-1] for line in totals_of(results, None)[1:]]
    assert counts == ["1"] * 6


def test_memory_that_grows_is_not_flat() -> None:
    noise = np.random.default_rng(0).normal(0.0, 0.05, 60)
    flat = WorkerMemory(tuple(300.0 + noise), 20)
    growing = WorkerMemory(tuple(300.0 + noise + 0.5 * np.arange(60)), 20)
    step = WorkerMemory((*(300.0 + noise[:50]), *(340.0 + noise[50:])), 20)
    assert flat.flat
    assert not growing.flat
    assert growing.slope_mb == pytest.approx(0.5, abs=0.1)
    assert "MB an episode" in totals_of([], growing)[-1]
    assert step.flat, "one large episode is no leak"
