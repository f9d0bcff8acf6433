"""Writes KITTI files frame by frame, from a running episode or from its bag. Both give the same bytes.

The standard layout is that of the object benchmark, below ``training/``: ``velodyne/NNNNNN.bin`` float32
``x y z intensity``, ``image_2/NNNNNN.png``, ``calib/``, ``label_2/``, and the paper's lines in ``label_lidar/``.
The paper's layout has ``velodyne/`` and ``label_2/`` with the paper's lines, and pictures as JPEG where there are any.
"""

import struct
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import deflate
import numpy as np
import numpy.typing as npt
import simplejpeg
from numpy.lib.recfunctions import structured_to_unstructured

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.datasets.files import FileWriter, link, write_image_sets
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport
from siren_ros.data.datasets.kitti import labels as kitti_labels
from siren_ros.data.datasets.kitti.labels import KittiCamera
from siren_ros.data.datasets.kitti.live_export import FRAMES_FILE, FRAMES_HEAD
from siren_ros.data.record.episode_source import FRONT_CAMERA, EpisodeSource, lidar_frames, lidar_of
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.episode import KittiLayout
from siren_ros.simulation.world.carrier import GroundTruth

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_HEADER: Final = struct.Struct(">IIBBBBB")
_TRUE_COLOUR: Final = 2
_SUB: Final = 1
"""PNG filter of every row: the difference to the pixel on the left (PNG specification, section 9). On the cameras'
pictures it compresses 4 % better than the difference to the row above."""
_PIXEL_BYTES: Final = 3
_FASTEST: Final = 1
"""Compression level of libdeflate. Its bytes depend on the content alone, not on the processor."""
POINT_FIELDS: Final = ("x", "y", "z", "intensity")
OBJECTS_FILE: Final = "objects.csv"
TRAINING: Final = "training"
_TESTING: Final = "testing"
"""Folder in which KITTI has the frames of the split ``test``."""
_OBJECTS_HEAD: Final = "frame,line,actor_id,type,is_emv,lidar_points,lidar_visibility\n"


def png_of_jpeg(jpeg: bytes) -> bytes:
    """A recorded picture, decoded, as PNG."""
    return png_bytes(simplejpeg.decode_jpeg(jpeg, colorspace="RGB"))


def png_bytes(rgb: npt.NDArray[np.uint8]) -> bytes:
    """A picture of shape ``(height, width, 3)`` as PNG (ISO/IEC 15948)."""
    height, width, _ = rgb.shape
    rows = np.ascontiguousarray(rgb).reshape(height, width * 3)
    filtered = np.empty((height, 1 + width * 3), dtype=np.uint8)
    filtered[:, 0] = _SUB
    filtered[:, 1 : 1 + _PIXEL_BYTES] = rows[:, :_PIXEL_BYTES]
    np.subtract(rows[:, _PIXEL_BYTES:], rows[:, :-_PIXEL_BYTES], out=filtered[:, 1 + _PIXEL_BYTES :])
    packed = bytes(deflate.zlib_compress(filtered.tobytes(), _FASTEST))
    header = _HEADER.pack(width, height, 8, _TRUE_COLOUR, 0, 0, 0)
    return _SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", packed) + _chunk(b"IEND", b"")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))


@dataclass(frozen=True)
class KittiFrame:
    """Data of one frame."""

    step: int
    points: npt.NDArray[np.void]
    """Sweep with at least the fields x, y, z (metres, ``lidar`` frame), intensity (0–1) and instance (actor id)."""
    truth: GroundTruth
    jpeg: bytes | None = None


