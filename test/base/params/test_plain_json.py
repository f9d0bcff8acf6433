"""Files of JSON and Parquet from strangers: faults are ValueErrors, and large tables are refused unread."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from siren_ros.base.params import plain_json


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
