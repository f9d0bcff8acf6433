"""Exports KITTI's object benchmark, the paper's layout of it, and OpenPCDet's custom dataset, frame by frame.

A running episode and its bag give the same bytes. KITTI's layout, below ``training/``: ``velodyne/NNNNNN.bin`` float32
``x y z intensity``, ``image_2/NNNNNN.png``, ``calib/``, ``label_2/``, and the paper's lines in ``label_lidar/``. The
paper's layout has ``velodyne/`` and ``label_2/`` with the paper's lines, and pictures as JPEG where there are any.

KITTI's labels are in the camera's frame, with the centre of the bottom face and boxes in the picture. Source: the
development kit of the object benchmark (Geiger, Lenz, Urtasun 2012), ``readme.txt``.

The paper's label lines (supplement, "Data Formats and Coordinate Conventions") are
``type trunc occl alpha x1 y1 x2 y2 h w l lx ly lz heading`` in the LiDAR frame. That frame is right-handed with y to
the left: CARLA's lateral axis and headings are negated, which gives this project's own ``lidar`` frame. Positions are
volume centres. The words are KITTI's but their meaning is not: a KITTI reader takes these positions for positions in
the camera's frame.

OpenPCDet's layout and labels: https://github.com/open-mmlab/OpenPCDet, ``docs/CUSTOM_DATASET_TUTORIAL.md``.
``points/NNNNNN.npy`` has the shape ``(N, 4)``: x, y, z, intensity. ``labels/NNNNNN.txt`` has lines
``x y z dx dy dz heading Name`` in the same frame (x forward, y left, z up). The centre is the volume's, the heading
counter-clockwise from x.
"""

import io
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

from siren_ros.base.numerics.arrays import Codes, Floats, Matrix, Rows
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.datasets.files import FRAMES_FILE, FRAMES_HEAD, FileWriter, link, number_text, write_image_sets
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport
from siren_ros.data.datasets.visibility import box_corners, image_boxes, lidar_visibility
from siren_ros.data.episode_source import FRONT_CAMERA, EpisodeSource, lidar_frames, lidar_of
from siren_ros.data.interfaces.measurements import Transform, matrix_of_transform
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.episode import KittiLayout
from siren_ros.simulation.world.actors import ActorClass, by_class
from siren_ros.simulation.world.carrier import CameraIntrinsics, GroundTruth

RANGE_M: Final = 50.0
"""Objects farther from the sensor are dropped (paper: the nuScenes evaluation range)."""
OBJECT_TYPE: Final = "Car"
"""The only class of the paper's labels."""
PAPER_README: Final = """# The paper's layout, which is not KITTI's

`velodyne/NNNNNN.bin` holds float32 `x y z intensity` in the LiDAR frame (x forward, y left, z up).
`label_2/NNNNNN.txt` holds lines `type trunc occl alpha x1 y1 x2 y2 h w l lx ly lz heading` **in the LiDAR frame**:
metres, volume centre, heading counter-clockwise from the x axis. Truncation, occlusion and the image box are 0. Every
vehicle is a `Car`, the emergency vehicle too; vehicles beyond 50 m are left out.

A KITTI reader opens these files without an error and puts every box in a wrong place, because KITTI's labels are in
the camera's frame with the centre of the bottom face. `siren export kitti` without `--layout paper` writes what such
a reader expects, with these lines in `label_lidar/`.
"""
_TYPES: Final = {
    ActorClass.SEDAN: "Car",
    ActorClass.VAN: "Van",
    ActorClass.TRUCK: "Truck",
    ActorClass.BUS: "Misc",
    ActorClass.MOTORCYCLE: "Misc",
    ActorClass.BICYCLE: "Cyclist",
    ActorClass.PEDESTRIAN: "Pedestrian",
}
TYPE_OF_CLASS: Final = by_class(_TYPES)
"""KITTI's type for each class; KITTI has no type for buses and motorcycles, so they become ``Misc``."""
UNKNOWN: Final = 3
"""KITTI's occlusion state "unknown": here, no LiDAR point lies on the vehicle."""
_FULLY_VISIBLE: Final = 0.8
_PARTLY_VISIBLE: Final = 0.4


