"""``siren replay``: which of its two jobs it does, and what it tells the player."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from siren_ros.cli.main import main


@pytest.fixture
def bag(tmp_path: Path, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path / "bag", duration_s=0.5)


def player_of(bag: Path, monkeypatch: pytest.MonkeyPatch, *options: str) -> list[str]:
    """The command that ``siren replay`` becomes."""
    became: list[str] = []

    def execute(program: str, arguments: list[str]) -> None:
        became.extend([program, *arguments])
        raise SystemExit(0)

    monkeypatch.setattr(os, "execv", execute)
    monkeypatch.chdir(bag.parent)
    with pytest.raises(SystemExit):
        main(["replay", "bag", *options])
    return became


def test_it_becomes_the_player(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    became = player_of(bag, monkeypatch, "--rate", "2", "--start", "0.25", "--loop", "--paused")
    assert became[:5] == [sys.executable, sys.executable, "-m", "siren_nodes.player", "--ros-args"]
    assert became[5::2] == ["-p"] * 5
    assert became[6::2] == [f'bag:="{bag}"', "rate:=2.0", "start_s:=0.25", "loop:=true", "paused:=true"]


def test_topics_duration_and_other_names(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = ("--topics", "/tf", "/b", "--playback-duration", "1.5", "--remap", "/tf:=/mine", "b:=c")
    became = player_of(bag, monkeypatch, *options)
    assert became[-8:] == [
        "-p",
        "playback_duration_s:=1.5",
        "-p",
        'topics:=["/tf", "/b"]',
        "-r",
        "/tf:=/mine",
        "-r",
        "b:=c",
    ]


def test_a_rule_that_is_none_is_refused(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(bag), "--remap", "/tf=/mine"]) == 2
    assert "--remap: '/tf=/mine' cannot be used" in capsys.readouterr().err


def test_a_bag_that_is_none_is_refused_before_the_player(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(tmp_path / "nothing")]) == 2
    assert "nothing" in capsys.readouterr().err


def test_a_hand_made_bag_cannot_be_repeated(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", "--check", str(bag)]) == 2
    assert "request of the episode" in capsys.readouterr().err


def test_what_is_no_number_is_refused(bag: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["replay", str(bag), "--rate", "fast"])
    assert ended.value.code == 2
