"""Films as the sequence model sees them."""

from pathlib import Path

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.sequence.small_frames import HEIGHT, WIDTH, read_small_frames, reduced
from siren_ros.pictures.video import write_video


@pytest.mark.parametrize("factor", [1, 2, 5])
def test_sky_and_bonnet_are_cut_and_blocks_averaged(factor: int) -> None:
    picture = np.zeros((120 * factor, 160 * factor, 3), np.uint8)
    picture[: 40 * factor] = 255
    picture[40 * factor, :factor] = 100
    picture[100 * factor :] = 255
    small = reduced(picture)
    assert small.shape == (HEIGHT, WIDTH)
    assert small[0, 0] == round(100 / factor)
    assert small.sum() == small[0, 0]


def test_grey_is_luma() -> None:
    picture = np.zeros((120, 160, 3), np.uint8)
    picture[..., 1] = 200
    assert (reduced(picture) == round(0.587 * 200)).all()


def test_each_second_frame_of_a_video_is_read_as_it_was_drawn(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    coarse = random.integers(30, 220, (12, 12, 16, 3), dtype=np.uint8)
    drawn = coarse.repeat(20, axis=1).repeat(20, axis=2)
    write_video(tmp_path / "a.mp4", drawn)
    small = read_small_frames(tmp_path / "a.mp4", 12)
    assert small.shape == (6, HEIGHT, WIDTH)
    wanted = np.stack([reduced(picture) for picture in drawn[::2]])
    assert np.abs(small.astype(float) - wanted).mean() < 3.0


def test_what_is_no_film_of_the_front_camera_is_refused(tmp_path: Path) -> None:
    write_video(tmp_path / "a.mp4", np.zeros((4, 120, 160, 3), np.uint8))
    with pytest.raises(InputError, match="5 frames"):
        read_small_frames(tmp_path / "a.mp4", 5)
    write_video(tmp_path / "wide.mp4", np.zeros((4, 96, 160, 3), np.uint8))
    with pytest.raises(InputError, match="160 x 96"):
        read_small_frames(tmp_path / "wide.mp4", 4)
    with pytest.raises(InputError, match="MP4"):
        read_small_frames(tmp_path / "none.mp4", 4)
