"""Which frames a step gets, and what a file keeps of them."""

import numpy as np
import pytest
from made_training_frames import SMALL_GRID, made_episode

from siren_ros.errors import InputError
from siren_ros.training.detection.frame_draws import FrameDraws
from siren_ros.training.detection.frame_files import check_apart, frames_among
from siren_ros.training.detection.frame_store import read_frames_file, write_frames


def _draws(seed: int = 0) -> FrameDraws:
    return FrameDraws([made_episode(1, 4), made_episode(2, 3)], SMALL_GRID, seed, 2)


def test_every_frame_comes_once_in_each_turn() -> None:
    draws = _draws()
    rows = [row for step in range(7) for row in draws.rows(step)]
    assert sorted(rows[:7]) == sorted(rows[7:]) == list(range(7))
    assert rows[:7] != rows[7:]


def test_a_step_is_the_same_whenever_it_is_asked_for() -> None:
    (one, target), _ = _draws().batch_of(5)
    (again, same), _ = _draws().batch_of(5)
    assert np.array_equal(one.points, again.points)
    assert np.array_equal(target.heat, same.heat)
    assert not np.array_equal(target.heat, _draws(1).batch_of(5)[0][1].heat)


def test_a_file_keeps_frames_to_two_millimetres(tmp_path) -> None:
    frames = made_episode(4, 2)
    write_frames(tmp_path / "a.npz", frames)
    found = read_frames_file(tmp_path / "a.npz")
    assert (found.about, len(found)) == (frames.about, 2)
    (again,) = frames_among([tmp_path / "a.npz"], tmp_path, SMALL_GRID, print)
    assert np.array_equal(again.frame(1).points, frames.frame(1).points)
    assert np.array_equal(again.frame(1).boxes, frames.frame(1).boxes)
    assert frames.frame(1).points[0, 3] == pytest.approx(0.4, abs=0.002)


def test_what_is_no_file_of_frames_is_refused(tmp_path) -> None:
    (tmp_path / "a.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match="file of frames"):
        frames_among([tmp_path / "a.npz"], tmp_path, SMALL_GRID, print)


def test_seeds_and_maps_of_the_training_do_not_judge() -> None:
    trained = [{"template": "S1", "map": "town", "seed": 4}]
    check_apart(trained, [{"template": "S1", "map": "town", "seed": 5}, {"template": "S1", "map": "b", "seed": 4}])
    with pytest.raises(InputError, match="S2 on town, seed 4"):
        check_apart(trained, [{"template": "S2", "map": "town", "seed": 4}])
