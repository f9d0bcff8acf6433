"""All cameras and the bird's-eye view side by side."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from siren_ros.cli.main import main
from siren_ros.datasets.sources.episode_source import MountedCamera
from siren_ros.interfaces.images import CameraIntrinsics
from siren_ros.pictures.camera_grid import CELL_PX, grid_places, ordered_cameras


def camera(name: str, yaw_rad: float) -> MountedCamera:
    """One that looks in a direction."""
    base_from_optical = np.eye(4)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    base_from_optical[:3, :3] = np.array([[sin, 0.0, cos], [-cos, 0.0, sin], [0.0, -1.0, 0.0]])
    return MountedCamera(name, f"/{name}", base_from_optical, CameraIntrinsics(8, 6, 5.0, 5.0, 4.0, 3.0), "")


def test_cameras_stand_from_the_left_around_to_the_right() -> None:
    cameras = [camera("right", -1.7), camera("rear", np.pi), camera("left", 1.7), camera("camera_front", 0.0)]
    assert [one.name for one in ordered_cameras(cameras)] == ["camera_front", "left", "rear", "right"]


@pytest.mark.parametrize(("count", "columns", "rows"), [(2, 2, 1), (3, 2, 2), (5, 3, 2), (7, 3, 3)])
def test_the_grid_is_wider_than_high(count: int, columns: int, rows: int) -> None:
    places = grid_places(count)
    assert len(set(places)) == count
    assert (max(column for column, _ in places) + 1, max(row for _, row in places) + 1) == (columns, rows)


def test_a_bag_without_cameras_is_refused(
    write_bag: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "bag", duration_s=1.0)
    assert main(["video", str(bag), "--view", "grid", "--out", str(tmp_path / "a.mp4")]) == 2
    assert "sensors:=full" in capsys.readouterr().err


def test_cells_are_four_to_three() -> None:
    assert CELL_PX[0] * 3 == CELL_PX[1] * 4
