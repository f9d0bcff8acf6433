"""What `siren fit-drivers` refuses before it simulates anything."""

from pathlib import Path


def test_unknown_presets_and_numbers_that_make_no_fit_are_named(tmp_path: Path, siren) -> None:
    words = ["fit-drivers", "--out", str(tmp_path / "mine.yaml")]
    assert "nobody" in siren([*words, "--base", "nobody"], 2).err
    assert "tries" in siren([*words, "--tries", "1"], 2).err
    assert not [*tmp_path.iterdir()]
