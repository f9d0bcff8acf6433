"""What sensors measured: thinned to what a page may hold, and drawn in a browser where the bag has it."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import simplejpeg
from browser_pages import OpenedPage, PageBrowser
from datasets.made_bag import (
    FIRST_SENSED,
    FRONT,
    LIDAR_M,
    MODEL,
    REAR,
    BagSpec,
    av_place_of,
    jpeg_of,
    place_of,
    sweep_of,
    write_made_bag,
    yaw_of,
)
from episode_page.unpacked import unpacked
from PIL import Image
from rosbags.typesys.store import Typestore

from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import BagError, InputError
from siren_ros.reports.episode_page import sensed as module
from siren_ros.reports.episode_page.build import episode_data, episode_page
from siren_ros.reports.episode_page.sensed import ALL, CUBE_M, NOTHING, UNIT_M, sensed_of, smaller

STEPS = list(range(FIRST_SENSED, 42, 4))


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> Path:
    return write_made_bag(tmp_path_factory.mktemp("sensed") / "bag", typestore)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> Path:
    """With sensors on the EMV and on an AV."""
    return write_made_bag(tmp_path_factory.mktemp("both") / "bag", typestore, BagSpec(av=True))


def points_in_map(step: int, place_m: tuple[float, float, float], yaw_rad: float) -> np.ndarray:
    """The returns of a made sweep, shape ``(6, 3)``."""
    points = sweep_of(step)
    x, y = points["x"] + LIDAR_M[0], points["y"] + LIDAR_M[1]
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    places = np.stack((cos * x - sin * y, sin * x + cos * y, points["z"] + LIDAR_M[2]), axis=-1)
    return places + place_m


def on_emv(step: int) -> np.ndarray:
    return points_in_map(step, place_of(step), yaw_of(step))


def on_av(step: int) -> np.ndarray:
    return points_in_map(step, av_place_of(step), yaw_of(step) - 0.5 * np.pi)


def check_points(found: np.ndarray, wanted: np.ndarray) -> None:
    """Each found point is one of those wanted, and one is found near each of those."""
    apart = found[:, None, :] - wanted[None, :, :]
    assert np.abs(apart).max(axis=2).min(axis=1).max() <= 0.5 * UNIT_M + 1e-5
    assert np.abs(apart).max(axis=2).min(axis=0).max() <= CUBE_M


def test_points_stand_where_they_were_measured_and_pictures_are_those_of_the_camera(bag: Path) -> None:
    sensed = sensed_of(bag, ["lidar"])
    assert [sweep.step for sweep in sensed.sweeps["lidar"]] == STEPS
    assert sensed.pictures == {}
    for sweep in sensed.sweeps["lidar"]:
        check_points(sweep.counts * UNIT_M + sweep.origin_m, on_emv(sweep.step))
        assert sweep.measured == 6
    sensed = sensed_of(bag, [REAR])
    assert (sensed.sweeps, list(sensed.pictures)) == ({}, [REAR])
    assert [shot.step for shot in sensed.pictures[REAR]] == STEPS
    for shot in sensed.pictures[REAR]:
        pixels = simplejpeg.decode_jpeg(shot.jpeg).astype(int)
        assert pixels.shape == (MODEL.height, MODEL.width, 3)
        assert np.abs(pixels - simplejpeg.decode_jpeg(jpeg_of(shot.step, REAR))).max() <= 6
    assert list(sensed_of(bag, [ALL]).pictures) == [FRONT, REAR]


def test_the_av_has_sensors_of_its_own(both: Path) -> None:
    sensed = sensed_of(both, ["av/lidar", f"av/{FRONT}"])
    assert list(sensed.sweeps) == ["av/lidar"]
    for sweep in sensed.sweeps["av/lidar"]:
        check_points(sweep.counts * UNIT_M + sweep.origin_m, on_av(sweep.step))
    for shot in sensed.pictures[f"av/{FRONT}"]:
        pixels = simplejpeg.decode_jpeg(shot.jpeg).astype(int)
        assert np.abs(pixels - simplejpeg.decode_jpeg(jpeg_of(shot.step, REAR))).max() <= 6
    everything = sensed_of(both, [ALL])
    assert list(everything.sweeps) == ["lidar", "av/lidar"]
    assert list(everything.pictures) == [FRONT, REAR, f"av/{FRONT}"]


def test_one_point_stays_in_each_cube() -> None:
    xyz_m = np.array(
        [[0.05, 0.05, 0.05], [0.25, 0.25, 0.25], [0.35, 0.05, 0.05], [np.nan, 0, 0], [2000, 0, 0], [-0.05, 0, 0]]
    )
    pose = np.eye(4)
    pose[:3, 3] = 7.004, -2.0, 0.0
    with np.errstate(invalid="ignore"):
        sweep = module.sweep_of(3, xyz_m, pose, pose)
    assert (sweep.origin_m, sweep.measured) == ((7.0, -2.0, 0.0), 6)
    assert sorted(map(tuple, sweep.counts.tolist())) == [(-5, 0, 0), (5, 5, 5), (35, 5, 5)]


def test_what_the_bag_lacks_and_what_is_no_picture_are_refused(
    bag: Path, tmp_path: Path, typestore: Typestore, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="of those of the bag: lidar, camera_front, camera_rear"):
        sensed_of(bag, ["radar"])
    lost = write_made_bag(tmp_path / "lost", typestore, lacking=lambda topic, step: (topic, step) == ("/tf", 8))
    with pytest.raises(BagError, match="pose on /tf at each sweep"):
        sensed_of(lost, ["lidar"])
    without = write_made_bag(
        tmp_path / "bag", typestore, lacking=lambda topic, _: "camera" in topic or "lidar" in topic
    )
    with pytest.raises(InputError, match="the bag has no LiDAR and no camera"):
        sensed_of(without, ["lidar"])
    assert sensed_of(without, [ALL]) == NOTHING
    monkeypatch.setattr(module, "from_compressed_image", lambda _: b"no picture")
    with pytest.raises(BagError):
        sensed_of(bag, [FRONT])


def test_large_pictures_get_smaller() -> None:
    pixels = np.full((600, 800, 3), (200, 40, 90), np.uint8)
    pixels[:, 400:] = 10, 220, 30
    jpeg = smaller(simplejpeg.encode_jpeg(pixels))
    small = np.asarray(Image.open(io.BytesIO(jpeg))).astype(int)
    assert small.shape == (360, 480, 3)
    assert np.abs(small[180, 100] - (200, 40, 90)).max() <= 4
    assert np.abs(small[180, 400] - (10, 220, 30)).max() <= 4
    with pytest.raises(ValueError, match="9000"):
        smaller(simplejpeg.encode_jpeg(np.zeros((1, 9000, 3), np.uint8)))


def test_time_is_thinned_until_it_fits(bag: Path) -> None:
    whole = sensed_of(bag, [ALL])
    items = [*whole.sweeps["lidar"], *(shot for shots in whole.pictures.values() for shot in shots)]
    size_mb = sum(item.size_bytes for item in items) / 1e6
    assert whole.notes[0] == ("lidar", "a sweep every 0.2 s, 6 of 6 points, one in 0.3 m")
    assert len(sensed_of(bag, [ALL], size_mb).sweeps["lidar"]) == len(STEPS)
    less = sensed_of(bag, [ALL], 0.99 * size_mb)
    assert [sweep.step for sweep in less.sweeps["lidar"]] == [4, 12, 20, 32, 40]
    assert [shot.step for shot in less.pictures[FRONT]] == [4, 12, 20, 32, 40]
    assert less.notes[1][1].startswith(f"a picture every 0.5 s, so that they fit into {0.99 * size_mb:g} MB")
    none = sensed_of(bag, [ALL], 1e-5)
    assert (none.sweeps, none.pictures) == ({}, {})
    assert none.notes == tuple((name, "left out: more than 1e-05 MB") for name in ("lidar", FRONT, REAR))


def test_the_page_has_bytes_and_points_as_they_are(bag: Path) -> None:
    sensed = sensed_of(bag, [ALL])
    head, columns = unpacked(episode_data(read_episode(bag), sensed=sensed))
    (lidar,), sweeps = head["sensed"]["lidars"], sensed.sweeps["lidar"]
    assert [entry[:2] for entry in lidar["sweeps"]] == [[sweep.step, len(sweep.counts)] for sweep in sweeps]
    assert columns["sweep.0.y"] == pytest.approx(np.concatenate([sweep.counts[:, 1] for sweep in sweeps]) * UNIT_M)
    assert columns["pictures.1"].tobytes() == b"".join(shot.jpeg for shot in sensed.pictures[REAR])
    assert ["lidar", sensed.notes[0][1]] in head["facts"]
    assert "sensed" not in unpacked(episode_data(read_episode(bag)))[0]


@pytest.fixture(scope="module")
def opened(both: Path, browser: PageBrowser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpenedPage]:
    path = tmp_path_factory.mktemp("page") / "episode.html"
    path.write_text(episode_page(read_episode(both), sensed=sensed_of(both, [ALL])), encoding="utf-8")
    with browser.opened(path) as page:
        page.page.locator("#wait").wait_for(state="hidden")
        yield page


@pytest.mark.parametrize(("time_s", "step"), [(0.2, 4), (0.39, 4), (0.4, 8), (1.33, 24), (2.05, 40)])
def test_the_points_that_are_drawn_are_those_of_the_bag(opened: OpenedPage, time_s: float, step: int) -> None:
    drawn = opened.page.evaluate("time => { episodePage.seek(time); return episodePage.drawnPoints(); }", time_s)
    check_points(np.array(drawn), np.concatenate((on_emv(step), on_av(step))))


def colour_of_picture(opened: OpenedPage, wanted: str) -> list[int]:
    """The colour in the middle, once a camera's picture is shown."""
    wait = f"""() => new Promise(done => {{
        const look = () => episodePage.sensors.pictures.drawn === '{wanted}' ? done() : requestAnimationFrame(look);
        look();
    }})"""
    opened.page.evaluate(wait)
    script = """canvas => {
        const copy = new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
        copy.drawImage(canvas, -canvas.width / 2, -canvas.height / 2);
        return [...copy.getImageData(0, 0, 1, 1).data];
    }"""
    return opened.page.locator("#picture-canvas").evaluate(script)[:3]


