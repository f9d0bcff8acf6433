"""JSON and Parquet of any origin: what is wrong with them is a ValueError, and sizes are counted as they are read."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

_ROWS_AT_ONCE: Final = 1024


def load(text: str | bytes, **how: Any) -> Any:
    """The value of a JSON text; ValueError where it is none, or is nested more deeply than can be read.

    ``how`` are further arguments of ``json.loads``.
    """
    try:
        return json.loads(text, **how)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def read(path: Path) -> Any:
    """The value of a JSON file in UTF-8; ValueError as ``load``, OSError where the file cannot be read."""
    return load(path.read_text(encoding="utf-8"))


def read_table(path: Path, most_rows: int, most_row_bytes: int, columns: Sequence[str] | None = None) -> pa.Table:
    """The table of a Parquet file, whose rows and bytes are known before any of them is unpacked.

    Pages of equal values pack to thousandths: a small file may state more than the memory holds. The sizes that a file
    states of itself may be wrong, so batches are counted again as they come.

    Args:
        path: The file.
        most_rows: Of the table.
        most_row_bytes: Of a row in memory, on the mean of the rows that have been read.
        columns: Those that are read; all where there are none. Others cost nothing.

    Raises:
        ValueError: It is larger, or no Parquet file (also pyarrow's own errors).
        OSError: The file cannot be read.
    """
    with pq.ParquetFile(path, memory_map=False) as file:
        about = file.metadata
        if about.num_rows > most_rows:
            raise ValueError(f"{about.num_rows} rows, more than {most_rows}")
        known = [name for name in file.schema_arrow.names if columns is None or name in columns]
        batches, size, rows = [], 0, 0
        for batch in file.iter_batches(_ROWS_AT_ONCE, columns=known, use_threads=False):
            size, rows = size + batch.nbytes, rows + batch.num_rows
            if size > most_row_bytes * rows or rows > most_rows:
                raise ValueError(f"more than {most_row_bytes} bytes in memory for a row, or than {most_rows} rows")
            batches.append(batch)
        empty = file.schema_arrow.empty_table().select(known)
        return pa.Table.from_batches(batches, schema=empty.schema) if batches else empty
