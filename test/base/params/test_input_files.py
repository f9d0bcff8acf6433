from pathlib import Path
from typing import Any

import pytest

from siren_ros.base.params.input_files import (
    FILES_ON_DISK,
    InputFile,
    NotedFiles,
    RecordedFiles,
    files_from_json,
    files_to_json,
)
from siren_ros.errors import BagError, InputError

FILES = (InputFile("looks", "/a/ä.yaml", "fog: 1\n"), InputFile("presets", "paper", "title: ä\n"))


def test_files_come_back_from_json() -> None:
    largest = InputFile("looks", "a", "x" * 256_000)
    assert files_from_json(files_to_json((*FILES, largest))) == (*FILES, largest)


@pytest.mark.parametrize(
    "stored",
    [
        None,
        {},
        [7],
        [{"folder": "looks", "name": "a", "text": ""}],
        [{"folder": "looks", "name": "a", "sha256": "0" * 64, "text": ""}],
        [{"folder": "looks", "name": 1, "sha256": "", "text": ""}],
        files_to_json([InputFile("looks", "a", "x" * 256_001)]),
    ],
)
def test_damaged_files_are_refused(stored: Any) -> None:
    with pytest.raises(BagError):
        files_from_json(stored)


def test_recorded_files_are_found_by_folder_and_name() -> None:
    recorded = RecordedFiles(FILES)
    assert recorded.read("preset", "presets", "paper").mapping().text("title") == "ä"
    for folder, name in (("looks", "paper"), ("presets", "realistic")):
        with pytest.raises(InputError, match="presets/paper"):
            recorded.read("preset", folder, name)


def test_a_mistake_in_a_recorded_file_is_named_with_its_line() -> None:
    (file,) = files_from_json(files_to_json([InputFile("presets", "mine.yaml", "a: 1\nb: x\n")]))
    with pytest.raises(InputError, match=r"mine\.yaml of the record:2: b"):
        file.mapping().number("b", 0.0, 1.0)


def test_noted_files_are_those_that_were_read(tmp_path: Path) -> None:
    mine = tmp_path / "own.yaml"
    mine.write_text("title: own\n", encoding="utf-8")
    noted = NotedFiles(FILES_ON_DISK)
    assert noted.seen == ()
    for name in (str(mine), "paper", str(mine)):
        noted.read("preset", "presets", name)
    assert [(file.folder, file.name) for file in noted.seen] == [("presets", str(mine)), ("presets", "paper")]
    assert noted.seen[0].text == "title: own\n"


def test_a_source_says_whether_it_has_a_file() -> None:
    noted = NotedFiles(RecordedFiles(FILES))
    assert noted.has("presets", "paper")
    assert not noted.has("looks", "paper")
    assert not noted.seen
    assert NotedFiles(FILES_ON_DISK).has("looks", "clear")
