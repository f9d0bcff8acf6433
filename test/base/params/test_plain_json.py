"""Files of users: JSON within bounds, and files by their names."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from siren_ros.base.params import plain_json
from siren_ros.base.params.input_files import (
    FILES_ON_DISK,
    InputFile,
    NotedFiles,
    RecordedFiles,
    files_from_json,
    files_to_json,
)
from siren_ros.errors import BagError, InputError


@pytest.mark.parametrize("text", ["[" * 200_000, '{"a":' * 200_000, "", "{"])
def test_what_cannot_be_read_is_a_value_error(tmp_path: Path, text: str) -> None:
    path = tmp_path / "x.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"."):
        plain_json.read(path)


@pytest.mark.parametrize(
    "text", ['{"\\ud800": 1}', '["a\\uDFFF"]', '["\\udc00\\ud800"]', b'["\xed\xa0\x80"]', '["\ud800"]']
)
def test_halves_of_characters_are_refused(text: str | bytes) -> None:
    with pytest.raises(ValueError, match=r"surrogate|utf-8"):
        plain_json.load(text)


@pytest.mark.parametrize(
    "text", ['["\\ud83d\\ude91 \\\\ud800"]', '["🚑 \\\\ud800"]', '["🚑 \\\\ud800"]'.encode("utf-16")]
)
def test_whole_characters_are_read_however_they_are_written(text: str | bytes) -> None:
    assert plain_json.load(text) == ["🚑 \\ud800"]


def test_arrays_within_the_limit_are_read_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    np.savez_compressed(path, a=np.zeros(1000), b=np.array("é"))
    arrays = plain_json.read_arrays(path, 9_000)
    assert (arrays["a"].shape, str(arrays["b"])) == ((1000,), "é")
    for most, told in ((8_000, "more than 8000"), (9_000, "allow_pickle")):
        with pytest.raises(ValueError, match=told):
            plain_json.read_arrays(path, most)
        np.savez(path, a=np.array([print], dtype=object))
    for content in (b"PK no archive", b""):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"no \.npz file"):
            plain_json.read_arrays(path, 9_000)
    with pytest.raises(OSError, match="No such file"):
        plain_json.read_arrays(tmp_path / "none", 9_000)


def test_a_table_within_the_limits_is_read_and_a_larger_one_is_not(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    given = pa.table({"a": [1.0] * 5000, "b": ["x" * 100] * 5000})
    pq.write_table(given, path)
    assert plain_json.read_table(path, 5000, 200).equals(given)
    assert plain_json.read_table(path, 5000, 10, columns=["a"]).equals(given.select(["a"]))
    with pytest.raises(ValueError, match="5000 rows, more than 4999"):
        plain_json.read_table(path, 4999, 200)
    with pytest.raises(ValueError, match="bytes in memory"):
        plain_json.read_table(path, 5000, 50)


def test_an_empty_table_keeps_its_columns(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    pq.write_table(pa.table({"a": pa.array([], pa.float64())}), path)
    assert plain_json.read_table(path, 0, 0).column_names == ["a"]


def test_a_small_file_of_long_lists_is_refused_at_its_first_batch(tmp_path: Path) -> None:
    """80 MB in memory, thousandths of it in the file."""
    path = tmp_path / "x.parquet"
    pq.write_table(pa.table({"x": [[0.0] * 1000] * 10_000}), path, compression="zstd")
    assert path.stat().st_size < 200_000
    with pytest.raises(ValueError, match="bytes in memory for a row"):
        plain_json.read_table(path, 10_000, 1_000)


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
