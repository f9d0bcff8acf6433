"""Loops over arrays, compiled to machine code by numba and kept in its cache beside the source."""

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numba
import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher

Function = TypeVar("Function", bound=Callable[..., Any])
_FROZEN: Final = (int, float, str, tuple, np.generic, types.ExternalFunction)
"""Kinds of values that compiled code holds as they were when it was compiled."""


def compiled(function: Function) -> Function:
    """Compile a loop over arrays at its first call; IEEE arithmetic in the written order, without the GIL.

    The cached code holds the compiled functions that it calls and the values of constants, also those of other files,
    and numba looks for changes in the function's own file alone. So the cache's name says what was taken from
    elsewhere; functions of other files must be called by a name of this one, not as a module's attribute.
    """
    if taken := _taken(function):
        function.__qualname__ += "_" + hashlib.blake2b("\n".join(taken).encode(), digest_size=6).hexdigest()
    dispatcher = numba.njit(nogil=True, cache=True, fastmath=False, error_model="numpy")(function)
    return cast("Function", dispatcher)


def _taken(function: Callable[..., Any]) -> list[str]:
    """What compiled code holds beside a function's own lines: files of the functions it calls, values of constants."""
    found = []
    names = function.__globals__
    for name in function.__code__.co_names:
        value = names.get(name)
        if isinstance(value, Dispatcher):
            found += [name, _content(value.py_func.__code__.co_filename), *_taken(value.py_func)]
        elif isinstance(value, _FROZEN):
            found.append(f"{name} {value!r}")
    return found


@cache
def _content(file: str) -> str:
    return hashlib.blake2b(Path(file).read_bytes()).hexdigest()
