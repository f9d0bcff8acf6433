"""All cameras of the EMV and the bird's-eye view side by side, for videos."""

import math
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont, UnidentifiedImageError

from siren_ros.datasets.sources.episode_source import FRONT_CAMERA, EpisodeSource, MountedCamera, open_source
from siren_ros.errors import BagError
from siren_ros.interfaces.images import from_compressed_image
from siren_ros.pictures.moving_birdseye import BirdseyeFilm
from siren_ros.recording.bag_reader import damage_refused
from siren_ros.recording.episode_record import EpisodeRecord

CELL_PX: Final = (640, 480)
"""Width and height of one picture of the grid."""
_BIRDSEYE: Final = "bird's-eye view"
_BACKGROUND: Final = (20, 20, 20)


def grid_frames(bag: Path, record: EpisodeRecord, steps: Sequence[int]) -> Iterator[npt.NDArray[np.uint8]]:
    """Frames of the grid at some steps; a camera that makes fewer pictures shows its last one.

    Raises:
        BagError: No camera was recorded, or a picture is damaged.
    """
    film = BirdseyeFilm(record, steps)
    with open_source(bag) as source:
        cameras = ordered_cameras(source.cameras)
        if not cameras:
            raise BagError(str(bag), "an episode recorded with cameras, such as sensors:=full")
        places = grid_places(len(cameras) + 1)
        shown: dict[str, Image.Image] = {}
        pictures = _pictures(source, cameras)
        upcoming = next(pictures, None)
        for step in steps:
            while upcoming is not None and upcoming[0] <= step:
                shown.update(upcoming[1])
                upcoming = next(pictures, None)
            cells = [(_BIRDSEYE, film.frame(step)), *((one.name, shown.get(one.name)) for one in cameras)]
            yield np.asarray(_composed(cells, places))


def ordered_cameras(cameras: Sequence[MountedCamera]) -> list[MountedCamera]:
    """The front camera first, the others from the left around the back to the right."""

    def key(camera: MountedCamera) -> tuple[bool, float]:
        ahead = camera.base_from_sensor[:3, 2]
        return camera.name != FRONT_CAMERA, float(math.atan2(ahead[1], ahead[0])) % (2.0 * math.pi)

    return sorted(cameras, key=key)


def grid_places(count: int) -> list[tuple[int, int]]:
    """Column and row of each picture: as square as it gets, wider rather than higher."""
    columns = math.ceil(math.sqrt(count))
    return [(number % columns, number // columns) for number in range(count)]


def _pictures(source: EpisodeSource, cameras: Sequence[MountedCamera]) -> Iterator[tuple[int, dict[str, Image.Image]]]:
    names = {camera.topic: camera.name for camera in cameras}
    for step, held in source.messages_by_step(set(names)):
        with damage_refused(source.path):
            found = {names[topic]: from_compressed_image(message.read()) for topic, message in held.items()}
        try:
            yield step, {name: Image.open(BytesIO(jpeg)).convert("RGB") for name, jpeg in found.items()}
        except (UnidentifiedImageError, OSError) as error:
            raise BagError(str(source.path), f"JPEG images ({error})") from error


def _composed(cells: Sequence[tuple[str, Image.Image | None]], places: Sequence[tuple[int, int]]) -> Image.Image:
    width, height = CELL_PX
    columns, rows = (max(place[axis] for place in places) + 1 for axis in (0, 1))
    whole = Image.new("RGB", (columns * width, rows * height), _BACKGROUND)
    draw, font = ImageDraw.Draw(whole), ImageFont.load_default(18)
    for (name, picture), (column, row) in zip(cells, places, strict=True):
        left, top = column * width, row * height
        if picture is not None:
            scale = min(width / picture.width, height / picture.height)
            fitted = picture.resize((round(picture.width * scale), round(picture.height * scale)))
            whole.paste(fitted, (left + (width - fitted.width) // 2, top + (height - fitted.height) // 2))
        draw.text((left + 8, top + 6), name, fill=(255, 255, 255), font=font, stroke_width=2, stroke_fill=(0, 0, 0))
    return whole
