"""Reads pickles of numbers: lists, dictionaries, texts and numpy arrays. Nothing in the file is executed.

A pickle names the functions that make its objects. Only those that rebuild numpy arrays are known here; any other name
is refused before it is called.
"""

import io
import pickle
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.core import multiarray

from siren_ros.errors import InputError


def _array_of_buffer(buffer: Any, dtype: Any, shape: tuple[int, ...], order: Literal["C", "F", "A"]) -> Any:
    """How pickles of protocol 5 hold arrays of numbers."""
    return np.frombuffer(buffer, dtype=dtype).reshape(shape, order=order)


_KNOWN: Final[dict[tuple[str, str], Any]] = {
    **{
        (f"{core}.multiarray", name): getattr(multiarray, name)
        for core in ("numpy.core", "numpy._core")
        for name in ("_reconstruct", "scalar")
    },
    **{(f"{core}.numeric", "_frombuffer"): _array_of_buffer for core in ("numpy.core", "numpy._core")},
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
}


class _NumbersOnly(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """A function that rebuilds an array; UnpicklingError for anything else."""
        known = _KNOWN.get((module, name))
        if known is not None:
            return known
        if (module, name) == ("_codecs", "encode"):
            return _latin_bytes
        raise pickle.UnpicklingError(f"it asks for {module}.{name}")


def _latin_bytes(text: object, encoding: object) -> bytes:
    """How old pickles hold bytes."""
    if not isinstance(text, str) or encoding != "latin1":
        raise pickle.UnpicklingError(f"it asks for an encoding {encoding!r}")
    return text.encode("latin1")


def load_numbers(path: Path) -> Any:
    """The content of a pickle of lists, dictionaries, texts, numbers and numpy arrays.

    Raises:
        InputError: It holds anything else, is damaged, or cannot be read.
    """
    try:
        return _NumbersOnly(io.BytesIO(path.read_bytes())).load()
    except OSError as error:
        raise InputError("detections", str(path), f"a file that can be read ({error.strerror or error})") from error
    except Exception as error:  # a damaged pickle raises any of a dozen kinds
        told = f"a pickle of lists, dictionaries, texts and numpy arrays alone ({error})"
        raise InputError("detections", str(path), told) from error
