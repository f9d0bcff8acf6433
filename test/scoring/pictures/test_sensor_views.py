from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from recorded_episode import quick_template

from siren_ros.errors import InputError
from siren_ros.running.generation.closed_loop import closed_loop, record_of
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.scoring.pictures.sensor_views import cloud_by_instance, observe_at, save_sheet, sheet
from siren_ros.sensing.look import Look
from siren_ros.sensing.suite import SensorSuite, load_suite
from siren_ros.simulation.scenario.episode import EpisodeRequest

LIDAR = load_suite("lidar")


@pytest.fixture(name="record", scope="module")
def _record():
    setup = set_up_episode(EpisodeRequest(quick_template("S2"), seed=0, sensors="none"))
    return record_of(setup, list(closed_loop(setup, 12)))


@pytest.fixture(name="seen", scope="module")
def _seen(record):
    """A picture and a sweep at 0.55 s, when a camera at 10 Hz is not due."""
    camera = replace(load_suite("front").cameras[0], width=160, height=120)
    return observe_at(record, 0.55, SensorSuite("both", LIDAR.lidars, (camera,)), Look())


def test_a_sheet_holds_every_picture_and_two_views_of_the_cloud(record, seen, tmp_path):
    assert seen.step == record.states[10].step
    whole = sheet(seen)
    assert whole.shape == (2 * 600 + 8, 2 * 800 + 8, 3)
    assert np.array_equal(whole[608:, :800], cloud_by_instance(seen.sweeps[0]))
    assert np.array_equal(np.asarray(Image.open(save_sheet(seen, tmp_path / "seen.png"))), whole)


def test_vehicles_have_colours_of_their_own_and_the_rest_is_grey(seen):
    sweep = seen.sweeps[0]
    assert len(np.unique(sweep.points["instance"])) > 1
    spread = np.ptp(cloud_by_instance(sweep).astype(int), axis=2)
    assert (spread > 100).sum() > 20
    bare = replace(sweep, points=sweep.points[sweep.points["instance"] == 0])
    assert np.ptp(cloud_by_instance(bare).astype(int), axis=2).max() < 30


@pytest.mark.parametrize("time_s", [-1.0, 99.0, float("nan")])
def test_a_time_outside_the_episode_is_refused(record, time_s):
    with pytest.raises(InputError, match="time"):
        observe_at(record, time_s, LIDAR, Look())


def test_what_cannot_be_drawn_is_refused(record, seen, tmp_path):
    with pytest.raises(InputError, match="carrier"):
        observe_at(record, 0.0, LIDAR, Look(), carrier_id=60_000)
    nothing = observe_at(record, 0.0, SensorSuite("none"), Look())
    with pytest.raises(InputError, match="suite"):
        sheet(nothing)
    with pytest.raises(InputError, match="out"):
        save_sheet(nothing, tmp_path / "seen.gif")
    with pytest.raises(InputError, match="can be written"):
        save_sheet(seen, tmp_path / "none" / "seen.png")
