"""Videos: their frames, coding and errors, and all cameras next to the bird's-eye view."""

import os
import subprocess
import sys
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import av
import numpy as np
import pytest
from busy_record import busy_record
from datasets.made_bag import write_made_bag
from hand_made_record import EASTBOUND, EMV, NORTHBOUND, Driven, at_speed, crossing, hand_made
from known_outputs import assert_known
from PIL import Image

from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.episode_source import MountedCamera
from siren_ros.data.interfaces.boxes import EMV_COLOUR
from siren_ros.data.interfaces.measurements import to_compressed_image
from siren_ros.data.interfaces.topics import IMAGE_COMPRESSED
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.bag_writer import EpisodeBagWriter
from siren_ros.errors import BagError, InputError
from siren_ros.scoring.pictures.moving_birdseye import (
    SIZE_PX,
    BirdseyeFilm,
    draw_map_image,
    paint_polygons,
    rgb_of,
    signal_bars,
)
from siren_ros.scoring.pictures.video import (
    Coding,
    View,
    grid_frames,
    grid_places,
    ordered_cameras,
    save_video,
    write_video,
)
from siren_ros.simulation.world.actors import Mode
from siren_ros.simulation.world.carrier import CameraIntrinsics

FRONT = IMAGE_COMPRESSED.of_sensor("camera_front", 2)
OFF_CENTRE_PX = 90.0
"""How far the camera's smoothing may take the EMV out of the middle: 10 m."""


def camera(name, yaw_rad):
    """One that looks in a direction."""
    base_from_optical = np.eye(4)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    base_from_optical[:3, :3] = np.array([[sin, 0.0, cos], [-cos, 0.0, sin], [0.0, -1.0, 0.0]])
    return MountedCamera(name, f"/{name}", base_from_optical, CameraIntrinsics(8, 6, 5.0, 5.0, 4.0, 3.0), "")


def test_cameras_stand_from_the_left_around_to_the_right():
    cameras = [camera("right", -1.7), camera("rear", np.pi), camera("left", 1.7), camera("camera_front", 0.0)]
    assert [camera.name for camera in ordered_cameras(cameras)] == ["camera_front", "left", "rear", "right"]


@pytest.mark.parametrize(("count", "columns", "rows"), [(2, 2, 1), (3, 2, 2), (5, 3, 2), (7, 3, 3)])
def test_the_grid_is_wider_than_high(count, columns, rows):
    places = grid_places(count)
    assert len(set(places)) == count
    assert (max(column for column, _ in places) + 1, max(row for _, row in places) + 1) == (columns, rows)


def test_the_grid_has_the_birdseye_view_and_the_last_picture_of_each_camera(tmp_path, typestore):
    """Pictures begin at step 4; the camera that looks back has one at every fourth step."""
    rear = IMAGE_COMPRESSED.of_sensor("camera_rear", 2).name
    bag = write_made_bag(tmp_path / "bag", typestore, lacking=lambda topic, step: topic == rear and step % 4 > 0)
    record, steps = read_episode(bag), (2, 6, 8)
    film = BirdseyeFilm(record, steps)
    shown = (((20, 20, 20),) * 2, ((30, 120, 200), (20, 120, 40)), ((40, 120, 200), (40, 120, 40)))
    for step, grid, (front, back) in zip(steps, grid_frames(bag, record, steps), shown, strict=True):
        assert grid.shape == (960, 1280, 3)
        assert np.array_equal(grid[60:420, :640], film.frame(step).resize((640, 360)))
        assert grid[240, 960] == pytest.approx(front, abs=4)
        assert grid[720, 320] == pytest.approx(back, abs=4)
        assert grid[720, 960].tolist() == [20, 20, 20]


@pytest.fixture(scope="module")
def bag(tmp_path_factory, write_bag):
    return write_bag(tmp_path_factory.mktemp("bags") / "S2_L2_seed0", duration_s=2.0)


