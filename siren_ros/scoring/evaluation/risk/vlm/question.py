"""Builds the question to a model: key frames as JPEG, plain or with outlined vehicles, and the text.

The words are our own; SeeUnsafe's procedure is followed where the paper names it.
"""

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import binary_erosion

from siren_ros.base.params import plain_json
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.video_set import film_frames

Picture = npt.NDArray[np.uint8]
_QUALITY: Final = 90
_LEAST_PIXELS: Final = 40
_MOST_MASK_BYTES: Final = 1 << 30
"""Largest size of a video's masks in memory; nine key frames of 1280 by 720 pixels have 33 MB."""
_COLOURS: Final = ((230, 60, 40), (30, 120, 230), (20, 160, 80), (220, 150, 0), (150, 60, 200), (0, 160, 170))


def video_frames(path: Path, numbers: Sequence[int], count: int) -> list[Picture]:
    """Some frames of a video, shape ``(height, width, 3)``.

    Raises:
        InputError: No such video, not a video, or one of another length.
    """
    pictures = {
        number: np.asarray(frame.to_ndarray(format="rgb24"), dtype=np.uint8)
        for number, frame in enumerate(film_frames(path, count))
        if number in numbers
    }
    return [pictures[number] for number in numbers]


def masks_of(path: Path, numbers: Sequence[int]) -> list[npt.NDArray[np.uint32]]:
    """Masks with the actor of each pixel, for some key frames, shape ``(height, width)``.

    Raises:
        InputError: The file is missing or has none of them.
    """
    try:
        content = plain_json.read_arrays(path, _MOST_MASK_BYTES)
        return [content[f"frame_{number:03d}"] for number in numbers]
    except (OSError, ValueError, KeyError) as error:
        raise InputError("masks", str(path), f"the masks of the set ({error})") from error


def numbers_of(masks: Sequence[npt.NDArray[np.uint32]]) -> Mapping[int, int]:
    """Small numbers for the vehicles of a video, most pixels first; the smallest vehicles get none."""
    ids, counts = np.unique(np.concatenate([mask.ravel() for mask in masks]), return_counts=True)
    order = sorted((-int(count), int(actor)) for actor, count in zip(ids, counts, strict=True) if actor)
    return {actor: number for number, (count, actor) in enumerate(order, start=1) if -count >= _LEAST_PIXELS}


def outlined(picture: Picture, mask: npt.NDArray[np.uint32], numbers: Mapping[int, int]) -> Picture:
    """Draw the contour of each numbered vehicle into the picture, with its number above it."""
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
    """Encode the picture as JPEG; the same pixels give the same bytes."""
    buffer = BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG", quality=_QUALITY)
    return buffer.getvalue()


SYSTEM: Final = """You judge the risk of road traffic scenes. You are shown pictures from a camera that looks forward \
from an emergency vehicle on duty. The pictures are in order of time.

Choose exactly one class for what happens between the emergency vehicle and other road users in these pictures:
- Normal: nobody comes close to a crash. Vehicles that stand aside while the emergency vehicle passes slowly are normal.
- Near-Miss: a crash is close. The ways of two vehicles meet within about a second, or one of them has to brake or \
swerve hard to avoid the other, and they do not touch.
- Collision: the emergency vehicle and another vehicle touch.

Answer with one JSON object and nothing else: \
{"class": "Normal" | "Near-Miss" | "Collision", "reason": "one sentence"}"""

_MARKED: Final = (
    " Vehicles are outlined, each with its own number; the same number is the same vehicle in all pictures."
)


def question(frames: Sequence[int], *, marked: bool) -> str:
    """Text of one question, with the pictures' frame numbers in the video; a frame is 0.1 s."""
    times = ", ".join(f"{0.1 * frame:.1f}" for frame in frames)
    several = f"{len(frames)} pictures, taken at {times} s" if len(frames) > 1 else f"One picture, taken at {times} s"
    return f"{several} of the same drive; the video has a picture every 0.1 s.{_MARKED if marked else ''} Which class?"
