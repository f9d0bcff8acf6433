"""``siren report``, ``siren compare-paper`` and ``siren reproduce``."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from repository import REPOSITORY

from siren_ros.cli.main import main
from siren_ros.lab.reproduction.make import read_parts


@pytest.mark.parametrize(
    "options",
    [
        ["--out", "page.pdf"],
        ["--out", "page.html", "--workers", "0"],
        ["--out", "page.html", "--models", ","],
        ["--out", "page.html", "--pages", "-1"],
        ["--out", "page.html"],  # there is no study
    ],
)
def test_bad_options_of_a_page_are_refused(tmp_path: Path, options: list[str], siren, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert siren(["report", str(tmp_path), *options], 2).err.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def bags(write_bag: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One episode at S2's own level, one at another."""
    root = tmp_path_factory.mktemp("compared")
    write_bag(root / "own", duration_s=9.0)
    write_bag(root / "other", duration_s=9.0, level="L3")
    return root


def test_rows_are_printed_and_written(bags: Path, tmp_path: Path, siren) -> None:
    out = tmp_path / "rows.json"
    printed = siren(
        ["compare-paper", str(bags), "--models", "cv", "--workers", "1", "--out", str(out)]
    ).out.splitlines()
    assert printed[0].startswith("1 of 2 episodes are at other levels")
    assert printed[1] == "map: straight (1); the paper's is Town10HD_Opt"
    start = printed.index("ADE in m")
    head, line = printed[start + 1].split(), next(line for line in printed[start:] if line.startswith("CV, here"))
    written = json.loads(out.read_text(encoding="utf-8"))
    (row,) = [row for row in written if (row["table"], row["row"], row["column"]) == ("ADE in m", "CV", "S2")]
    assert (row["paper"], row["episodes"], row["low"]) == (1.17, 1, None)
    assert {row["map"] for row in written if row["table"] == "ADE in m"} == {"straight"}
    assert {row["map"] for row in written if row["table"] == "mAP"} == {""}, "whose scores do not say"
    assert line.split()[2:][head.index("S2")] == f"{row['ours']:.2f}"
    assert len(written) > len(printed), "the file has the paper's other numbers, too"
    assert "--all prints them" in printed[-1]


def test_the_rows_as_csv(bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "rows.csv"
    assert main(["compare-paper", str(bags), "--models", "cv", "--workers", "1", "--all", "--out", str(out)]) == 0
    with out.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    papers = [line.partition(", paper ")[2].split() for line in capsys.readouterr().out.splitlines()]
    assert sum(cell != "–" for cells in papers for cell in cells) == len(rows)


@pytest.mark.parametrize("options", [["--out", "rows.txt"], ["--workers", "0"], ["--detection", "/nowhere"]])
def test_bad_options_of_a_comparison_are_refused(bags, options, siren) -> None:
    printed = siren(["compare-paper", str(bags / "own"), "--models", "cv", *options], 2)
    assert printed.err.splitlines()[-1].startswith("siren compare-paper: ")
    assert main(["compare-paper", str(bags / "other"), "--models", "cv"]) == 2, "none is at its own level"


def test_a_predictor_that_the_paper_does_not_have_is_named(bags: Path, siren) -> None:
    printed = siren(["compare-paper", str(bags / "own"), "--models", "cv,cv:mine", "--workers", "1"]).out.splitlines()
    (line,) = [line for line in printed if "no row in the paper's tables" in line]
    assert line.startswith("cv:mine has ")


def test_the_list_names_each_part_with_its_time(siren, monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    assert "a checkout of the repository" in siren(["reproduce", "--list"], 2).err
    monkeypatch.chdir(REPOSITORY)
    parts = read_parts(REPOSITORY / "params" / "reproduction.yaml", REPOSITORY)
    assert [line.split()[0] for line in siren(["reproduce", "--list"]).out.splitlines()] == list(parts)


@pytest.mark.parametrize(
    ("words", "message"), [(["--only", "none"], "one or several of sizes"), (["--workers", "0"], "1 or more")]
)
def test_what_cannot_be_used_is_named(words, message, siren, monkeypatch) -> None:
    monkeypatch.chdir(REPOSITORY)
    assert message in siren(["reproduce", *words], 2).err