def test_the_picture_follows_the_clock_and_the_choice(opened: OpenedPage) -> None:
    opened.page.evaluate("episodePage.seek(1.45)")
    assert colour_of_picture(opened, "0 6") == pytest.approx((5 * 28, 120, 200), abs=8)
    opened.page.evaluate("episodePage.seek(0.85)")
    assert colour_of_picture(opened, "0 3") == pytest.approx((5 * 16, 120, 200), abs=8)
    opened.page.select_option("#picture-camera", REAR)
    assert colour_of_picture(opened, "1 3") == pytest.approx((5 * 16, 120, 40), abs=8)
    assert opened.problems == []
    assert opened.requests == [], "nothing is loaded, not even from the page itself"


def test_points_and_picture_can_be_hidden(opened: OpenedPage) -> None:
    assert opened.page.evaluate("() => { episodePage.seek(0.1); return episodePage.drawnPoints(); }") == []
    opened.page.evaluate("episodePage.seek(1)")
    calls = """() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(
        () => done(episodePage.statistics().calls))))"""
    before = opened.page.evaluate(calls)
    opened.page.locator("#scene").focus()
    opened.page.keyboard.press("l")
    assert opened.page.evaluate(calls) == before - 2, "one draw call for each LiDAR"
    assert opened.page.locator("#show-sweeps").get_attribute("aria-pressed") == "false"
    opened.page.click("#show-sweeps")
    assert opened.page.evaluate(calls) == before
    opened.page.keyboard.press("c")
    assert not opened.page.locator("#picture").is_visible()
    opened.page.click("#show-pictures")
    assert opened.page.locator("#picture").is_visible()
