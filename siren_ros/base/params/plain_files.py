"""Reads JSON, Parquet, arrays and trained networks from untrusted sources: sizes are limited, faults are errors.

A fault of JSON, Parquet or arrays is a ValueError. A trained network is an ONNX file with its card beside it.
"""

import hashlib
import json
import os
import re
import sys
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from siren_ros.errors import InputError, whole_file, writing

_NO_NPZ: Final = (KeyError, TypeError, EOFError, MemoryError, RuntimeError, zipfile.BadZipFile, zlib.error)
_ROWS_AT_ONCE: Final = 1024
_HALF: Final = re.compile(r"\\u[dD][89a-fA-F]")
"""Matches the start of an escaped surrogate, one half of a character."""


def load_json(text: str | bytes, **how: Any) -> Any:
    r"""Parse JSON; ValueError if it is invalid, nested too deeply, or contains lone surrogates.

    A lone surrogate (``"\ud800"``) has no UTF-8: no file, page or terminal could take the text that it is in.
    ``how`` are further arguments of ``json.loads``.
    """
    try:
        text = text.decode(json.detect_encoding(text)) if isinstance(text, bytes) else text
        value = json.loads(text, **how)
        if not text.isascii() or _HALF.search(text):
            json.dumps(value, ensure_ascii=False, default=str).encode()
    except RecursionError:
        raise ValueError("nested too deeply") from None
    return value


def read_json(path: Path) -> Any:
    """Read a JSON file in UTF-8; ValueError as ``load``, OSError if the file cannot be read."""
    return load_json(path.read_text(encoding="utf-8"))


def read_arrays(path: Path, most_bytes: int) -> dict[str, Any]:
    """Read the arrays of an ``.npz`` file by name. Nothing in it is executed, and its size in memory is checked first.

    Raises:
        ValueError: It states more than ``most_bytes``, holds objects or texts of no characters, or is no such file.
        OSError: The file cannot be read.
    """
    try:
        with zipfile.ZipFile(path) as members:
            if (size := sum(member.file_size for member in members.infolist())) > most_bytes:
                raise ValueError(f"{size} bytes, more than {most_bytes}")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
    except _NO_NPZ as error:
        raise ValueError(f"no .npz file ({error})") from error
    for name, values in arrays.items():
        order = ">" if values.dtype.str[0] == ">" else "<"
        if values.dtype.kind == "U" and (np.frombuffer(values.tobytes(), f"{order}u4") > sys.maxunicode).any():
            raise ValueError(f"{name} has a text of no characters")
    return arrays


def read_table(path: Path, most_rows: int, most_row_bytes: int, columns: Sequence[str] | None = None) -> pa.Table:
    """Read a Parquet file; rows and bytes are checked before data are unpacked.

    Pages of equal values pack to thousandths: a small file may state more than the memory holds. The sizes that a file
    states of itself may be wrong, so batches are counted again as they come.

    Args:
        path: The file.
        most_rows: Most rows of the table.
        most_row_bytes: Most bytes of a row in memory, as a mean of the rows read so far.
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


@dataclass(frozen=True)
class NetworkFile:
    """A network that can be run, with its card."""

    session: Any
    card: Mapping[str, Any]


def card_path(network: Path) -> Path:
    """Path of a network's card, beside the network."""
    return network.with_suffix(".json")


def open_network(path: Path) -> NetworkFile:
    """Load a network. An ONNX file contains only arithmetic; nothing in it is executed as code.

    Raises:
        InputError: No such file, no card, or weights that are not the card's or cannot be run.
    """
    try:
        weights = path.read_bytes()
        card = read_json(card_path(path))
    except (OSError, ValueError) as error:
        raise InputError("checkpoint", str(path), f"an ONNX file with its card {card_path(path).name}") from error
    if not isinstance(card, dict) or card.get("sha256") != hashlib.sha256(weights).hexdigest():
        raise InputError("checkpoint", str(path), "the weights that its card describes (another hash)")
    import onnxruntime  # noqa: PLC0415 - it starts threads, and a process with threads must not fork

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    # Episodes run in parallel processes, where further threads would only compete.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        session = onnxruntime.InferenceSession(weights, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # errors of onnxruntime have no other common class
        raise InputError("checkpoint", str(path), f"a network that onnxruntime can run ({error})") from error
    return NetworkFile(session, card)


def write_network(path: Path, weights: bytes, card: Mapping[str, Any]) -> None:
    """Write weights and card; the card contains the weights' SHA-256.

    Raises:
        InputError: The folder cannot be written.
    """
    with writing(path.parent, "folder"):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            file.write_bytes(weights)
        with whole_file(card_path(path)) as file:
            file.write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")


def sha256_of_file(path: Path) -> str:
    """SHA-256 of a file's bytes, as hexadecimal digits; OSError if it cannot be read."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, or of the names and hashes of all files below a folder."""
    if not path.is_dir():
        return sha256_of_file(path)
    files = (file for file in sorted(path.rglob("*")) if file.is_file())
    names = "".join(f"{file.relative_to(path).as_posix()}\0{sha256_of_file(file)}\n" for file in files)
    return hashlib.sha256(os.fsencode(names)).hexdigest()