def label_text(truth: GroundTruth) -> str:
    """The paper's label lines of all vehicles within range, in the order of actor ids; empty without vehicles.

    Truncation and occlusion are 0 and the image box is all zeros: these labels are the LiDAR's. ``alpha``
    is the heading as seen along the line of sight.
    """
    vehicles = truth.actor_class != ActorClass.PEDESTRIAN
    near = np.flatnonzero(vehicles & (np.hypot(truth.x_m, truth.y_m) <= RANGE_M))
    heading = wrap_angle(truth.yaw_rad)
    alpha = wrap_angle(heading - np.arctan2(truth.y_m, truth.x_m))
    lines = []
    for row in near.tolist():
        size = (truth.height_m[row], truth.width_m[row], truth.length_m[row])
        place = (truth.x_m[row], truth.y_m[row], truth.z_m[row])
        numbers = (alpha[row], 0.0, 0.0, 0.0, 0.0, *size, *place, heading[row])
        lines.append(f"{OBJECT_TYPE} 0.00 0 " + " ".join(number_text(float(value), 4) for value in numbers) + "\n")
    return "".join(lines)


@dataclass(frozen=True)
class KittiCamera:
    """The camera of ``image_2``, with its pose relative to the LiDAR."""

    model: CameraIntrinsics
    camera_from_lidar: Matrix
    """Transform from the ``lidar`` frame to the camera's optical frame, shape ``(4, 4)``."""


def calibration_text(camera: KittiCamera) -> str:
    """A calibration file: one camera takes the place of all four, without rectification."""
    projection = np.hstack((camera.model.matrix, np.zeros((3, 1))))
    lines = [f"P{index}: {_row(projection)}" for index in range(4)]
    lines.append(f"R0_rect: {_row(np.eye(3))}")
    lines.append(f"Tr_velo_to_cam: {_row(camera.camera_from_lidar[:3])}")
    lines.append(f"Tr_imu_to_velo: {_row(np.eye(4)[:3])}")
    return "\n".join(lines) + "\n"


def _row(matrix: Matrix) -> str:
    return " ".join(number_text(float(value), 8) for value in matrix.reshape(-1))


def camera_from_lidar(transforms: tuple[Transform, ...], lidar_frame: str, camera_frame: str) -> Matrix:
    """Transform between two sensors that are mounted on the same parent, shape ``(4, 4)``.

    Raises InputError: a frame is not among the transforms, or the two have different parents.
    """
    by_child = {transform.child: transform for transform in transforms}
    for frame in (lidar_frame, camera_frame):
        if frame not in by_child:
            raise InputError("frame", frame, f"one of {', '.join(sorted(by_child))}")
    lidar, camera = by_child[lidar_frame], by_child[camera_frame]
    if lidar.parent != camera.parent:
        raise InputError("frame", camera.parent, f"the parent of {lidar_frame}, {lidar.parent}")
    matrix: Matrix = np.linalg.inv(matrix_of_transform(camera)) @ matrix_of_transform(lidar)
    return matrix


@dataclass(frozen=True)
class CameraLabels:
    """KITTI labels of the vehicles in the picture of one frame; arrays have shape ``(N,)`` unless stated otherwise."""

    rows: Rows
    """Rows of the ground truth."""
    actor_class: Codes
    truncated: Floats
    occluded: Codes
    """Occlusion: 0 fully visible, 1 partly, 2 largely hidden, 3 without a LiDAR point."""
    box_px: Floats
    """Left, top, right, bottom in the picture, shape ``(N, 4)``."""
    size_m: Floats
    """Height, width, length, shape ``(N, 3)``."""
    bottom_m: Floats
    """Centre of the bottom face in the camera's frame, shape ``(N, 3)``."""
    rotation_rad: Floats
    """``rotation_y``: around the camera's y axis, 0 towards its x axis."""
    visible: Floats
    """Share of the box that the LiDAR sees."""

    def __len__(self) -> int:
        return len(self.rows)

    def types(self) -> list[str]:
        """KITTI's names of the classes."""
        return [TYPE_OF_CLASS[ActorClass(code)] for code in self.actor_class.tolist()]


def camera_labels(truth: GroundTruth, points: npt.NDArray[np.void], camera: KittiCamera) -> CameraLabels:
    """KITTI labels of a frame; boxes and points (with the field ``instance``) are in the LiDAR's frame."""
    corners = box_corners(truth)
    boxes, truncated = image_boxes(corners, camera.camera_from_lidar, camera.model)
    rows = np.flatnonzero(truncated < 1.0)
    visible = lidar_visibility(points, truth, rows)
    occluded = np.select([visible >= _FULLY_VISIBLE, visible >= _PARTLY_VISIBLE, visible > 0.0], [0, 1, 2], UNKNOWN)
    rotation, shift = camera.camera_from_lidar[:3, :3], camera.camera_from_lidar[:3, 3]
    bottom = corners[rows, :4].mean(axis=1) @ rotation.T + shift
    yaw = truth.yaw_rad[rows]
    ahead = np.stack((np.cos(yaw), np.sin(yaw), np.zeros(len(rows))), axis=-1) @ rotation.T
    return CameraLabels(
        rows=rows,
        actor_class=truth.actor_class[rows],
        truncated=truncated[rows],
        occluded=occluded.astype(np.uint8),
        box_px=boxes[rows],
        size_m=np.stack((truth.height_m, truth.width_m, truth.length_m), axis=-1)[rows],
        bottom_m=bottom,
        rotation_rad=wrap_angle(np.arctan2(-ahead[:, 2], ahead[:, 0])),
        visible=visible,
    )


