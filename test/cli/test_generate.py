from pathlib import Path

import pytest

from siren_ros.cli.main import main
from siren_ros.studies.study_folder import LocalFolder, read_table

SHORT = ["--duration-s", "0.5", "--workers", "2"]


def test_a_matrix_is_made_and_made_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "study"
    words = ["generate", "--templates", "S2", "--levels", "L0", "own", "--out", str(out), *SHORT]
    assert main(words) == 0
    first = capsys.readouterr().out
    assert "S2_L0  1/1 complete, predicate holds in 0, at most " in first
    assert first.splitlines()[-1] == f"{out}/manifest.parquet: 2 episodes"
    times = [row.begun_at for row in read_table(LocalFolder(out))]
    assert main(words) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"{out}/manifest.parquet: 2 episodes, 2 of them from before"
    assert [row.begun_at for row in read_table(LocalFolder(out))] == times


def test_a_study_file_with_draws(tmp_path: Path) -> None:
    file = tmp_path / "study.yaml"
    draw = "{method: random, samples: 2, ranges: {emv.speed_mps: [12, 15]}}"
    file.write_text(f"templates: S2\nduration_s: 0.5\ndraw: {draw}\n", encoding="utf-8")
    assert main(["generate", str(file), "--out", str(tmp_path / "study"), "--workers", "2"]) == 0
    rows = read_table(LocalFolder(tmp_path / "study"))
    assert [row.episode for row in rows] == ["S2_L2_seed0_draw0", "S2_L2_seed0_draw1"]
    assert rows[0].values != rows[1].values
    assert rows[0].mcap_sha256 != rows[1].mcap_sha256


@pytest.mark.parametrize(
    "words",
    [
        ["v9"],
        ["--templates", "S9"],
        ["--workers", "0"],
        ["--seeds", "a"],
        ["--range", "emv.speed_mps=12:13"],
        ["--grid", "emv.speed_mps=12", "--lhs", "4"],
    ],
)
def test_bad_input_is_one_line(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["generate", "--out", str(tmp_path / "study"), *words]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()[-1].split("siren generate: ")) == 2


def test_an_episode_that_is_missing_fails_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--templates", "S2", "--timeout-s", "1", "--retries", "0", "--duration-s", "3000"]
    assert main(["generate", "--out", str(tmp_path), *words]) == 1
    assert "S2_L2_seed0: crashed: its process gave no answer for 1 s" in capsys.readouterr().err
