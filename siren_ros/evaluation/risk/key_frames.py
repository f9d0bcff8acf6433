"""The frames of a video that a model is shown."""

from collections.abc import Sequence
from typing import Final

from siren_ros.errors import InputError

KEY_FRAMES: Final = 9
BATCH: Final = 8


def key_frames(frames: int) -> tuple[int, ...]:
    """Nine uniform key frames, first and last included: 0, 23, 47, …, 189 of 190.

    Their number and places are this project's choice; the paper does not say which frames its models see.

    Raises:
        InputError: A video with fewer frames than that.
    """
    if frames < KEY_FRAMES:
        raise InputError("frames", frames, f"a video of {KEY_FRAMES} frames or more")
    return tuple((frames - 1) * number // (KEY_FRAMES - 1) for number in range(KEY_FRAMES))


def batches(frames: Sequence[int]) -> tuple[tuple[int, ...], ...]:
    """The key frames of each question: eight and one, this project's way to the paper's two predictions for a video."""
    return tuple(tuple(frames[first : first + BATCH]) for first in range(0, len(frames), BATCH))
