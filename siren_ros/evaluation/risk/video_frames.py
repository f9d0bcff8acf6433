"""The frames of a video file, and which of them a model is shown."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import av

from siren_ros.errors import InputError


def film_frames(path: Path, count: int) -> Iterator[av.VideoFrame]:
    """Decodes a video, frame by frame.

    Args:
        path: MP4 file.
        count: Frames that it must have.

    Raises:
        InputError: No such video, not a video, or one of another length, which is known after the last frame.
    """
    decoded = 0
    try:
        with av.open(str(path)) as container:
            for frame in container.decode(video=0):
                decoded += 1
                yield frame
    except (OSError, IndexError, av.FFmpegError) as error:
        raise InputError("video", str(path), f"an MP4 file ({error})") from error
    if decoded != count:
        raise InputError("video", f"{path}: {decoded} frames", f"{count} frames")


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
