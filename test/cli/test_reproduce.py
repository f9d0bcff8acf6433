import pytest
from repository import REPOSITORY

from siren_ros.cli.main import main
from siren_ros.reproduction.parts import read_parts


def test_the_list_names_each_part_with_its_time(capsys, monkeypatch) -> None:
    monkeypatch.chdir(REPOSITORY)
    parts = read_parts(REPOSITORY / "params" / "reproduction.yaml", REPOSITORY)
    assert main(["reproduce", "--list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(parts)


@pytest.mark.parametrize(
    ("words", "message"), [(["--only", "none"], "one or several of sizes"), (["--workers", "0"], "1 or more")]
)
def test_what_cannot_be_used_is_named(words, message, capsys, monkeypatch) -> None:
    monkeypatch.chdir(REPOSITORY)
    assert main(["reproduce", *words]) == 2
    assert message in capsys.readouterr().err


def test_it_needs_a_checkout(capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", "--list"]) == 2
    assert "a checkout of the repository" in capsys.readouterr().err
