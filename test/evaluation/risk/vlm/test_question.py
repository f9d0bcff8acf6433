"""Key frames of a video, and outlined vehicles."""

from pathlib import Path

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.video_set import batches, key_frames
from siren_ros.evaluation.risk.vlm.question import as_jpeg, masks_of, numbers_of, outlined, question, video_frames
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


def test_each_number_has_its_colour_and_the_seventh_that_of_the_first() -> None:
    mask = np.zeros((80, 320), np.uint32)
    for number in range(8):
        mask[40:70, 40 * number : 40 * number + 30] = 11 + number
    drawn = outlined(np.full((80, 320, 3), 128, np.uint8), mask, {11 + number: number + 1 for number in range(8)})
    edges = [tuple(drawn[68, 40 * number + 10].tolist()) for number in range(8)]
    assert edges[0] == (230, 60, 40), "red"
    assert len(set(edges[:6])) == 6
    assert edges[6:] == edges[:2]


def test_the_number_stands_above_the_vehicle() -> None:
    """In a box of the contour's colour, around the middle of the columns; at the picture's edge it stays inside."""
    for top, place in ((50, slice(30, 50)), (0, slice(0, 18))):
        mask = np.zeros((100, 100), np.uint32)
        mask[top : top + 40, 30:71] = 5
        drawn = outlined(np.full((100, 100, 3), 128, np.uint8), mask, {5: 1})
        assert (drawn[place, 45:56] == (255, 255, 255)).all(axis=2).any(), "the number is white"
        assert (drawn[place, 40:60] == (230, 60, 40)).all(axis=2).any()


def test_specks_have_no_contour() -> None:
    mask = np.zeros((20, 20), np.uint32)
    mask[5:11, 5:11] = 4
    picture = np.full((20, 20, 3), 128, np.uint8)
    assert (outlined(picture, mask, {4: 1}) == picture).all(), "36 pixels"
    mask[5:11, 11] = 4
    assert (outlined(picture, mask, {4: 1}) != picture).any(), "42 pixels"


def test_times_are_tenths_of_the_frames_numbers() -> None:
    first, last = batches(key_frames(190))
    asked = question(first, marked=False)
    assert asked.startswith("8 pictures, taken at 0.0, 2.3, 4.7, 7.0, 9.4, 11.8, 14.1, 16.5 s of the same drive")
    assert question(last, marked=False).startswith("One picture, taken at 18.9 s of the same drive")


def test_outlines_are_explained_where_there_are_some() -> None:
    assert "outlined" in question((0, 10), marked=True)
    assert "outlined" not in question((0, 10), marked=False)
