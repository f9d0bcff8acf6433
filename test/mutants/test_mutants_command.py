"""The whole command over a tiny package: one function is tested well, one badly, one hangs when it is changed."""

import json
import os
import subprocess
import sys

import pytest
from repository import REPOSITORY

BEFORE = """
import functools


def gap(a, b):
    return a - b
"""
CODE = (
    BEFORE
    + """

def inside(x, low, high):
    return low < x and x < high


def count_down(number):
    while number > 0:
        number = number - 1
    return number


def doubled(a):
    return 2 * a


def first_of(values):
    return values[0]


def second_of(values):
    return values[1]


@functools.cache
def kept():
    return 3
"""
)
TESTS = """
import pytest

from shop.prices import sums

SECOND = sums.second_of((5, 7))


def test_gap():
    assert sums.gap(7, 3) == 4


def test_inside():
    assert sums.inside(1.5, 1, 2)


def test_count_down():
    assert sums.count_down(3) == 0


def test_fails_always():
    assert sums.gap(1, 1) == 1


def test_slow():
    assert sum(range(20_000_000)) > sums.doubled(1)


@pytest.fixture(scope="module")
def first():
    return sums.first_of((5, 7))


def test_that_the_fixture_is_there(first):
    assert first and sums.kept() is not None


def test_first(first):
    assert first == 5


def test_second():
    assert SECOND == 7


def test_what_is_kept():
    assert sums.kept() == 3
"""


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    root = tmp_path_factory.mktemp("tiny")
    files = {
        "shop/__init__.py": "",
        "shop/prices/__init__.py": "",
        "shop/prices/sums.py": BEFORE,
        "test/prices/test_sums.py": TESTS,
    }
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    identity = ["git", "-c", "user.name=t", "-c", "user.email=t@example.org"]
    for command in (["init", "-q"], ["add", "."], ["commit", "-qm", "first"]):
        subprocess.run([*identity, *command], cwd=root, check=True, capture_output=True)
    (root / "shop/prices/sums.py").write_text(CODE)
    return root


def run(root, *arguments):
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY / "tools")}
    command = [sys.executable, "-m", "mutants", "--start", "1", "--slow", "0.1", *arguments]
    return subprocess.run(command, cwd=root, env=environment, check=False, capture_output=True, text=True)


@pytest.fixture(scope="module")
def whole(tiny):
    results = tiny / "results.json"
    done = run(tiny, "--since", "HEAD", "--results", str(results))
    assert done.returncode == 0, done.stderr
    return done, json.loads(results.read_text())


def verdicts(entries, was):
    return {entry["becomes"]: entry["verdict"] for entry in entries if entry["was"] == was}


def test_what_the_tests_notice_is_caught_and_what_they_do_not_survives(tiny, whole):
    done, entries = whole
    assert len({entry["line"] for entry in entries}) == 7, "of the change only"
    assert not verdicts(entries, "return a - b")
    inside = verdicts(entries, "return low < x and x < high")
    assert inside["return low >= x and x < high"] == "caught"
    assert inside["return low < x or x < high"] == "survived"
    assert "shop/prices/sums.py:10: survived" in done.stdout
    assert "+ return low < x or x < high" in done.stdout
    loop = {entry["becomes"]: entry for entry in entries if entry["was"] == "number = number - 1"}
    assert loop["number = number + 1"]["verdict"] == "caught", "it hangs"
    assert loop["number = number + 1"]["by"] == "time limit or crash"
    assert set(verdicts(entries, "return 2 * a").values()) == {"survived"}
    for name in ("test_slow", "test_fails_always"):
        assert f"left out, since it is slow or fails in a copy: test/prices/test_sums.py::{name}" in done.stderr
    caught = sum(entry["verdict"] == "caught" for entry in entries)
    assert f"{caught:5} of {len(entries):4} caught" in done.stdout
    assert (tiny / "shop/prices/sums.py").read_text() == CODE
    # The fixture and what is cached run within the first test that uses them, the constant while the module is loaded.
    by = {entry["becomes"]: entry["by"].rpartition("::")[2] for entry in entries}
    assert (by["return values[ 1]"], by["return values[ 0]"]) == ("test_first", "test_second")
    assert {by[entry["becomes"]] for entry in entries if entry["was"] == "return 3"} == {"test_what_is_kept"}


def test_survivors_are_run_again_with_better_tests(tiny, whole):
    _, entries = whole
    better = tiny / "test/prices/test_sums.py"
    before = better.read_text()
    better.write_text(before + "\n\ndef test_outside():\n    assert not sums.inside(2.5, 1, 2)\n")
    try:
        done = run(tiny, "--again", str(tiny / "results.json"), "--results", str(tiny / "again.json"))
    finally:
        better.write_text(before)
    again = json.loads((tiny / "again.json").read_text())
    assert done.returncode == 0
    assert len(again) == sum(entry["verdict"] == "survived" for entry in entries)
    assert verdicts(again, "return low < x and x < high")["return low < x or x < high"] == "caught"


@pytest.mark.parametrize(
    ("arguments", "word"), [(["nowhere"], "nowhere"), (["--since", "nowhere"], "--since"), ([], "name files")]
)
def test_a_wrong_command_line_ends_with_one_line_and_code_2(tiny, arguments, word):
    done = run(tiny, *arguments)
    assert done.returncode == 2
    assert word in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
