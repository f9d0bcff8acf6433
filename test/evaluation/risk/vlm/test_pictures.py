"""Key frames of a video, and outlined vehicles."""

from pathlib import Path

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.vlm.pictures import as_jpeg, masks_of, numbers_of, outlined, video_frames
from siren_ros.pictures.video import write_video


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Twenty frames that become brighter."""
    path = tmp_path / "v.mp4"
    write_video(path, (np.full((64, 96, 3), 10 * number, np.uint8) for number in range(20)))
    return path


def test_the_wanted_frames_in_their_order(video: Path) -> None:
    first, last = video_frames(video, (3, 19), 20)
    assert first.shape == (64, 96, 3)
    assert first.mean() == pytest.approx(30.0, abs=3.0)
    assert last.mean() == pytest.approx(190.0, abs=3.0)


def test_another_length_or_no_video_is_refused(video: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="20 frames"):
        video_frames(video, (3,), 21)
    with pytest.raises(InputError, match=r"none\.mp4"):
        video_frames(tmp_path / "none.mp4", (3,), 20)
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(b"no video")
    with pytest.raises(InputError, match=r"broken\.mp4"):
        video_frames(broken, (3,), 20)


def test_numbers_by_size_without_specks() -> None:
    mask = np.zeros((50, 60), np.uint32)
    mask[5:25, 5:25], mask[30:45, 30:50], mask[0, 0] = 17, 12, 9
    assert numbers_of([mask, mask]) == {17: 1, 12: 2}


def test_contours_are_drawn_around_vehicles_alone() -> None:
    mask = np.zeros((80, 100), np.uint32)
    mask[30:70, 20:60] = 7
    picture = np.full((80, 100, 3), 128, np.uint8)
    drawn = outlined(picture, mask, {7: 1})
    changed = (drawn != picture).any(axis=2)
    assert changed[30:70, 20:22].all()
    assert changed[68:70, 20:60].all()
    assert not changed[35:65, 25:55].any()
    assert not changed[:, 70:].any()
    assert not (outlined(picture, mask, {}) != picture).any()
    assert as_jpeg(drawn) == as_jpeg(drawn)


def test_masks_are_read_back(tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    mask = np.arange(12, dtype=np.uint32).reshape(3, 4)
    np.savez_compressed(path, frame_007=mask)
    assert (masks_of(path, (7,))[0] == mask).all()
    for wanted, file in (((8,), path), ((7,), tmp_path / "none.npz")):
        with pytest.raises(InputError, match="masks"):
            masks_of(file, wanted)
