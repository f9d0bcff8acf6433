"""The key frames of a video as JPEG, plain or with outlined vehicles."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import binary_erosion

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.film import film_frames

Picture = npt.NDArray[np.uint8]
_QUALITY: Final = 90
_LEAST_PIXELS: Final = 40
_COLOURS: Final = ((230, 60, 40), (30, 120, 230), (20, 160, 80), (220, 150, 0), (150, 60, 200), (0, 160, 170))


def video_frames(path: Path, wanted: Sequence[int], count: int) -> list[Picture]:
    """Some frames of a video, shape ``(height, width, 3)``.

    Raises:
        InputError: No such video, not a video, or one of another length.
    """
    found = {
        number: np.asarray(frame.to_ndarray(format="rgb24"), dtype=np.uint8)
        for number, frame in enumerate(film_frames(path, count))
        if number in wanted
    }
    return [found[one] for one in wanted]


def masks_of(path: Path, wanted: Sequence[int]) -> list[npt.NDArray[np.uint32]]:
    """The actors of each pixel of some key frames, shape ``(height, width)``.

    Raises:
        InputError: The file is missing or has none of them.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            return [content[f"frame_{one:03d}"] for one in wanted]
    except (OSError, ValueError, KeyError) as error:
        raise InputError("masks", str(path), f"the masks of the set ({error})") from error


def numbers_of(masks: Sequence[npt.NDArray[np.uint32]]) -> Mapping[int, int]:
    """Small numbers for the vehicles of a video, the one with the most pixels first; the smallest specks have none."""
    ids, counts = np.unique(np.concatenate([mask.ravel() for mask in masks]), return_counts=True)
    order = sorted((-int(count), int(actor)) for actor, count in zip(ids, counts, strict=True) if actor)
    return {actor: number for number, (count, actor) in enumerate(order, start=1) if -count >= _LEAST_PIXELS}


def outlined(picture: Picture, mask: npt.NDArray[np.uint32], numbers: Mapping[int, int]) -> Picture:
    """The picture with the contour of each numbered vehicle and its number above it."""
    drawn = picture.copy()
    labels = []
    for actor, number in numbers.items():
        inside = mask == actor
        if int(inside.sum()) < _LEAST_PIXELS:
            continue
        colour = _COLOURS[(number - 1) % len(_COLOURS)]
        drawn[inside & ~binary_erosion(inside, iterations=2)] = colour
        rows, columns = np.nonzero(inside)
        labels.append((float(columns.mean()), float(rows.min()), str(number), colour))
    image = Image.fromarray(drawn)
    canvas, font = ImageDraw.Draw(image), ImageFont.load_default(16)
    for x, y, text, colour in labels:
        box = canvas.textbbox((x, max(y, 18.0)), text, font=font, anchor="mb")
        canvas.rectangle((box[0] - 2, box[1] - 1, box[2] + 2, box[3] + 1), fill=colour)
        canvas.text((x, max(y, 18.0)), text, font=font, anchor="mb", fill="white")
    return np.asarray(image)


def as_jpeg(picture: Picture) -> bytes:
    """The picture encoded; the same pixels give the same bytes."""
    buffer = BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG", quality=_QUALITY)
    return buffer.getvalue()
