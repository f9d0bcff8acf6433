"""Makes videos of recorded episodes: one camera, a grid of cameras or the bird's-eye view, as H.264 in MP4.

They show ten frames a second of simulated time.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from typing import Final

import av
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont, UnidentifiedImageError

from siren_ros.base.numerics.units import STEP_NS, STEP_S, step_of_time_ns, steps_from_s
from siren_ros.data.episode_source import FRONT_CAMERA, MountedCamera, open_source
from siren_ros.data.interfaces.measurements import from_compressed_image
from siren_ros.data.interfaces.topics import IMAGE_COMPRESSED
from siren_ros.data.recording.bag_reader import BagMessage, damage_refused, open_bag, read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import BagError, InputError, whole_file
from siren_ros.scoring.pictures.moving_birdseye import BirdseyeFilm

CELL_PX: Final = (640, 480)
"""Width and height of one picture of the grid."""
_BIRDSEYE: Final = "bird's-eye view"
_BACKGROUND: Final = (20, 20, 20)
FRAME_RATE_HZ: Final = 10
"""Rate of the paper's videos and logged states."""
FRAME_STEPS: Final = round(1.0 / (FRAME_RATE_HZ * STEP_S))
_ENCODER: Final = "libx264"
CRF: Final = 20
"""H.264's constant rate factor of videos: almost no visible loss."""
_MAX_CRF: Final = 51
_LEAST_WIDTH_PX: Final = 64
_OPTIONS: Final = {
    "preset": "veryfast",
    "threads": "1",  # the stream contains this number, and equal episodes must give equal bytes
    "mbtree": "0",  # x264's code for it reads uninitialised memory, so that equal frames sometimes gave other bytes
}
_WITHIN: Final = "a time before the end of {}"
Frame = npt.NDArray[np.uint8]


def grid_frames(bag: Path, record: EpisodeRecord, steps: Sequence[int]) -> Iterator[npt.NDArray[np.uint8]]:
    """Frames of the camera grid at some steps; a camera with a lower rate shows its last picture.

    Raises BagError where no camera was recorded, or a picture is damaged.
    """
    film = BirdseyeFilm(record, steps)
    with open_source(bag) as source:
        cameras = ordered_cameras(source.cameras)
        if not cameras:
            raise BagError(str(bag), "an episode recorded with cameras, such as sensors:=full")
        places = grid_places(len(cameras) + 1)
        shown: dict[str, Image.Image] = {}
        names = {camera.topic: camera.name for camera in cameras}
        pictures = source.messages_by_step(set(names))
        upcoming = next(pictures, None)
        for step in steps:
            while upcoming is not None and upcoming[0] <= step:
                shown.update({names[topic]: _decoded(message) for topic, message in upcoming[1].items()})
                upcoming = next(pictures, None)
            cells = [(_BIRDSEYE, film.frame(step)), *((camera.name, shown.get(camera.name)) for camera in cameras)]
            yield np.asarray(_composed(cells, places))


def ordered_cameras(cameras: Sequence[MountedCamera]) -> list[MountedCamera]:
    """Sort cameras: the front one first, the others from left over rear to right."""

    def key(camera: MountedCamera) -> tuple[bool, float]:
        ahead = camera.base_from_sensor[:3, 2]
        return camera.name != FRONT_CAMERA, float(math.atan2(ahead[1], ahead[0])) % (2.0 * math.pi)

    return sorted(cameras, key=key)


