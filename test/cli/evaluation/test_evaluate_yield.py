import json
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from siren_ros.cli.main import main


def test_a_folder_of_bags_is_scored(
    write_bag: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(2):
        write_bag(tmp_path / "study" / "group" / f"bag{number}", duration_s=12.0 + number)
    out, drivers = tmp_path / "episodes.json", tmp_path / "drivers.parquet"
    words = ["evaluate", "yield", str(tmp_path / "study"), "--out", str(out), "--drivers", str(drivers), "--jobs", "1"]
    assert main(words) == 0
    table = capsys.readouterr().out
    caption, head, *_ = table.splitlines()
    assert (caption, head.split()) == ("Yield metrics of S2", ["metric", "L2", "meaning"])
    assert "emv_delay_s" in table
    rows = json.loads(out.read_text(encoding="utf-8"))
    assert [row["bag"] for row in rows] == [str(tmp_path / "study" / "group" / f"bag{number}") for number in range(2)]
    assert all(row["emv_delay_s"] is not None for row in rows)
    assert set(pq.read_table(drivers)["template"].to_pylist()) == {"S2"}


def test_a_bag_that_cannot_be_read_leaves_the_others(
    write_bag: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(tmp_path / "good", duration_s=12.0)
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "bad_0.mcap").write_bytes(b"nothing")
    assert main(["evaluate", "yield", str(tmp_path), "--jobs", "1"]) == 2
    shown = capsys.readouterr()
    assert "emv_delay_s" in shown.out
    assert "bad" in shown.err


def test_no_bag_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "yield", str(tmp_path)]) == 2
    assert str(tmp_path) in capsys.readouterr().err
    assert main(["evaluate", "yield", str(tmp_path), "--out", "x.csv"]) == 2
