"""Pickles that are made to end the program that reads them, or to fill its memory: each is an input error."""

import pickle
import struct
from pathlib import Path

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.openpcdet_results import load_numbers


def _text(text: str) -> bytes:
    return b"X" + struct.pack("<I", len(text)) + text.encode()


def _array(dtype: bytes, shape: bytes, raw: bytes) -> bytes:
    """An array whose dtype, shape and bytes are given as opcodes."""
    new = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(K\x00tC\x01btR"
    return new + b"(K\x01" + shape + dtype + b"\x89C" + bytes([len(raw)]) + raw + b"tb"


def _dtype(name: str, state: bytes = b"") -> bytes:
    made = b"cnumpy\ndtype\n(" + _text(name) + b"K\x00K\x01tR"
    return made + state


_FIELDS = b"(" + _text("a") + b"t"
_OBJECT = _dtype("O8", b"(K\x03X\x01\x00\x00\x00|NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x3ftb")
_POINTER = _dtype(
    "V8",
    b"(K\x03X\x01\x00\x00\x00|N" + _FIELDS + b"}" + _text("a") + b"(" + _OBJECT + b"K\x00tsK\x08K\x01K\x00tb",
)
_AT = b"(K\x03X\x01\x00\x00\x00|N" + _FIELDS + b"}" + _text("a") + b"(" + _dtype("f8")
_BEYOND = _dtype("V8", _AT + b"J\x00\x00\x00\x40tsK\x08K\x01K\x00tb")
_SUB_ARRAY = _dtype("V8", b"(K\x03X\x01\x00\x00\x00|(" + _dtype("f8") + b"(J\x00\x00\x00\x40ttNNK\x08K\x01K\x00tb")
_PLAIN = _dtype("f8", b"(K\x03X\x01\x00\x00\x00<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb")
_ONE = b"(K\x01t"
_FILES = {
    "object in a field": _array(_POINTER, _ONE, b"A" * 8),
    "offset beyond the item": _array(_BEYOND, _ONE, b"A" * 8),
    "sub-array": _array(_SUB_ARRAY, _ONE, b"A" * 8),
    "huge shape": _array(_PLAIN, b"(J\x00\x00\x00\x40J\x00\x00\x00\x40t", b"A" * 8),
    "negative shape": _array(_PLAIN, b"(J\xff\xff\xff\xfft", b"A" * 8),
    "huge shape from the start": b"cnumpy.core.multiarray\n_reconstruct\n"
    b"(cnumpy\nndarray\n(J\x00\x00\x00\x40tC\x01btR0]",
    "no characters": _array(_dtype("U2"), _ONE, b"\xff" * 8),
    "bytes without end": b"\x8e" + struct.pack("<Q", 1 << 62),
    "number without end": b"\x8b" + struct.pack("<i", (1 << 31) - 1),
    "memo without end": b"Nr\xff\xff\xff\x7f",
    "deep list": b"]" * 100_000 + b"a" * 99_999,
    "deep key": b"}K\x01" + b"\x85" * 1_000_000 + b"K\x01s",
}


@pytest.mark.parametrize("what", sorted(_FILES))
def test_a_pickle_that_would_end_the_program_is_refused(tmp_path: Path, what: str) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(b"\x80\x04" + _FILES[what] + b".")
    if what == "huge shape from the start":
        assert load_numbers(path) == []
        return
    with pytest.raises(InputError, match="a pickle of lists"):
        load_numbers(path)


@pytest.mark.parametrize("protocol", [0, 2, pickle.HIGHEST_PROTOCOL])
def test_arrays_come_back_as_they_were(tmp_path: Path, protocol: int) -> None:
    given = {
        "rows": np.arange(6.0).reshape(2, 3),
        "columns": np.asfortranarray(np.arange(6, dtype=np.int32).reshape(2, 3)),
        "other order": np.arange(3, dtype=">f4"),
        "names": np.array(["car", "bus"]),
        "nothing": np.zeros((0, 7)),
        "flags": np.array([True, False]),
        "one": np.float32(0.5),
    }
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps([given], protocol))
    (found,) = load_numbers(path)
    for name, values in given.items():
        assert np.array_equal(found[name], values), name