@pytest.fixture(scope="module")
def front_bag(tmp_path_factory, typestore):
    """A bag with a front camera at 10 Hz whose images grow brighter by 10 from step to step."""
    return _camera_bag(tmp_path_factory.mktemp("bags") / "front", typestore, range(0, 40, 2))


def _camera_bag(path, typestore, steps):
    writer = EpisodeBagWriter(path, typestore, [])
    for step in steps:
        jpeg = BytesIO()
        Image.new("RGB", (81, 60), (step * 5, step * 5, step * 5)).save(jpeg, "JPEG", quality=95)
        message = to_compressed_image(step, "camera_front_optical_frame", jpeg.getvalue())
        cdr = bytes(typestore.serialize_cdr(message, FRONT.type_name))
        writer.write(FRONT.name, FRONT.type_name, cdr, time_ns_of_step(step))
    return writer.finish().path


def _decoded(path):
    with av.open(str(path)) as container:
        (stream,) = container.streams
        facts = {"codec": stream.codec_context.name, "rate": float(stream.average_rate), "format": stream.format.name}
        return facts, [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]


def test_the_birdseye_video_has_the_episodes_frames_at_10_hz_in_the_same_bytes_again(bag, tmp_path):
    path = tmp_path / "new" / "a.mp4"
    assert save_video(bag, View.BIRDSEYE, path) == 20
    facts, frames = _decoded(path)
    assert facts == {"codec": "h264", "rate": 10.0, "format": "yuv420p"}
    assert (len(frames), frames[0].shape) == (20, (SIZE_PX[1], SIZE_PX[0], 3))
    assert [item.name for item in path.parent.iterdir()] == ["a.mp4"]
    save_video(bag, View.BIRDSEYE, tmp_path / "b.mp4")
    assert path.read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_the_bytes_do_not_depend_on_what_was_in_memory_before(tmp_path):
    program = (
        "import sys, numpy as np\n"
        "from pathlib import Path\n"
        "from siren_ros.scoring.pictures.video import write_video\n"
        "noise = np.random.default_rng(0).integers(0, 256, (76, 120, 3))\n"
        "picture = np.kron(noise, np.ones((8, 8, 1))).astype(np.uint8)\n"
        "write_video(Path(sys.argv[1]), (picture[3 * n :][:600, 5 * n :][:, :800] for n in range(3)))\n"
    )
    videos = set()
    for filled in ("1", "170"):
        path = tmp_path / f"{filled}.mp4"
        filling = os.environ | {"MALLOC_PERTURB_": filled, "MALLOC_MMAP_MAX_": "0"}  # glibc's: bytes of new memory
        subprocess.run([sys.executable, "-c", program, str(path)], env=filling, check=True)
        videos.add(path.read_bytes())
    assert len(videos) == 1


def test_the_front_video_shows_the_recorded_images(front_bag, tmp_path):
    path = tmp_path / "front.mp4"
    assert save_video(front_bag, View.FRONT, path, frames=5, start_s=0.45) == 5
    _, frames = _decoded(path)
    assert frames[0].shape == (60, 80, 3)
    assert [float(frame.mean()) for frame in frames] == pytest.approx([50, 60, 70, 80, 90], abs=3.0)


def test_a_camera_twice_as_fast_gives_every_second_image(tmp_path, typestore):
    fast = _camera_bag(tmp_path / "fast", typestore, range(20))
    assert save_video(fast, View.FRONT, tmp_path / "a.mp4") == 10
    slow = _camera_bag(tmp_path / "slow", typestore, range(0, 40, 4))
    with pytest.raises(BagError, match="10 Hz"):
        save_video(slow, View.FRONT, tmp_path / "b.mp4")


