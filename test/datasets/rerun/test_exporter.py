"""Rerun recordings as Rerun's own data frames read them."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from reader_environments import read_with

from siren_ros.cli.main import main


@pytest.fixture(scope="module")
def read(sensed_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    found: dict[str, Any] = read_with("rerun", "read_rerun.py", sensed_bag, tmp_path_factory.mktemp("rerun") / "out")
    return found


def test_everything_is_on_the_timeline(read: dict[str, Any]) -> None:
    assert (read["code"], read["application"]) == (0, "siren")
    assert "episode" in read["timelines"]
    assert (read["steps"], read["last_s"]) == (20, pytest.approx(1.9))
    assert read["path"] == 19


def test_map_boxes_lidar_cameras_and_events_are_there(read: dict[str, Any]) -> None:
    cameras = [f"/map/emv/camera_{name}" for name in ("front", "left_rear", "rear", "right_rear")]
    expected = {"/map/lanes", "/map/vehicles", "/map/emv", "/map/emv/lidar", "/events", "/speed/emv", *cameras}
    assert expected <= set(read["entities"])


@pytest.mark.skipif(find_spec("rerun") is not None, reason="rerun is installed here")
def test_without_rerun_the_command_that_brings_it_is_told(
    tracked_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", "rerun", str(tracked_bag), "--out", str(tmp_path / "out")]) == 2
    assert "./env --with rerun siren export rerun" in capsys.readouterr().err
