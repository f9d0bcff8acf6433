"""Exports OpenPCDet's custom dataset.

Layout and labels: https://github.com/open-mmlab/OpenPCDet, ``docs/CUSTOM_DATASET_TUTORIAL.md``. ``points/NNNNNN.npy``
has the shape ``(N, 4)``: x, y, z, intensity. ``labels/NNNNNN.txt`` has lines ``x y z dx dy dz heading Name`` in the
same frame (x forward, y left, z up). The centre is the volume's, the heading counter-clockwise from x.
"""

import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.datasets.files import FileWriter, link, number_text, write_image_sets
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport
from siren_ros.data.datasets.kitti.exporter import velodyne_bytes
from siren_ros.data.datasets.kitti.labels import TYPE_OF_CLASS
from siren_ros.data.record.episode_source import EpisodeSource, lidar_frames
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import GroundTruth

NAME_OF_CLASS: Final = {**TYPE_OF_CLASS, ActorClass.BUS: "Bus"}
"""KITTI's classes plus one for buses."""
_FRAMES: Final = "frames.csv"


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
            lines = label_lines(frame.truth, self._least_points)
            classes.update(line.split()[-1] for line in lines)
            files.write(f"points/{number:06d}.npy", npy_bytes(velodyne_bytes(frame.points)))
            files.write(f"labels/{number:06d}.txt", "".join(lines).encode())
            files.append(_FRAMES, f"{number:06d},{episode_id},{frame.step},{frame.step * STEP_S:.2f}\n")
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
            lines = (part.folder / _FRAMES).read_text(encoding="utf-8").splitlines(keepends=True)
            table += [f"{int(line[:6]) + first:06d}{line[6:]}" for line in lines]
            sets[part.subset] += range(first, first + len(lines))
            first += len(lines)
        write_image_sets(folder, sets)
        (folder / _FRAMES).write_text("".join(table), encoding="utf-8")


def label_lines(truth: GroundTruth, least_points: int) -> list[str]:
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