@pytest.mark.parametrize(
    ("options", "named"),
    [
        *[({"frames": 21}, "frames: 21 .*at most 20"), ({"frames": 11, "start_s": 1.0}, "frames: 11 .*at most 10")],
        *[({"frames": 0}, "frames: 0"), ({"start_s": 2.0}, "start_s: 2")],
        *[({"start_s": -1.0}, "start_s: -1"), ({"start_s": float("nan")}, "start_s: nan")],
        ({"start_s": float("inf")}, "start_s: inf"),
    ],
)
def test_frames_that_are_not_there_are_refused(bag, tmp_path, options, named):
    with pytest.raises(InputError, match=named):
        save_video(bag, View.BIRDSEYE, tmp_path / "a.mp4", **options)
    assert list(tmp_path.iterdir()) == []


def test_only_what_a_bag_has_and_only_mp4_and_only_where_it_can_be_written(bag, tmp_path):
    for view, needed in ((View.FRONT, "camera_front"), (View.GRID, "sensors:=full")):
        with pytest.raises(BagError, match=needed):
            save_video(bag, view, tmp_path / "a.mp4")
    with pytest.raises(InputError, match=r"\.mp4"):
        save_video(bag, View.BIRDSEYE, tmp_path / "a.avi")
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="can be written"):
        save_video(bag, View.BIRDSEYE, tmp_path / "file" / "a.mp4", frames=1)
    (tmp_path / "file").rename(tmp_path / "a.mp4")
    with pytest.raises(InputError, match="frames: 0"):
        write_video(tmp_path / "a.mp4", [])
    assert [(item.name, item.read_text()) for item in tmp_path.iterdir()] == [("a.mp4", "x")], "the old video stays"


def test_a_narrow_video_keeps_its_proportions_and_is_smaller(tmp_path):
    shades = np.tile(np.linspace(0, 255, 640).astype(np.uint8)[None, :, None], (360, 1, 3))
    frames = [np.roll(shades, 40 * number, axis=1) for number in range(6)]
    assert write_video(tmp_path / "wide.mp4", frames) == 6
    assert write_video(tmp_path / "narrow.mp4", frames, Coding(width_px=320, crf=32)) == 6
    _, images = _decoded(tmp_path / "narrow.mp4")
    assert images[0].shape == (180, 320, 3)
    assert np.abs(images[3][90, ::8].astype(int) - frames[3][180, ::16].astype(int)).mean() < 12
    assert (tmp_path / "narrow.mp4").stat().st_size < (tmp_path / "wide.mp4").stat().st_size
    write_video(tmp_path / "kept.mp4", frames, Coding(width_px=1280))
    assert _decoded(tmp_path / "kept.mp4")[1][0].shape == (360, 640, 3)
    for beyond in ({"width_px": 63}, {"crf": -1}, {"crf": 52}):
        with pytest.raises(InputError, match=r"allowed|: "):
            Coding(**beyond)


def _crossing_record(letter):
    vehicles = {EMV: Driven(NORTHBOUND, at_speed(70.0, 10.0, 100)), 2: Driven(EASTBOUND, at_speed(80.0, 5.0, 100))}
    return hand_made(crossing(), vehicles, lambda _: letter * 7)


def _share(frame, colour):
    return float((np.abs(frame.astype(int) - np.array(colour)).max(axis=-1) <= 4).mean())


def test_the_emv_stays_in_the_middle_of_the_picture():
    record = _crossing_record("r")
    for frame in BirdseyeFilm(record, range(0, 100, 20)).frames():
        red = np.abs(frame[60:-60].astype(int) - np.array(rgb_of(EMV_COLOUR)[:3])).max(axis=-1) <= 4
        rows, columns = np.nonzero(red)
        assert len(rows) > 500
        assert abs(np.median(rows) + 60 - SIZE_PX[1] / 2.0) < OFF_CENTRE_PX
        assert abs(np.median(columns) - SIZE_PX[0] / 2.0) < OFF_CENTRE_PX


