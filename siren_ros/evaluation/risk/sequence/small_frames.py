"""Films as the sequence model sees them: grey, five pictures a second, without the sky, a fifth of the size."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.film import film_frames

SmallFrames = npt.NDArray[np.uint8]
"""Grey values of a film, shape ``(T, HEIGHT, WIDTH)``."""

EVERY: Final = 2
"""Of the video's frames at 10 Hz each second one is used."""
WIDTH: Final = 160
HEIGHT: Final = 60
_VIEW: Final = (800, 600)
"""Width and height that the share below is stated for: those of the paper's front camera."""
_ROWS: Final = (200, 500)
"""Rows of it that are used: from above the horizon at 300 to where the road is 1.7 m ahead of the camera."""
_GREY: Final = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Luma of ITU-R BT.601, as H.264 stores it."""


def reduced(rgb: npt.NDArray[np.uint8]) -> SmallFrames:
    """One picture of the front camera, shape ``(height, width, 3)``, as one of shape ``(HEIGHT, WIDTH)``.

    Raises:
        InputError: A picture whose size is no multiple of the small one in the camera's proportions.
    """
    return _reduced_grey(rgb.astype(np.float32) @ _GREY)


def read_small_frames(path: Path, frames: int) -> SmallFrames:
    """Each second frame of a video, reduced.

    Args:
        path: MP4 file.
        frames: That it must have.

    Raises:
        InputError: No such video, not a video, one of another length, or of a size that cannot be reduced.
    """
    return np.stack(
        [
            _reduced_grey(frame.to_ndarray(format="gray").astype(np.float32))
            for number, frame in enumerate(film_frames(path, frames))
            if number % EVERY == 0
        ]
    )


def _reduced_grey(grey: npt.NDArray[np.float32]) -> SmallFrames:
    height, width = grey.shape
    if width % WIDTH or width * _VIEW[1] != height * _VIEW[0]:
        raise InputError("video", f"{width} x {height} pixels", "a multiple of 160 x 120")
    first, last = (row * height // _VIEW[1] for row in _ROWS)
    block = width // WIDTH
    parts = grey[first:last].reshape(HEIGHT, block, WIDTH, block)
    return np.rint(parts.mean(axis=(1, 3))).astype(np.uint8)


def stacked(films: Sequence[SmallFrames]) -> SmallFrames:
    """Films of equal length as one array, shape ``(N, T, HEIGHT, WIDTH)``."""
    return np.stack(list(films))
