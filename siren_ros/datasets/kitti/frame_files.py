"""KITTI files frame by frame, while an episode runs or from its bag: the same frames give the same bytes.

The standard layout is that of the object benchmark, below ``training/``: ``velodyne/NNNNNN.bin`` float32
``x y z intensity``, ``image_2/NNNNNN.png``, ``calib/``, ``label_2/``, and the paper's lines in ``label_lidar/``.
The paper's layout has ``velodyne/`` and ``label_2/`` with the paper's lines, and pictures as JPEG where there are any.
"""

import struct
import zlib
from collections import Counter
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import simplejpeg
from numpy.lib.recfunctions import structured_to_unstructured

from siren_ros.datasets.files import FileWriter
from siren_ros.datasets.kitti.labels import (
    OBJECT_TYPE,
    PAPER_README,
    KittiCamera,
    calibration_text,
    camera_labels,
    label_lines,
    label_text,
)
from siren_ros.datasets.kitti.live_export import Layout
from siren_ros.errors import InputError
from siren_ros.numerics.units import STEP_S
from siren_ros.world.carrier import GroundTruth

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_HEADER: Final = struct.Struct(">IIBBBBB")
_TRUE_COLOUR: Final = 2
_UP: Final = 2
"""Filter of every row: the difference to the row above (PNG specification, section 9)."""
_FASTEST: Final = 1
POINT_FIELDS: Final = ("x", "y", "z", "intensity")
FRAMES_FILE: Final = "frames.csv"
OBJECTS_FILE: Final = "objects.csv"
TRAINING: Final = "training"
_FRAMES_HEAD: Final = "frame,step,timestamp\n"
_OBJECTS_HEAD: Final = "frame,line,actor_id,type,is_emv,lidar_points,lidar_visibility\n"


def png_of_jpeg(jpeg: bytes) -> bytes:
    """A recorded picture, decoded, as PNG."""
    return png_bytes(simplejpeg.decode_jpeg(jpeg, colorspace="RGB"))


def png_bytes(rgb: npt.NDArray[np.uint8]) -> bytes:
    """A picture of shape ``(height, width, 3)`` as PNG (ISO/IEC 15948)."""
    height, width, _ = rgb.shape
    rows = np.ascontiguousarray(rgb).reshape(height, width * 3)
    filtered = np.empty((height, 1 + width * 3), dtype=np.uint8)
    filtered[:, 0] = _UP
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
    packer = zlib.compressobj(_FASTEST, zlib.DEFLATED, zlib.MAX_WBITS, 9, zlib.Z_RLE)
    packed = packer.compress(filtered.data) + packer.flush()
    header = _HEADER.pack(width, height, 8, _TRUE_COLOUR, 0, 0, 0)
    return _SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", packed) + _chunk(b"IEND", b"")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))


@dataclass(frozen=True)
class KittiFrame:
    """Everything of one frame."""

    step: int
    points: npt.NDArray[np.void]
    """Sweep with at least the fields x, y, z (metres, ``lidar`` frame), intensity (0–1) and instance (actor id)."""
    truth: GroundTruth
    jpeg: bytes | None = None


class KittiFrames:
    """Writes frames as they come."""

    def __init__(self, files: FileWriter, layout: Layout, camera: KittiCamera | None) -> None:
        """Begins the files that all frames share.

        Raises:
            InputError: The standard layout without a camera, or a place that cannot be written.
        """
        if layout is Layout.KITTI and camera is None:
            raise InputError("layout", layout.value, "paper, or a suite with a front camera")
        self._files = files
        self._layout = layout
        self._camera = camera
        self.frames = 0
        """Number of frames written."""
        self.classes: Counter[str] = Counter()
        """Number of labels by class."""
        files.append(FRAMES_FILE, _FRAMES_HEAD)
        if layout is Layout.PAPER:
            files.write("README.md", PAPER_README.encode())
        else:
            files.append(OBJECTS_FILE, _OBJECTS_HEAD)
            for name in ("train", "val", "test", "trainval"):
                files.append(f"ImageSets/{name}.txt", "")

    def write(self, frame: KittiFrame) -> None:
        """Writes one frame. In the standard layout a frame without a picture is left out.

        Raises:
            InputError: The sweep lacks a field, or a file cannot be written.
        """
        number = f"{self.frames:06d}"
        if self._layout is Layout.PAPER:
            self._write_paper(number, frame)
        elif not self._write_standard(number, frame):
            return
        self.frames += 1
        self._files.append(FRAMES_FILE, f"{number},{frame.step},{frame.step * STEP_S:.2f}\n")

    def _write_paper(self, number: str, frame: KittiFrame) -> None:
        lines = label_text(frame.truth)
        self.classes[OBJECT_TYPE] += lines.count("\n")
        self._files.write(f"velodyne/{number}.bin", velodyne_bytes(frame.points))
        self._files.write(f"label_2/{number}.txt", lines.encode())
        if self._camera is not None and frame.jpeg is not None:
            self._files.write(f"image_2/{number}.jpg", frame.jpeg)
            self._files.write(f"calib/{number}.txt", calibration_text(self._camera).encode())

    def _write_standard(self, number: str, frame: KittiFrame) -> bool:
        jpeg, camera = frame.jpeg, self._camera
        if jpeg is None or camera is None:
            return False
        labels = camera_labels(frame.truth, frame.points, camera)
        self.classes.update(labels.types())
        objects = []
        for line, (row, kind) in enumerate(zip(labels.rows.tolist(), labels.types(), strict=True)):
            truth = frame.truth
            who = f"{truth.actor_id[row]},{kind},{int(truth.is_emv[row])},{truth.lidar_points[row]}"
            objects.append(f"{number},{line},{who},{labels.visible[line]:.3f}\n")
        write = self._files.write
        write(f"{TRAINING}/image_2/{number}.png", lambda: png_of_jpeg(jpeg))
        write(f"{TRAINING}/velodyne/{number}.bin", velodyne_bytes(frame.points))
        write(f"{TRAINING}/calib/{number}.txt", calibration_text(camera).encode())
        write(f"{TRAINING}/label_2/{number}.txt", label_lines(labels).encode())
        write(f"{TRAINING}/label_lidar/{number}.txt", label_text(frame.truth).encode())
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
