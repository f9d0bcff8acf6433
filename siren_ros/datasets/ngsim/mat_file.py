"""MATLAB files whose bytes depend on their content alone."""

import io
from typing import Any, Final

from scipy.io import savemat

_HEADER_BYTES: Final = 116
_HEADER: Final = b"MATLAB 5.0 MAT-file, written by SIREN"
"""scipy writes the time there."""


def mat_bytes(content: dict[str, Any]) -> bytes:
    """A MATLAB 5 file."""
    buffer = io.BytesIO()
    savemat(buffer, content, do_compression=True)
    data = bytearray(buffer.getvalue())
    data[:_HEADER_BYTES] = _HEADER.ljust(_HEADER_BYTES)
    return bytes(data)
