from pathlib import Path

import pytest

from siren_ros.errors import InputError
from siren_ros.lab.reproduction.parts import FigureFile, Part, TargetFile, inputs_sha256, read_parts, shown_minutes

PARTS = """
code:
  world: [src]
parts:
- name: town
  about: two episodes
  minutes: 12
  code: [world]
  commands: ["make --out {out}"]
  figures:
  - {file: scores.json, keep: ["S1.*"], prefix: own}
- name: models
  about: errors
  minutes: 200
  needs: [town]
  code: [world]
  files: [outside.txt]
  commands: ["score {town} --out {out}"]
  made:
  - {from: curve.png, to: docs/curve.png}
"""


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "a.py").write_text("1", encoding="utf-8")
    return tmp_path


def parts_of(repository: Path, text: str = PARTS) -> dict[str, Part]:
    file = repository / "parts.yaml"
    file.write_text(text, encoding="utf-8")
    return read_parts(file, repository)


def test_parts_are_read_in_their_order(repository: Path) -> None:
    parts = parts_of(repository)
    assert list(parts) == ["town", "models"]
    assert parts["town"].figures == (FigureFile("scores.json", ("S1.*",), "own"),)
    assert parts["models"].targets == (TargetFile("curve.png", "docs/curve.png"),)
    assert parts["models"].missing(repository) == ("outside.txt",)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("needs: [town]", "needs: [city]", "a part that stands above"),
        ("world: [src]", "world: [gone]", "a file or folder of the repository"),
        ("name: models", "name: town", "each part once"),
        ("code: [world]\n  files", "code: [moon]\n  files", "one of world"),
        ("minutes: 200", "hours: 200", "minutes"),
    ],
)
def test_mistakes_are_named(repository: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parts_of(repository, PARTS.replace(old, new))


def test_the_hash_follows_code_commands_files_and_needs(repository: Path) -> None:
    part = parts_of(repository)["models"]
    (repository / "outside.txt").write_text("x", encoding="utf-8")
    before = inputs_sha256(part, repository, ["n"])
    assert inputs_sha256(part, repository, ["n"]) == before
    assert inputs_sha256(part, repository, ["m"]) != before
    (repository / "src" / "__pycache__").mkdir()
    (repository / "src" / "__pycache__" / "a.pyc").write_text("cache", encoding="utf-8")
    assert inputs_sha256(part, repository, ["n"]) == before
    (repository / "outside.txt").write_text("y", encoding="utf-8")
    changed = inputs_sha256(part, repository, ["n"])
    assert changed != before
    (repository / "src" / "a.py").write_text("2", encoding="utf-8")
    assert inputs_sha256(part, repository, ["n"]) not in {before, changed}
    (repository / "src" / "a.py").rename(repository / "src" / "b.py")
    assert inputs_sha256(part, repository, ["n"]) not in {before, changed}


def test_durations_are_shown_for_people() -> None:
    assert [shown_minutes(value) for value in (0.2, 12.0, 200.0)] == ["1 min", "12 min", "3.3 h"]
