"""One measurement on many bags."""

import argparse
import math
import os
from pathlib import Path

import pytest

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


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_and_errors_come_back_from_processes(jobs, tmp_path, capsys) -> None:
    lengths, code = of_each_bag(os.fspath, [Path("/a/b"), Path("/a/bcd"), Path("/a/bc")], jobs)
    assert (sorted(lengths), code) == (["/a/b", "/a/bc", "/a/bcd"], 0)
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
    [(" cv , idm ", ("cv", "idm")), ("idm,,cv,", ("idm", "cv")), (" , ", ()), ("a:\x1b[2J", ("a:\\x1b[2J",))],
)
def test_names_stand_between_commas_and_can_be_shown(text: str, names: tuple[str, ...]) -> None:
    assert names_in(text) == names
    assert named_path("a\x1b[31m=b\udce9.json") == ("a\\x1b[31m", Path("b\udce9.json"))
    with pytest.raises(argparse.ArgumentTypeError, match="NAME=PATH"):
        named_path("x.pt")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 0.49, 3.01])
def test_numbers_beyond_their_limits_are_refused_by_name(value: float) -> None:
    for allowed in (0.5, 2.0, 3, None):
        check_numbers(argparse.Namespace(timeout_s=allowed), {"timeout_s": (0.5, 3.0)})
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
        (["train", "detection", "bag", "--out", "a.onnx", "--steps", "0"], "train: steps: 0 "),
        (["train", "detection", "bag", "--out", "a.onnx", "--threads", "0"], "train: threads: 0 "),
        (["train", "detection", "bag", "--out", "a.bin"], "train: out: 'a.bin' "),
        (["train", "prediction", "--out", "a", "--train-seeds", "0"], "train: train_seeds: 0 "),
        (["train", "prediction", "--out", "a", "--epochs", "0"], "train: epochs: 0 "),
        (["train", "prediction", "--out", "a", "--workers", "0"], "train: workers: 0 "),
        (["train", "driver", "--out", "a", "--workers", "0"], "train: workers: 0 "),
    ],
)
def test_commands_refuse_them_before_anything_else(words, line, siren, monkeypatch) -> None:
    monkeypatch.setattr(train, "fitter_of", lambda _: None)  # needs torch
    assert siren(words, 2).err.startswith(f"siren {line}cannot be used; allowed: ")


def read(*words: str) -> argparse.Namespace:
    line = argparse.ArgumentParser()
    add_processes(line)
    return line.parse_args(words)


def test_a_process_is_enough_and_the_default_is_the_processors_at_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 3, 5})
    assert (processes_of(read()), processes_of(read("--workers", "1"))) == (3, 1)
