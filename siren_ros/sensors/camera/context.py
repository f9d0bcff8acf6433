"""An OpenGL context without a window. It draws while the caller does something else."""

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import glcontext
import moderngl

from siren_ros.errors import SirenError

_MESA: Final = {"mesa_glthread": "true", "MESA_DEBUG": "silent"}
"""Mesa's own thread for the commands (docs.mesa3d.org/envvars.html): without it, software drawing transforms the scene
in the calling thread, with the interpreter's lock held. Mesa would say on stderr that the option is not its default."""


class RendererUnavailableError(SirenError):
    """This machine has no OpenGL 3.3 through EGL."""


class DrawingContext:
    """A context of its own. Everything that uses it must run in the thread that makes it."""

    def __init__(self) -> None:
        """Open it.

        Raises:
            RendererUnavailableError: EGL or OpenGL is missing; the message says what to install.
        """
        try:
            with _set_where_unset(_MESA):
                own = glcontext.get_backend_by_name("egl")(mode="standalone", glversion=330)
            options: dict[str, Any] = {"require": 330, "context": own}
            self.gl: moderngl.Context = moderngl.create_context(**options)
        except Exception as error:  # moderngl and glcontext raise bare Exception where libEGL is absent
            message = f"cameras need OpenGL 3.3 through EGL (Debian: libegl1 and libgl1-mesa-dri): {error}"
            raise RendererUnavailableError(message) from error
        self._flush = ctypes.CFUNCTYPE(None)(own.load("glFlush"))
        self._present = ctypes.CFUNCTYPE(ctypes.c_void_p)(own.load("eglGetCurrentContext"))
        self._handle = self._present()

    def use(self) -> None:
        """Make it the thread's current context, unless it is already: a change would wait for all drawing."""
        if self._present() != self._handle:
            self.gl.mglo.__enter__()

    def flush(self) -> None:
        """Start all pending drawing and do not wait for it."""
        self._flush()


@contextmanager
def _set_where_unset(variables: dict[str, str]) -> Iterator[None]:
    added = [name for name in variables if name not in os.environ]
    os.environ.update({name: variables[name] for name in added})
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]
