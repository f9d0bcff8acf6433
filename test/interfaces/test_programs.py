import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import EpisodeError, InputError
from siren_ros.interfaces.conversions import (
    from_av_control,
    from_path,
    from_predicted_paths,
    to_av_control,
    to_path,
    to_predicted_paths,
)
from siren_ros.interfaces.messages import stamp, typestore
from siren_ros.numerics.geometry import Polyline
from siren_ros.world.carrier import PredictedPaths
from siren_ros.world.commands import AvControl, av_commands

STORE = typestore()
pedals = st.tuples(st.floats(0.0, 1.0), st.booleans()).map(lambda it: (it[0], 0.0) if it[1] else (0.0, it[0]))
controls = st.builds(
    lambda step, pressed, steer_rad, lights: AvControl(step, *pressed, steer_rad, lights),
    st.integers(0, 10**6),
    pedals,
    st.floats(-1.0, 1.0),
    st.sampled_from([0, 2, 4]),
)


def through_cdr(message: Any) -> Any:
    name = message.__msgtype__
    return STORE.deserialize_cdr(STORE.serialize_cdr(message, name), name)


@given(controls)
def test_controls_come_back_and_are_allowed(control):
    control.check()
    assert from_av_control(through_cdr(to_av_control(control))) == control


def test_a_stamp_of_another_step_is_refused():
    message = to_av_control(AvControl(3))
    message.step = 4
    with pytest.raises(EpisodeError, match=r"the stamp 0.15 s is not the time of step 4"):
        from_av_control(message)


def test_a_stamp_that_is_off_by_a_nanosecond_is_shown_to_the_nanosecond():
    message = to_av_control(AvControl(40))
    message.stamp.nanosec += 1
    with pytest.raises(EpisodeError, match=r"the stamp 2.000000001 s is not the time of step 40"):
        from_av_control(message)


def test_nanoseconds_of_a_second_or_more_are_refused_although_the_sum_is_right():
    message = to_av_control(AvControl(40))
    message.stamp.sec, message.stamp.nanosec = 1, 10**9
    with pytest.raises(InputError, match=r"stamp: '1 s and 1000000000 ns' cannot be used"):
        from_av_control(message)


@pytest.mark.parametrize(
    ("control", "named"),
    [
        (AvControl(7, throttle=math.nan), "throttle nan of step 7"),
        (AvControl(7, throttle=1.5), "throttle 1.5 of step 7"),
        (AvControl(7, brake=-0.1), "brake -0.1 of step 7"),
        (AvControl(7, steer_rad=math.inf), "steer_rad inf of step 7"),
        (AvControl(7, lights=16), "lights 16 of step 7"),
    ],
)
def test_what_no_vehicle_can_be_asked_for_is_refused(control, named):
    with pytest.raises(EpisodeError, match=named):
        control.check()


def test_an_answer_drives_the_vehicle_to_the_next_step():
    command = av_commands(AvControl(3, 0.5, 0.0, 0.1, 4), 4, 2)
    assert (command.step, command.actor_id.tolist(), command.throttle.tolist()) == (4, [2], [0.5])
    assert (command.steer_rad.tolist(), command.lights.tolist(), command.owner.tolist()) == ([0.1], [4], [1])


def test_a_way_comes_back_and_its_poses_look_along_it():
    way = Polyline.through([(0.0, 0.0), (10.0, 0.0), (10.0, 5.0)])
    message = through_cdr(to_path(way))
    assert np.array_equal(from_path(message).points, way.points)
    turned = [2.0 * math.atan2(pose.pose.orientation.z, pose.pose.orientation.w) for pose in message.poses]
    assert turned == pytest.approx([0.0, math.pi / 2, math.pi / 2])
    assert {pose.pose.position.z for pose in message.poses} == {0.0}
    assert {pose.header.frame_id for pose in message.poses} == {"map"}


def made(seed: int, paths: int, points: int, step: int = 40) -> PredictedPaths:
    rng = np.random.default_rng(seed)
    ids = rng.integers(1, 2**32 - 1, paths).astype(np.uint32)
    return PredictedPaths(step, ids, rng.random(paths), rng.normal(scale=1e3, size=(paths, points, 2)))


@given(seed=st.integers(0, 1000), paths=st.integers(1, 7), points=st.sampled_from([25, 30, 60]))
def test_paths_come_back_to_the_last_bit(seed, paths, points):
    given_paths = made(seed, paths, points)
    found = from_predicted_paths(through_cdr(to_predicted_paths(given_paths)))
    assert found.step == 40
    for name in ("actor_id", "probability", "xy_m"):
        assert np.array_equal(getattr(found, name), getattr(given_paths, name))
    assert found.actor_id.dtype == np.uint32


def test_nobody_predicted_is_an_empty_message():
    found = from_predicted_paths(through_cdr(to_predicted_paths(made(0, 0, 25))))
    assert len(found) == 0
    assert found.xy_m.shape == (0, 0, 2)


@pytest.mark.parametrize(
    ("field", "told"),
    [
        ("probability", r"paths of step 40 with 3 actor_id, 2 probability, 75 x_m, 75 y_m"),
        ("y_m", "75 x_m, 74 y_m"),
        ("actor_id", "2 actor_id, 3 probability"),
    ],
)
def test_lengths_that_do_not_fit_are_refused(field, told):
    message = to_predicted_paths(made(0, 3, 25))
    setattr(message, field, getattr(message, field)[:-1])
    with pytest.raises(EpisodeError, match=told):
        from_predicted_paths(message)


def test_a_stamp_of_another_step_is_refused_of_predictions():
    message = to_predicted_paths(made(0, 3, 25))
    message.stamp = stamp(0)
    with pytest.raises(EpisodeError, match=r"the stamp 0 s is not the time of step 40"):
        from_predicted_paths(message)
