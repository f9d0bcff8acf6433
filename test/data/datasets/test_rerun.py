"""What is logged to Rerun, noted by a stand-in for its package, which the environment of the tests does not have."""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from datasets.made_bag import (
    BUS,
    CAR,
    EMV,
    FRONT,
    FRONT_M,
    LIDAR_M,
    REAR,
    REAR_M,
    BagSpec,
    described,
    jpeg_of,
    sweep_of,
)
from reader_environments import read_with

from siren_ros.cli.main import main
from siren_ros.data.datasets.files import FileWriter
from siren_ros.data.episode_source import open_source


class Recording:
    """Notes what is logged where and when."""

    def __init__(self, application: str, **settings: Any) -> None:
        self.application, self.settings = application, settings
        self.time_s: float | None = None
        self.logged: list[tuple[str, float | None, Any]] = []
        self.ended: list[str] = []

    def save(self, path: Path, views: Any) -> None:
        self.path, self.views = path, views
        Package.recordings.append(self)

    def set_time(self, timeline: str, duration: float) -> None:
        assert timeline == "episode"
        self.time_s = duration

    def log(self, path: str, what: Any, static: bool = False) -> None:
        self.logged.append((path, None if static else self.time_s, what))

    def flush(self) -> None:
        self.ended.append("flush")

    def disconnect(self) -> None:
        self.ended.append("disconnect")


class Package(ModuleType):
    """Any name of it makes an object that keeps the arguments of its call."""

    recordings: list[Recording]
    RecordingStream = Recording
    ViewCoordinates = SimpleNamespace(RIGHT_HAND_Z_UP="right, z up", RDF="right, down, forward")

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *values, **named: SimpleNamespace(kind=name, values=values, **named)


