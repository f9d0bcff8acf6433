"""One measurement on many bags."""

import argparse
import math
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.cli import train
from siren_ros.cli.options import add_processes, check_numbers, named_path, names_in, of_each_bag, processes_of
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import BagError, EpisodeError, InputError


def length_of_name(bag: Path) -> int:
    if bag.name == "gone":
        raise BagError(str(bag), "a bag")
    if bag.name == "broken":
        raise EpisodeError("it ended early")
    return len(bag.name)


def test_names_of_rows_can_be_shown_and_paths_stay_as_they_are() -> None:
    assert named_path("a\x1b[31m=b\udce9.json") == ("a\\x1b[31m", Path("b\udce9.json"))
    assert names_in("cv, idm:\x1b[2J") == ("cv", "idm:\\x1b[2J")


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_bag_is_measured(jobs: int) -> None:
    bags = [Path("/a/b"), Path("/a/bcd"), Path("/a/bc")]
    lengths, code = of_each_bag(os.fspath, bags, jobs)
    assert sorted(lengths) == ["/a/b", "/a/bc", "/a/bcd"]
    assert code == 0


@pytest.mark.parametrize("jobs", [1, 2])
def test_errors_come_back_from_processes(jobs: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    records, code = of_each_bag(read_episode, [tmp_path / "none", tmp_path / "neither"], jobs)
    assert records == []
    assert code == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert "neither" in "".join(lines)


@pytest.mark.parametrize(
    ("names", "worst"), [(["ab", "broken"], 1), (["gone", "ab"], 2), (["gone", "ab", "broken"], 2)]
)
def test_bags_that_cannot_be_read_keep_none_back(names, worst, capsys) -> None:
    lengths, code = of_each_bag(length_of_name, [Path(name) for name in names], 1)
    assert lengths == [2]
    assert code == worst
    message = capsys.readouterr().err
    assert ("it ended early" in message) == ("broken" in names)
    assert ("gone" in message) == ("gone" in names)


@pytest.mark.parametrize(
    ("text", "names"),
    [("cv,idm", ("cv", "idm")), (" cv , idm ", ("cv", "idm")), ("cv,,idm,", ("cv", "idm")), ("", ()), (" , ", ())],
)
def test_names_stand_between_commas(text: str, names: tuple[str, ...]) -> None:
    assert names_in(text) == names


@given(st.lists(st.from_regex(r"[a-z][a-z0-9_.]{0,8}", fullmatch=True)))
def test_joined_names_come_back_in_their_order(names: list[str]) -> None:
    assert names_in(",".join(names)) == tuple(names)


@pytest.mark.parametrize("value", [0.5, 2.0, 3, None])
def test_numbers_within_their_limits_pass(value: float | None) -> None:
    check_numbers(argparse.Namespace(timeout_s=value), {"timeout_s": (0.5, 3.0)})


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 0.49, 3.01])
def test_others_are_refused_by_name(value: float) -> None:
    with pytest.raises(InputError) as refused:
        check_numbers(argparse.Namespace(timeout_s=value), {"timeout_s": (0.5, 3.0)})
    assert str(refused.value) == f"timeout_s: {value!r} cannot be used; allowed: a number from 0.5 to 3"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["calibrate", "bag", "--seed", "-1"], "calibrate: seed: -1 "),
        (["generate", "risk", "--out", "set", "--seed", "-1"], "generate: seed: -1 "),
        (["generate", "risk", "--out", "set", "--retries", "-1"], "generate: retries: -1 "),
        (["train", "detection", "bag", "--out", "a.onnx", "--minutes", "nan"], "train: minutes: nan "),
        (["train", "prediction", "--out", "a", "--validation-seeds", "-1"], "train: validation_seeds: -1 "),
        (["train", "risk", "--out", "a", "--seed", "-1"], "train: seed: -1 "),
    ],
)
def test_commands_refuse_them_before_anything_else(words, line, siren, monkeypatch) -> None:
    monkeypatch.setattr(train, "fitter_of", lambda _: None)  # needs torch
    assert siren(words, 2).err.startswith(f"siren {line}cannot be used; allowed: a")


def read(*words: str) -> argparse.Namespace:
    line = argparse.ArgumentParser()
    add_processes(line)
    return line.parse_args(words)


def test_a_process_is_enough_and_the_default_is_the_processors_at_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 3, 5})
    assert (processes_of(read()), processes_of(read("--workers", "1"))) == (3, 1)


@pytest.mark.parametrize("jobs", ["0", "-2"])
def test_no_process_is_refused(jobs: str) -> None:
    with pytest.raises(InputError, match=r"workers: .* 1 or more"):
        processes_of(read("--workers", jobs))
