"""The command line as a whole: exit codes, interrupts, and its options."""

import argparse
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from test_documents import PRIVATE_WORDS

from siren_ros.cli import bags
from siren_ros.cli.main import VERBS, command_lines, main


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "S2_L2_seed0", lidar=True)


@pytest.fixture(scope="module")
def failing_bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "S2_L2_seed1", changing=1)


def test_info_tells_the_episode(bag: Path, siren) -> None:
    out = siren(["info", str(bag)]).out
    assert "template S2, level L2, seed 0" in out
    assert "16.00 s of 16.00 s, 320 steps" in out
    assert "interaction verified" in out
    (lidar,) = [line.split() for line in out.splitlines() if line.startswith("/emv/lidar/points")]
    assert lidar[1:5] == ["sensor_msgs/msg/PointCloud2", "160", "10", "Hz"]
    assert "yield_completed × 4" in out


def test_verify_names_what_fails(failing_bag: Path, siren) -> None:
    out = siren(["verify", "--quiet", str(failing_bag)], 1).out
    assert f"{failing_bag}: FAILS" in out
    assert "FAIL  lane_changes: 1 (needs >= 3)" in out
    assert "ok" not in out.split()
    seconds, actor_id = re.search(r"siren view \S+seed1 --time-s (\S+) --actor (\d+)", out).groups()
    assert f"{actor_id} at {float(seconds):.1f} s" in out, "of the one lane change"


def test_verify_goes_on_after_a_bag_that_cannot_be_read(bag, tmp_path, siren) -> None:
    captured = siren(["verify", str(tmp_path / "none"), str(bag)], 2)
    assert f"{bag}: holds" in captured.out
    assert "FAIL" not in captured.out
    assert captured.err.count("\n") == 1
    assert "none" in captured.err


def test_memory_that_is_not_enough_is_one_line(monkeypatch, siren) -> None:
    def verify(_arguments: object) -> int:
        return len(np.ones(1 << 58))

    monkeypatch.setattr(bags, "add_info", lambda verb: verb.set_defaults(run=verify))
    captured = siren(["info"], 1)
    assert captured.err.startswith("siren info: the memory is not enough (Unable to allocate 2.00 EiB")
    assert captured.err.count("\n") == 1


def test_names_of_others_reach_a_terminal_without_control_characters(bag, tmp_path, siren, capsys) -> None:
    named, absent = (tmp_path / os.fsdecode(name) for name in (b"\x1b[31m_\xe9", b"none_\x1b[31m_\xe9"))
    named.symlink_to(bag)
    captured = siren(["verify", str(named), str(absent)], 2)
    assert captured.out.startswith(f"{tmp_path}/\\x1b[31m_\\udce9: holds")
    assert captured.err.startswith(f"siren verify: bag: '{tmp_path}/none_\\x1b[31m_\\udce9'")
    assert (captured.out + captured.err).replace("\n", "").isprintable()
    with pytest.raises(SystemExit):
        main(["verify", "--quiet", "x", "--\x1b[31m"])
    assert capsys.readouterr().err.endswith("--\\x1b[31m\n")


BY_SIGNALS = pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)


@BY_SIGNALS
def test_a_signal_waits_until_a_verb_is_loaded_and_is_one_line(number, code, word, monkeypatch, siren) -> None:
    loaded = []

    def add(_verb: object) -> None:
        signal.raise_signal(number)
        loaded.append("whole")

    monkeypatch.setattr(bags, "add_info", add)
    assert siren(["info"], code) == ("", f"siren: {word}\n")
    assert loaded == ["whole"]


@BY_SIGNALS
def test_an_error_that_a_library_makes_of_a_signal_is_no_error(number, code, word, monkeypatch, siren) -> None:
    """As extension modules do while they are loaded."""

    def verify(_arguments: object) -> int:
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt as error:
            raise ImportError("initialization failed") from error
        return 0

    monkeypatch.setattr(bags, "add_info", lambda verb: verb.set_defaults(run=verify))
    assert siren(["info"], code) == ("", f"siren info: {word}\n")


def test_export_writes_both_formats(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plot", str(bag), "--out", str(tmp_path / "a.png")]) == 0
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert main(["export", "csv", str(bag), "--out", str(tmp_path / "csv")]) == 0
    assert main(["export", "kitti", "--layout", "paper", str(bag), "--out", str(tmp_path / "kitti")]) == 0
    assert (tmp_path / "csv" / "trajectory.csv").read_text().startswith("step,timestamp")
    assert len(list((tmp_path / "kitti" / "label_2").iterdir())) == 160
    assert "160 frames" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [["info", "BAG"], ["verify", "BAG"], ["plot", "BAG", "--out", "x.png"], ["export", "kitti", "BAG", "--out", "x"]],
)
def test_a_bag_that_is_not_there_is_one_line_and_exit_code_2(arguments, tmp_path, siren) -> None:
    absent = str(tmp_path / "absent")
    captured = siren([absent if word == "BAG" else word for word in arguments], 2)
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert absent in captured.err


@pytest.mark.parametrize("arguments", [[], ["fly"], ["info"], ["export", "zip", "bag"], ["plot", "bag"]])
def test_a_wrong_command_line_is_exit_code_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert "siren" in capsys.readouterr().err


def test_a_reader_that_goes_away_is_not_an_error_message(bag: Path) -> None:
    command = f"{sys.executable} -m siren_ros.cli.main info {bag} | head -n 1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, check=True, text=True)
    assert done.stdout.startswith("bag")
    assert done.stderr == ""


@pytest.mark.parametrize(
    "words", [[], *([verb] for verb in VERBS), ["export", "csv"], ["export", "kitti"], ["exam", "compare"]]
)
def test_every_command_helps(words, capsys) -> None:
    with pytest.raises(SystemExit) as left:
        main([*words, "--help"])
    assert left.value.code == 0
    printed = capsys.readouterr().out
    assert f"usage: {' '.join(['siren', *words])} " in printed
    assert words or all(re.search(rf"\n    {verb}\s", printed) for verb in VERBS)


def test_help_brings_no_library_along() -> None:
    program = "import sys; from siren_ros.cli.main import parser; parser(); print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


LINES = {line.prog: line for line in command_lines()}
FORMER = {"--jobs": "--workers", "--time": "--time-s", "--start": "--start-s", "--playback-duration": "--duration-s"}
"""Spellings that still work, and the one that the help shows in every command."""


@pytest.mark.parametrize("prog", LINES)
def test_every_option_says_what_it_does_and_has_one_name_in_every_command(prog: str) -> None:
    line = LINES[prog]
    shown = [action for action in line.arguments() if action.help != argparse.SUPPRESS]
    unclear = [one for one in shown if not re.match(r"[^\W\d_(]", re.sub(r"^\(.*?\)\s*", "", one.help or ""))]
    assert not unclear
    assert (line.description or "").endswith(".")
    assert not PRIVATE_WORDS.findall(line.format_help())
    others = {*FORMER, "--processes", "--begin", "--duration", "--timeout", "--output"}
    assert not others & {option for action in shown for option in action.option_strings}
    options = {option: action for action in line.arguments() for option in action.option_strings}
    for former in set(FORMER) & set(options):
        assert options[former].dest == options[FORMER[former]].dest
    assert ("--jobs" in options) == ("--workers" in options)
