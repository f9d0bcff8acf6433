import json
from collections.abc import Callable
from pathlib import Path

import pytest

from siren_ros.cli.main import main


def test_what_more_seeds_add_is_printed_and_written(
    write_bag: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(tmp_path / "one", duration_s=4.0)
    write_bag(tmp_path / "two", duration_s=6.0, seed=1)
    out = tmp_path / "diversity.json"
    assert main(["evaluate", "diversity", str(tmp_path), "--jobs", "1", "--out", str(out)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2].split()[:4] == ["S2", "L2", "straight", "2"]
    (written,) = json.loads(out.read_text(encoding="utf-8"))
    assert written["episodes"] == 2
    assert written["ways_m"]["mean"] == pytest.approx(0.0), "the same ways, as long as both last"
    assert written["events"]["mean"] > 0.0


def test_a_damaged_bag_is_told_and_the_others_are_compared(
    write_bag: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(tmp_path / "good", duration_s=2.0)
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad/bad_0.mcap").write_bytes(b"nothing")
    assert main(["evaluate", "diversity", str(tmp_path), "--jobs", "1"]) != 0
    told = capsys.readouterr()
    assert "bad" in told.err
    assert ["S2", "L2"] in [line.split()[:2] for line in told.out.splitlines()]


@pytest.mark.parametrize("options", [["--jobs", "0"]])
def test_bad_options_are_refused(write_bag: Callable[..., Path], tmp_path: Path, options: list[str]) -> None:
    write_bag(tmp_path / "one", duration_s=2.0)
    assert main(["evaluate", "diversity", str(tmp_path), *options]) == 2
