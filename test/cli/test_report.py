from pathlib import Path

import pytest


@pytest.mark.parametrize(
    "options",
    [
        ["--out", "page.pdf"],
        ["--out", "page.html", "--workers", "0"],
        ["--out", "page.html", "--models", ","],
        ["--out", "page.html", "--pages", "-1"],
    ],
)
def test_bad_options_are_refused(tmp_path: Path, options: list[str], siren) -> None:
    assert siren(["report", str(tmp_path), *options], 2).err.count("\n") == 1


def test_a_folder_without_study_is_refused(tmp_path: Path, siren) -> None:
    assert "manifest.parquet" in siren(["report", str(tmp_path), "--out", str(tmp_path / "page.html")], 2).err
    assert not (tmp_path / "page.html").exists()