@pytest.fixture(scope="module")
def recording(made_bags: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Recording:
    with pytest.MonkeyPatch.context() as patch:
        package, views = Package("rerun"), Package("rerun.blueprint")
        package.blueprint = views
        patch.setitem(sys.modules, "rerun", package)
        patch.setitem(sys.modules, "rerun.blueprint", views)
        patch.delitem(sys.modules, "siren_ros.data.datasets.rerun", raising=False)
        Package.recordings = []
        from siren_ros.data.datasets.rerun import RerunExporter  # with the stand-in

        folder = tmp_path_factory.mktemp("rerun")
        with open_source(made_bags[0]) as source, FileWriter(folder) as files:
            report = RerunExporter().write_episode(source, "mine", files)
        assert dict(report.counts) == {"recordings": 1, "steps": 21, "events": 1}
    sys.modules.pop("siren_ros.data.datasets.rerun")
    (noted,) = Package.recordings
    return noted


def logged(recording: Recording, path: str) -> list[tuple[float | None, Any]]:
    return [(time_s, what) for at, time_s, what in recording.logged if at == path]


def test_the_file_is_closed_and_the_viewer_shows_scene_cameras_events_and_speed(recording):
    assert (recording.path.name, recording.application) == ("mine.rrd", "siren")
    assert recording.ended == ["flush", "disconnect"]
    above, below = recording.views.values[0].values
    scene, cameras = above.values
    assert (scene.kind, scene.origin) == ("Spatial3DView", "map")
    assert [view.origin for view in cameras.values] == [f"map/emv/{FRONT}", f"map/emv/{REAR}"]
    views = [(view.kind, view.origin) for view in below.values]
    assert views == [("TextLogView", "events"), ("TimeSeriesView", "speed")]


def test_boxes_stand_on_the_road_with_their_sizes(recording):
    record, boxes = described(BagSpec()), logged(recording, "map/vehicles")
    assert [time_s for time_s, _ in boxes] == pytest.approx([0.1 * frame for frame in range(21)])
    for time_s, drawn in boxes:
        assert time_s is not None
        states = record.states[round(time_s / 0.05)]
        actors = [record.actors[key] for key in states.actor_id.tolist()]
        halves = [[actor.length_m / 2, actor.width_m / 2, actor.height_m / 2] for actor in actors]
        assert np.array(drawn.half_sizes) == pytest.approx(np.array(halves))
        centres = np.stack((states.x_m, states.y_m, [actor.height_m / 2 for actor in actors]), axis=-1)
        assert drawn.centers == pytest.approx(centres)
        turned = [rotation.angle.rad for rotation in drawn.rotation_axis_angles]
        assert turned == states.yaw_rad.tolist()
        assert {rotation.axis for rotation in drawn.rotation_axis_angles} == {(0.0, 0.0, 1.0)}
        names = {EMV: "ambulance 1", CAR: "sedan 5", BUS: "bus 9"}
        assert drawn.labels == [names[key] for key in states.actor_id.tolist()]
        red = {EMV: (230, 30, 30), CAR: (90, 90, 90), BUS: (90, 90, 90)}
        assert drawn.colors == [red[key] for key in states.actor_id.tolist()]


def test_the_vehicle_moves_and_leaves_its_path_in_pieces(recording):
    record = described(BagSpec())
    poses = [pose for _, pose in logged(recording, "map/emv")]
    track = record.track(EMV)
    assert [pose.translation[0] for pose in poses] == pytest.approx(track.x_m[::2].tolist())
    assert [pose.translation[1] for pose in poses] == pytest.approx(track.y_m[::2].tolist())
    assert [speed.values[0] for _, speed in logged(recording, "speed/emv")] == pytest.approx([10.0] * 21)
    pieces = [(at, what) for at, _, what in recording.logged if at.startswith("map/path/")]
    assert [at for at, _ in pieces] == [f"map/path/{number:06d}" for number in range(2, 22)]
    for number, (_, piece) in enumerate(pieces):
        ((start, end),) = piece.values[0]
        assert (start[0], end[0]) == pytest.approx((20.0 + number, 21.0 + number))


def test_the_map_has_both_sides_of_every_lane(recording):
    ((time_s, lanes),) = logged(recording, "map/lanes")
    assert (time_s, logged(recording, "map")[0][1]) == (None, "right, z up")
    assert {float(line[0, 1]) for line in lanes.values[0]} == {-7.0, -3.5, 0.0, 3.5, 7.0}
    assert all(line.shape[1] == 3 and not line[:, 2].any() for line in lanes.values[0])


def test_sensors_hang_from_the_vehicle(recording):
    for name, place in (("lidar", LIDAR_M), (FRONT, FRONT_M), (REAR, REAR_M)):
        (pose,) = [what for time_s, what in logged(recording, f"map/emv/{name}") if what.kind == "Transform3D"]
        assert pose.translation == pytest.approx(place)
    ahead = next(what for _, what in logged(recording, f"map/emv/{FRONT}") if what.kind == "Transform3D").mat3x3
    assert ahead @ [0.0, 0.0, 1.0] == pytest.approx([1.0, 0.0, 0.0])
    (model,) = [what for _, what in logged(recording, f"map/emv/{REAR}") if what.kind == "Pinhole"]
    assert (model.resolution, model.camera_xyz) == ([64, 48], "right, down, forward")
    assert model.image_from_camera.tolist() == [[32.0, 0.0, 32.0], [0.0, 32.0, 24.0], [0.0, 0.0, 1.0]]


def test_sweeps_and_pictures_are_those_of_their_steps(recording):
    clouds = [(time_s, what) for time_s, what in logged(recording, "map/emv/lidar") if what.kind == "Points3D"]
    assert [time_s for time_s, _ in clouds] == pytest.approx([0.05 * step for step in range(4, 42, 2)])
    for time_s, cloud in clouds:
        assert time_s is not None
        points = sweep_of(round(time_s / 0.05))[::2]
        expected = np.stack((points["x"], points["y"], points["z"]), axis=-1)
        assert np.array_equal(cloud.values[0], expected), "every second return"
    for camera in (FRONT, REAR):
        pictures = [(t, what) for t, what in logged(recording, f"map/emv/{camera}") if what.kind == "EncodedImage"]
        assert [what.contents for _, what in pictures] == [jpeg_of(step, camera) for step in range(4, 42, 2)]


def test_events_are_told_when_they_happen(recording):
    ((time_s, event),) = logged(recording, "events")
    assert time_s == pytest.approx(1.0)
    assert (event.values[0], event.level) == (f"removed: vehicle {BUS}", "INFO")


def test_everything_is_on_the_timeline(sensed_bag: Path, tmp_path: Path):
    read = read_with("rerun", "read_rerun.py", sensed_bag, tmp_path / "out")
    assert (read["code"], read["application"]) == (0, "siren")
    assert "episode" in read["timelines"]
    assert (read["steps"], read["last_s"], read["path"]) == (20, pytest.approx(1.9), 19)
    cameras = [f"/map/emv/camera_{name}" for name in ("front", "left_rear", "rear", "right_rear")]
    expected = {"/map/lanes", "/map/vehicles", "/map/emv", "/map/emv/lidar", "/events", "/speed/emv", *cameras}
    assert expected <= set(read["entities"])


def test_without_rerun_the_command_that_brings_it_is_told(made_drive, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.delitem(sys.modules, "siren_ros.data.datasets.rerun", raising=False)
    assert main(["export", "rerun", str(made_drive), "--out", str(tmp_path / "out")]) == 2
    assert "./env --with rerun siren export rerun" in capsys.readouterr().err