class KittiFrames:
    """Writes frames one after the other."""

    def __init__(self, files: FileWriter, layout: KittiLayout, camera: KittiCamera | None) -> None:
        """Write the files that all frames share.

        Raises InputError: the standard layout without a camera, or a place that cannot be written.
        """
        if layout is KittiLayout.KITTI and camera is None:
            raise InputError("layout", layout.value, "paper, or a suite with a front camera")
        self._files = files
        self._layout = layout
        self._camera = camera
        self.frames = 0
        """Number of frames written."""
        self.classes: Counter[str] = Counter()
        """Number of labels by class."""
        files.append(FRAMES_FILE, FRAMES_HEAD)
        if layout is KittiLayout.PAPER:
            files.write("README.md", kitti_labels.PAPER_README.encode())
        else:
            files.append(OBJECTS_FILE, _OBJECTS_HEAD)
            for name in ("train", "val", "test", "trainval"):
                files.append(f"ImageSets/{name}.txt", "")

    def write(self, frame: KittiFrame) -> None:
        """Writes one frame. In the standard layout a frame without a picture is left out.

        Raises InputError: the sweep lacks a field, or a file cannot be written.
        """
        number = f"{self.frames:06d}"
        if self._layout is KittiLayout.PAPER:
            self._write_paper(number, frame)
        elif not self._write_standard(number, frame):
            return
        self.frames += 1
        self._files.append(FRAMES_FILE, f"{number},{frame.step},{frame.step * STEP_S:.2f}\n")

    def _write_paper(self, number: str, frame: KittiFrame) -> None:
        lines = kitti_labels.label_text(frame.truth)
        self.classes[kitti_labels.OBJECT_TYPE] += lines.count("\n")
        self._files.write(f"velodyne/{number}.bin", velodyne_bytes(frame.points))
        self._files.write(f"label_2/{number}.txt", lines.encode())
        if self._camera is not None and frame.jpeg is not None:
            self._files.write(f"image_2/{number}.jpg", frame.jpeg)
            self._files.write(f"calib/{number}.txt", kitti_labels.calibration_text(self._camera).encode())

    def _write_standard(self, number: str, frame: KittiFrame) -> bool:
        jpeg, camera = frame.jpeg, self._camera
        if jpeg is None or camera is None:
            return False
        labels = kitti_labels.camera_labels(frame.truth, frame.points, camera)
        self.classes.update(labels.types())
        truth, objects = frame.truth, []
        for line, (row, kind) in enumerate(zip(labels.rows.tolist(), labels.types(), strict=True)):
            actor = f"{truth.actor_id[row]},{kind},{int(truth.is_emv[row])},{truth.lidar_points[row]}"
            objects.append(f"{number},{line},{actor},{labels.visible[line]:.3f}\n")
        write = self._files.write
        write(f"{TRAINING}/image_2/{number}.png", lambda: png_of_jpeg(jpeg))
        write(f"{TRAINING}/velodyne/{number}.bin", velodyne_bytes(frame.points))
        write(f"{TRAINING}/calib/{number}.txt", kitti_labels.calibration_text(camera).encode())
        write(f"{TRAINING}/label_2/{number}.txt", kitti_labels.label_lines(labels).encode())
        write(f"{TRAINING}/label_lidar/{number}.txt", kitti_labels.label_text(frame.truth).encode())
        self._files.append(OBJECTS_FILE, "".join(objects))
        for name in ("train", "trainval"):
            self._files.append(f"ImageSets/{name}.txt", f"{number}\n")
        return True


def velodyne_bytes(points: npt.NDArray[np.void]) -> bytes:
    """``x y z intensity`` of every point as little-endian float32; InputError where a field is missing."""
    names = points.dtype.names or ()
    lacking = [name for name in POINT_FIELDS if name not in names]
    if lacking:
        raise InputError("points", ", ".join(names), f"points with the fields {', '.join(POINT_FIELDS)}")
    return structured_to_unstructured(points[list(POINT_FIELDS)], dtype=np.dtype("<f4")).tobytes()


class KittiExporter:
    """Writes a frame for every step with a sweep and ground truth; the standard layout also needs a picture."""

    def __init__(self, layout: str) -> None:
        self._layout = KittiLayout(layout)

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:  # noqa: ARG002 - the interface of all formats
        """Write the frames, numbered from 0."""
        lidar, camera = lidar_of(source), source.front_camera
        kitti_camera = None if camera is None else KittiCamera(camera.model, camera.from_lidar(lidar))
        frames = KittiFrames(files, self._layout, kitti_camera)
        for frame in lidar_frames(source, cameras=() if camera is None else (camera,)):
            if frame.points is not None and frame.truth is not None:
                frames.write(KittiFrame(frame.step, frame.points, frame.truth, frame.jpegs.get(FRONT_CAMERA)))
                files.progress(frame.step * STEP_S)
        return EpisodeReport({"frames": frames.frames, "labels": frames.classes.total()}, dict(frames.classes))

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Number the frames of all episodes consecutively; the split ``test`` goes below ``testing/``."""
        first = 0
        sets: dict[str, list[int]] = {"train": [], "val": [], "test": []}
        for part in parts:
            for path in sorted(part.folder.rglob("*.*")):
                place = path.relative_to(part.folder)
                if len(path.stem) == len("000000") and path.stem.isdigit():
                    target = place.with_name(f"{int(path.stem) + first:06d}{path.suffix}")
                    if part.subset == "test" and target.parts[0] == TRAINING:
                        target = Path(_TESTING, *target.parts[1:])
                    link(path, folder / target)
            _append_table(part, folder / FRAMES_FILE, first, episode=True)
            _append_table(part, folder / OBJECTS_FILE, first, episode=False)
            count = part.report.counts["frames"]
            sets[part.subset] += range(first, first + count)
            first += count
        if self._layout is KittiLayout.PAPER:
            (folder / "README.md").write_bytes((parts[0].folder / "README.md").read_bytes())
            return
        sets["trainval"] = sorted(sets["train"] + sets["val"])
        write_image_sets(folder, sets)


def _append_table(part: EpisodePart, target: Path, first: int, *, episode: bool) -> None:
    """Append a part's table to the dataset's table, with the dataset's frame numbers."""
    source = part.folder / target.name
    if not source.exists():
        return
    new = not target.exists()
    with source.open(encoding="utf-8") as lines, target.open("a", encoding="utf-8", newline="") as out:
        head = next(lines).rstrip("\n")
        if new:
            out.write(f"{head},episode\n" if episode else f"{head}\n")
        for line in lines:
            number, rest = line.rstrip("\n").split(",", 1)
            out.write(f"{int(number) + first:06d},{rest}{',' + part.episode_id if episode else ''}\n")