@pytest.mark.parametrize(("count", "lines"), [(1, 1), (2, 1), (3, 3), (4, 4)])
def test_more_than_two_emvs_have_a_line_each_and_the_title_stays_clear(count, lines):
    vehicles = {
        number: Driven(NORTHBOUND, at_speed(20.0 * number, 1.0, 3), Mode.ROUTE_FOLLOW) for number in range(1, count + 1)
    }
    record = hand_made(crossing(), vehicles)
    ids = tuple(vehicles)
    record = replace(record, description=replace(record.description, emv_ids=ids))
    frame = np.asarray(BirdseyeFilm(record, range(1)).frame(0)).astype(int)
    # A mark in the mode's colour before each text: 14 px high, on the panel.
    colour = frame[20, np.flatnonzero(np.ptp(frame[20], axis=-1) > 60)[0]]
    marks = (np.abs(frame[:130] - colour).max(axis=-1) <= 4).sum(axis=1) >= 13
    assert np.count_nonzero(np.diff(np.concatenate(([0], marks, [0]))) == 1) == lines
    marked = np.flatnonzero(np.abs(frame[20] - colour).max(axis=-1) <= 4)
    assert marked.min() > 300


def test_signals_show_their_state():
    red, green = ((216, 35, 42), (47, 158, 68))
    at_red, at_green = (np.asarray(BirdseyeFilm(_crossing_record(letter), range(1)).frame(40)) for letter in "rG")
    assert _share(at_red, red) > 10.0 * max(_share(at_green, red), 1e-6)
    assert _share(at_green, green) > 0.0003
    assert _share(at_red, green) == 0.0


def test_bars_of_a_lane_stand_in_the_order_of_its_movements():
    """Turning round is the leftmost one, or the rightmost where traffic keeps left."""
    network = _crossing_record("r").network
    lane = next(c.from_lane for c in network.connections if c.signal_id is not None)
    one = replace(next(c for c in network.connections_from[lane] if c.signal_id is not None), direction="s")
    ways = tuple(replace(one, direction=letter, signal_link=link) for link, letter in enumerate("trsl"))
    low, high = (f(network.lanes[lane].centre.points, axis=0) for f in (np.min, np.max))
    for left_hand, order in ((False, [0, 3, 2, 1]), (True, [3, 2, 1, 0])):
        turned = replace(network, connections=ways, left_hand=left_hand)
        bars = signal_bars(turned, draw_map_image(turned, low - 5.0, high + 5.0, 4.0))
        assert [link for _, link, _ in bars] == order


def test_polygons_cover_their_area_with_smooth_edges():
    picture = Image.new("RGB", (40, 40), (0, 0, 0))
    paint_polygons(picture, [(np.array([[10.25, 10.5], [20.25, 10.5], [20.25, 30.5], [10.25, 30.5]]), (200, 200, 200))])
    pixels = np.asarray(picture)[..., 0].astype(float)
    assert (pixels.sum() / 200.0, pixels[20, 15]) == (pytest.approx(200.0, rel=0.12), 200.0)
    assert 0.0 < pixels[10, 15] < 200.0
    beside = Image.new("RGB", (10, 10), (1, 2, 3))
    paint_polygons(beside, [(np.array([[50.0, 50.0], [60.0, 50.0], [60.0, 60.0]]), (255, 0, 0))])
    assert np.unique(np.asarray(beside).reshape(-1, 3), axis=0).tolist() == [[1, 2, 3]]


def test_two_frames_of_the_film_of_a_busy_episode() -> None:
    """Means of red, green and blue in parts of 160 pixels."""
    film = BirdseyeFilm(busy_record(), range(321))
    found = {}
    for step in (100, 160):
        parts = np.asarray(film.frame(step), dtype=float)[..., :3].reshape(9, 80, 8, 160, 3).mean(axis=(1, 3))
        found[str(step)] = [[" ".join(f"{colour:.0f}" for colour in part) for part in row] for row in parts]
    assert_known(Path(__file__).parent / "known" / "film.json", found)
