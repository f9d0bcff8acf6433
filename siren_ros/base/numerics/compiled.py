"""Compiles loops over arrays to machine code with numba, and has the scalar arithmetic that these loops call.

``geometry`` has the same for arrays.
"""

import hashlib
import logging
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numba
import numpy as np
from numba import types
from numba.core import event
from numba.core.dispatcher import Dispatcher

from siren_ros.base.params.folders import is_writable, user_folder

if not is_writable(Path(__file__).with_name("__pycache__")):
    os.environ.setdefault("NUMBA_CACHE_DIR", str(user_folder(".cache/siren/numba")))

# isort: split

Array = Any
"""A numpy array; numba compiles for the element types that it is given."""
X, Y, Z = range(3)
"""Columns of points. A layout with more columns names them where it is described."""
YAW: Final = 2
"""Column of bodies after ``X`` and ``Y``."""
Function = TypeVar("Function", bound=Callable[..., Any])
_FROZEN: Final = (int, float, str, tuple, np.generic, types.ExternalFunction)
"""Kinds of values that compiled code contains as constants from the time of its compilation."""


class _Told(event.Listener):
    """Reports once per process that loops are compiled, because a first call takes tens of seconds."""

    told = False

    def on_start(self, _: event.Event) -> None:
        if not self.told:
            self.told = True
            logging.getLogger("siren_ros").info("compiling loops; later processes have them from the cache")

    def on_end(self, _: event.Event) -> None:
        """Called at the end of a compilation; nothing is reported."""


event.register("numba:compile", _Told())  # type: ignore[no-untyped-call] # numba's own


def compiled(function: Function) -> Function:
    """Compile a loop over arrays at its first call; IEEE arithmetic in the written order, without the GIL.

    The cached code contains the compiled functions that it calls and the values of constants, also those of other
    files, and the order of the fields of named tuples; numba looks for changes in the function's own file alone. The
    name of the cache therefore contains a hash of everything taken from other files. Import such functions by name: a
    module's attribute is not seen.
    """
    if taken := _taken(function):
        function.__qualname__ += "_" + hashlib.blake2b("\n".join(taken).encode(), digest_size=6).hexdigest()
    dispatcher = numba.njit(nogil=True, cache=True, fastmath=False, error_model="numpy")(function)
    return cast("Function", dispatcher)


def _taken(function: Callable[..., Any]) -> list[str]:
    """What compiled code contains besides the function itself: functions, constants, and the fields of named tuples."""
    parts = []
    names = function.__globals__
    named: dict[str, Any] = {name: names.get(name) for name in function.__code__.co_names}
    for name, value in (named | function.__annotations__).items():
        if isinstance(value, Dispatcher):
            parts += [name, _content(value.py_func.__code__.co_filename), *_taken(value.py_func)]
        elif isinstance(value, _FROZEN):
            parts.append(f"{name} {value!r}")
        elif hasattr(value, "_fields"):
            parts.append(f"{name} {value._fields}")
    return parts


@cache
def _content(file: str) -> str:
    return hashlib.blake2b(Path(file).read_bytes()).hexdigest()


@compiled
def wrapped_rad(angle_rad: float) -> float:
    """Wrap an angle to (−π, π]."""
    angle = (angle_rad + np.pi) % (2.0 * np.pi) - np.pi
    return np.pi if angle == -np.pi else angle


@compiled
def within(value: float, low: float, high: float) -> float:
    """Limit a value to a range."""
    return min(max(value, low), high)


Pose = tuple[float, float, float, float]
"""A pose: x and y of the centre, cosine and sine of the yaw."""
COS, SIN = 2, 3
"""Columns of poses after ``X`` and ``Y``."""


@compiled
def box_gap_m(a: Pose, b: Pose, a_length: float, a_width: float, b_length: float, b_width: float) -> float:
    """Largest gap along a separating axis of two boxes with half lengths and half widths (separating axis theorem).

    It is negative where they overlap, then by the depth, and else a lower bound of their distance.
    """
    dx, dy = b[0] - a[0], b[1] - a[1]
    cos, sin = abs(a[2] * b[2] + a[3] * b[3]), abs(a[2] * b[3] - a[3] * b[2])
    gap = abs(a[2] * dx + a[3] * dy) - (a_length + cos * b_length + sin * b_width)
    gap = max(gap, abs(a[2] * dy - a[3] * dx) - (a_width + sin * b_length + cos * b_width))
    gap = max(gap, abs(b[2] * dx + b[3] * dy) - (b_length + cos * a_length + sin * a_width))
    return max(gap, abs(b[2] * dy - b[3] * dx) - (b_width + sin * a_length + cos * a_width))