def label_lines(labels: CameraLabels) -> str:
    """Lines of a file of ``label_2``, in the order of actor ids."""
    alpha = wrap_angle(labels.rotation_rad - np.arctan2(labels.bottom_m[:, 0], labels.bottom_m[:, 2]))
    lines = []
    for row, kind in enumerate(labels.types()):
        box = " ".join(number_text(value, 2) for value in labels.box_px[row].tolist())
        numbers = (*labels.size_m[row].tolist(), *labels.bottom_m[row].tolist(), float(labels.rotation_rad[row]))
        rest = " ".join(number_text(value, 4) for value in numbers)
        truncated, turned = number_text(float(labels.truncated[row]), 2), number_text(float(alpha[row]), 4)
        lines.append(f"{kind} {truncated} {labels.occluded[row]} {turned} {box} {rest}\n")
    return "".join(lines)


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
            files.write("README.md", PAPER_README.encode())
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
        truth, objects = frame.truth, []
        for line, (row, kind) in enumerate(zip(labels.rows.tolist(), labels.types(), strict=True)):
            actor = f"{truth.actor_id[row]},{kind},{int(truth.is_emv[row])},{truth.lidar_points[row]}"
            objects.append(f"{number},{line},{actor},{labels.visible[line]:.3f}\n")
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


NAME_OF_CLASS: Final = by_class({**_TYPES, ActorClass.BUS: "Bus"})
"""KITTI's classes plus one for buses."""
_OPENPCDET_FRAMES: Final = "frames.csv"


class OpenPcdetExporter:
    """Writes a frame for every step with a sweep and ground truth."""

    def __init__(self, least_points: str) -> None:
        self._least_points = int(least_points)

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Write the frames, numbered from 0."""
        number, classes = 0, Counter[str]()
        for frame in lidar_frames(source):
            if frame.points is None or frame.truth is None:
                continue
            lines = openpcdet_lines(frame.truth, self._least_points)
            classes.update(line.split()[-1] for line in lines)
            files.write(f"points/{number:06d}.npy", npy_bytes(velodyne_bytes(frame.points)))
            files.write(f"labels/{number:06d}.txt", "".join(lines).encode())
            files.append(_OPENPCDET_FRAMES, f"{number:06d},{episode_id},{frame.step},{frame.step * STEP_S:.2f}\n")
            files.progress(frame.step * STEP_S)
            number += 1
        return EpisodeReport({"frames": number, "labels": classes.total()}, dict(classes))

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Number the frames of all episodes consecutively."""
        first = 0
        sets: dict[str, list[int]] = {"train": [], "val": [], "test": []}
        table = ["frame,episode,step,timestamp\n"]
        for part in parts:
            for kind, suffix in (("points", "npy"), ("labels", "txt")):
                for path in sorted((part.folder / kind).glob(f"*.{suffix}")):
                    link(path, folder / kind / f"{int(path.stem) + first:06d}.{suffix}")
            lines = (part.folder / _OPENPCDET_FRAMES).read_text(encoding="utf-8").splitlines(keepends=True)
            table += [f"{int(line[:6]) + first:06d}{line[6:]}" for line in lines]
            sets[part.subset] += range(first, first + len(lines))
            first += len(lines)
        write_image_sets(folder, sets)
        (folder / _OPENPCDET_FRAMES).write_text("".join(table), encoding="utf-8")


def openpcdet_lines(truth: GroundTruth, least_points: int) -> list[str]:
    """Label lines of all boxes with enough LiDAR points, in the order of actor ids."""
    lines = []
    for row in np.flatnonzero(truth.lidar_points >= least_points).tolist():
        numbers = (
            truth.x_m[row],
            truth.y_m[row],
            truth.z_m[row],
            truth.length_m[row],
            truth.width_m[row],
            truth.height_m[row],
            float(wrap_angle(truth.yaw_rad[row])),
        )
        text = " ".join(number_text(float(value), 4) for value in numbers)
        lines.append(f"{text} {NAME_OF_CLASS[ActorClass(int(truth.actor_class[row]))]}\n")
    return lines


def npy_bytes(points: bytes) -> bytes:
    """A ``.npy`` file of float32 rows with four values."""
    buffer = io.BytesIO()
    np.save(buffer, np.frombuffer(points, dtype="<f4").reshape(-1, 4))
    return buffer.getvalue()
