"""KITTI frames out of recorded episodes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from siren_ros.datasets.files import FileWriter, link, write_image_sets
from siren_ros.datasets.formats import EpisodePart, EpisodeReport
from siren_ros.datasets.kitti.frame_files import FRAMES_FILE, OBJECTS_FILE, TRAINING, KittiFrame, KittiFrames
from siren_ros.datasets.kitti.labels import KittiCamera
from siren_ros.datasets.kitti.live_export import Layout
from siren_ros.numerics.units import STEP_S
from siren_ros.record.episode_source import FRONT_CAMERA, EpisodeSource, lidar_frames, lidar_of

_TESTING: Final = "testing"
"""Where KITTI has the frames of its split ``test``."""


class KittiExporter:
    """Every step with a sweep and ground truth, and in the standard layout a picture, becomes a frame."""

    def __init__(self, layout: str) -> None:
        self._layout = Layout(layout)

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:  # noqa: ARG002 - the interface of all formats
        """Writes the frames, numbered from 0 on."""
        lidar, camera = lidar_of(source), source.front_camera
        kitti_camera = None if camera is None else KittiCamera(camera.model, camera.from_lidar(lidar))
        frames = KittiFrames(files, self._layout, kitti_camera)
        for frame in lidar_frames(source, cameras=() if camera is None else (camera,)):
            if frame.points is not None and frame.truth is not None:
                frames.write(KittiFrame(frame.step, frame.points, frame.truth, frame.jpegs.get(FRONT_CAMERA)))
                files.progress(frame.step * STEP_S)
        return EpisodeReport({"frames": frames.frames, "labels": frames.classes.total()}, dict(frames.classes))

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Numbers the frames of all episodes in one row; ``test`` goes below ``testing/``."""
        first = 0
        sets: dict[str, list[int]] = {"train": [], "val": [], "test": []}
        for part in parts:
            for path in sorted(part.folder.rglob("*.*")):
                place = path.relative_to(part.folder)
                if len(path.stem) == len("000000") and path.stem.isdigit():
                    target = place.with_name(f"{int(path.stem) + first:06d}{path.suffix}")
                    if part.split == "test" and target.parts[0] == TRAINING:
                        target = Path(_TESTING, *target.parts[1:])
                    link(path, folder / target)
            _append_table(part, folder / FRAMES_FILE, first, episode=True)
            _append_table(part, folder / OBJECTS_FILE, first, episode=False)
            count = part.report.counts["frames"]
            sets[part.split] += range(first, first + count)
            first += count
        if self._layout is Layout.PAPER:
            (folder / "README.md").write_bytes((parts[0].folder / "README.md").read_bytes())
            return
        sets["trainval"] = sorted(sets["train"] + sets["val"])
        write_image_sets(folder, sets)


def _append_table(part: EpisodePart, target: Path, first: int, *, episode: bool) -> None:
    """Adds a part's table to the dataset's, with the dataset's frame numbers."""
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
