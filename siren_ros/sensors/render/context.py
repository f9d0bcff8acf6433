"""An OpenGL context without a window."""

from typing import Any

import moderngl

from siren_ros.world.errors import SirenError


class RendererUnavailableError(SirenError):
    """This machine has no OpenGL 3.3 through EGL."""


def open_context() -> moderngl.Context:
    """A context of its own; everything that uses it must run in the thread that calls this.

    Raises:
        RendererUnavailableError: EGL or OpenGL is missing; the message says what to install.
    """
    try:
        options: dict[str, Any] = {"require": 330, "backend": "egl"}
        return moderngl.create_standalone_context(**options)
    except Exception as error:  # moderngl and glcontext raise bare Exception where libEGL is absent
        message = f"cameras need OpenGL 3.3 through EGL (Debian: libegl1 and libgl1-mesa-dri): {error}"
        raise RendererUnavailableError(message) from error
