"""Reads a KITTI dataset with Open3D-ML's own reader; prints boxes and points of some frames as JSON."""

import json
import sys
import types
from pathlib import Path

import open3d

# The package's start imports torch or tensorflow; the reader of KITTI needs neither.
for name in ("open3d._ml3d", "open3d._ml3d.datasets"):
    package = types.ModuleType(name)
    package.__path__ = [str(Path(open3d.__file__).parent.joinpath(*name.split(".")[1:]))]
    sys.modules[name] = package
from open3d._ml3d.datasets.kitti import KITTI


def frame(folder: Path, number: str) -> dict[str, object]:
    """Boxes and number of points of one frame."""
    calib = KITTI.read_calib(folder / "calib" / f"{number}.txt")
    boxes = KITTI.read_label(folder / "label_2" / f"{number}.txt", calib)
    points = KITTI.read_lidar(folder / "velodyne" / f"{number}.bin")
    box_rows = [
        {
            "class": box.label_class,
            "centre": [float(value) for value in box.center],
            "size_whl": [float(value) for value in box.size],
            "yaw": float(box.yaw),
            "level": str(box.level),
            "world_from_camera": calib["world_cam"].tolist(),
        }
        for box in boxes
    ]
    return {"boxes": box_rows, "points": len(points)}


print(json.dumps({number: frame(Path(sys.argv[1]), number) for number in sys.argv[2:]}))
