"""Loops over arrays, compiled to machine code by numba and kept in its cache beside the source."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile a loop over arrays at its first call; IEEE arithmetic in the written order, without the GIL."""
    dispatcher = numba.njit(nogil=True, cache=True, fastmath=False, error_model="numpy")(function)
    return cast("Function", dispatcher)