def grid_places(count: int) -> list[tuple[int, int]]:
    """Column and row of each picture, in a nearly square grid that is wider than high."""
    columns = math.ceil(math.sqrt(count))
    return [(number % columns, number // columns) for number in range(count)]


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


class View(StrEnum):
    """View of a video."""

    BIRDSEYE = "birdseye"
    FRONT = "front"
    GRID = "grid"


@dataclass(frozen=True)
class Coding:
    """Size of a video in pixels and bytes."""

    width_px: int | None = None
    """Wider frames are scaled down to this width; None keeps their size."""
    crf: int = CRF
    """H.264's constant rate factor: 0 is lossless, 51 the worst; six more halve the size approximately."""

    def __post_init__(self) -> None:
        if self.width_px is not None and self.width_px < _LEAST_WIDTH_PX:
            raise InputError("width", self.width_px, f"a number of pixels from {_LEAST_WIDTH_PX} on")
        if not 0 <= self.crf <= _MAX_CRF:
            raise InputError("crf", self.crf, f"0 to {_MAX_CRF}")

    def scaled(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """Scale frames to the requested width."""
        for pixels in frames:
            height, width = pixels.shape[:2]
            if self.width_px is None or width <= self.width_px:
                yield pixels
            else:
                size = (self.width_px, round(height * self.width_px / width))
                yield np.asarray(Image.fromarray(pixels).resize(size, Image.Resampling.LANCZOS))


AS_DRAWN: Final = Coding()


def save_video(
    bag: Path, view: View, path: Path, frames: int | None = None, start_s: float = 0.0, coding: Coding = AS_DRAWN
) -> int:
    """Make an MP4 file of an episode; returns its number of frames. The same bag gives the same bytes.

    ``frames`` is their number, from the simulated time ``start_s`` on; without it, to the end.

    Raises:
        BagError: The bag is no episode, or it has no front camera at the video's rate and ``view`` is FRONT.
        InputError: The episode has fewer frames than asked for, or the file cannot be written.
    """
    if path.suffix.lower() != ".mp4":
        raise InputError("out", str(path), "a file name that ends in .mp4")
    if frames is not None and frames < 1:
        raise InputError("frames", frames, "a number from 1 on")
    if not 0.0 <= start_s < float("inf"):
        raise InputError("start_s", start_s, "a time from 0 on")
    if view is View.FRONT:
        return write_video(path, _front_frames(bag, frames, steps_from_s(start_s)), coding)
    record = read_episode(bag)
    first = -(-steps_from_s(start_s) // FRAME_STEPS) * FRAME_STEPS
    if first >= record.steps:
        raise InputError("start_s", start_s, _WITHIN.format(bag))
    steps = _first_of(range(first, record.steps, FRAME_STEPS), frames, bag)
    if view is View.GRID:
        return write_video(path, grid_frames(bag, record, steps), coding)
    return write_video(path, BirdseyeFilm(record, steps).frames(), coding)


def _first_of(available: range, frames: int | None, bag: Path) -> range:
    """The first ``frames`` of the available frames; all if None."""
    if frames is not None and frames > len(available):
        raise InputError("frames", frames, f"at most {len(available)}, which {bag} has from there on")
    return available if frames is None else available[:frames]


def _front_frames(bag_path: Path, frames: int | None, first_step: int) -> Iterator[Frame]:
    """Images of the front camera at the video's rate."""
    topic = IMAGE_COMPRESSED.of_sensor(FRONT_CAMERA, 1).name
    with open_bag(bag_path) as bag:
        if topic not in bag.type_names:
            raise BagError(str(bag_path), f"an episode recorded with the camera {FRONT_CAMERA}, such as sensors:=front")
        times = [message.time_ns for message in bag.messages({topic})]
        on_grid = [time for time in times if time % (FRAME_STEPS * STEP_NS) == 0]
        if not np.array_equal(np.diff(on_grid), np.full(len(on_grid) - 1, FRAME_STEPS * STEP_NS)):
            raise BagError(
                str(bag_path), f"an episode whose front camera made an image at every {FRAME_RATE_HZ} Hz tick"
            )
        later = [time for time in on_grid if step_of_time_ns(time) >= first_step]
        if not later:
            raise InputError("start_s", first_step * STEP_S, _WITHIN.format(bag_path))
        chosen = frozenset(later[: len(_first_of(range(len(later)), frames, bag_path))])
        for message in bag.messages({topic}):
            if message.time_ns in chosen:
                yield np.asarray(_decoded(message))


def _decoded(message: BagMessage) -> Image.Image:
    with damage_refused(message.bag.path):
        jpeg = from_compressed_image(message.read())
        try:
            return Image.open(BytesIO(jpeg)).convert("RGB")
        except (UnidentifiedImageError, OSError) as error:
            raise BagError(str(message.bag.path), f"JPEG images ({error})") from error


def write_video(path: Path, frames: Iterable[Frame], coding: Coding = AS_DRAWN) -> int:
    """Encode frames of equal size (RGB, ``(H, W, 3)``), without an odd last row or column; returns their number.

    Raises InputError where there is no frame, or the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            count = _encode(file, coding.scaled(frames), coding.crf)
            if count == 0:
                raise InputError("frames", 0, "at least one frame")
    except (OSError, av.FFmpegError) as error:
        raise InputError("out", str(path), f"a place that can be written ({error.strerror or error})") from error
    return count


def _encode(path: Path, frames: Iterable[Frame], crf: int) -> int:
    count = 0
    container_options = {"movflags": "+faststart", "fflags": "+bitexact"}
    with av.open(str(path), "w", format="mp4", options=container_options) as container:
        stream = container.add_stream(_ENCODER, rate=Fraction(FRAME_RATE_HZ), options={"crf": str(crf), **_OPTIONS})
        stream.pix_fmt = "yuv420p"
        for count, pixels in enumerate(frames, start=1):
            even = np.ascontiguousarray(pixels[: pixels.shape[0] // 2 * 2, : pixels.shape[1] // 2 * 2])
            if count == 1:
                stream.height, stream.width = even.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))
        if count:
            container.mux(stream.encode())
    return count
