"""The frames of a video file."""

from collections.abc import Iterator
from pathlib import Path

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
