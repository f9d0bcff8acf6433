"""The list of changes that nobody could notice is of lines that are there."""

from collections import Counter

from repository import REPOSITORY

from mutants.report import load_equivalents

EQUIVALENTS = load_equivalents(REPOSITORY / "tools" / "mutants" / "equivalent.yaml")


def test_each_change_is_of_a_line_of_its_file_and_has_its_reason() -> None:
    assert len(EQUIVALENTS) > 10
    for entry in EQUIVALENTS:
        lines = {line.strip() for line in (REPOSITORY / entry.file).read_text(encoding="utf-8").splitlines()}
        assert entry.was in lines, entry
        assert entry.becomes != entry.was
        assert entry.why


def test_no_change_is_listed_twice() -> None:
    assert max(Counter(EQUIVALENTS).values()) == 1


def test_without_a_list_there_is_none() -> None:
    assert load_equivalents(REPOSITORY / "no_such.yaml") == []
