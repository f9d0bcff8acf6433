import pytest
from repository import REPOSITORY

from siren_ros.lab.reproduction.parts import read_parts


def test_the_list_names_each_part_with_its_time(siren, monkeypatch) -> None:
    monkeypatch.chdir(REPOSITORY)
    parts = read_parts(REPOSITORY / "params" / "reproduction.yaml", REPOSITORY)
    assert [line.split()[0] for line in siren(["reproduce", "--list"]).out.splitlines()] == list(parts)


@pytest.mark.parametrize(
    ("words", "message"), [(["--only", "none"], "one or several of sizes"), (["--workers", "0"], "1 or more")]
)
def test_what_cannot_be_used_is_named(words, message, siren, monkeypatch) -> None:
    monkeypatch.chdir(REPOSITORY)
    assert message in siren(["reproduce", *words], 2).err


def test_it_needs_a_checkout(siren, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "a checkout of the repository" in siren(["reproduce", "--list"], 2).err
