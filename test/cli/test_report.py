from pathlib import Path

import pytest

from siren_ros.cli.main import main


@pytest.mark.parametrize(
    "options", [["--out", "page.pdf"], ["--out", "page.html", "--jobs", "0"], ["--out", "page.html", "--models", ","]]
)
def test_bad_options_are_refused(tmp_path: Path, options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(tmp_path), *options]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_folder_without_study_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(tmp_path), "--out", str(tmp_path / "page.html")]) == 2
    assert "manifest.parquet" in capsys.readouterr().err
    assert not (tmp_path / "page.html").exists()
