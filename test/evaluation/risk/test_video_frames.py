from pathlib import Path

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.video_set import batches, film_frames, key_frames
from siren_ros.pictures.video import write_video


@pytest.fixture
def film(tmp_path: Path) -> Path:
    """Three pictures, each brighter than the one before."""
    path = tmp_path / "film.mp4"
    write_video(path, (np.full((64, 64, 3), 60 * number, np.uint8) for number in range(3)))
    return path


def test_frames_come_in_their_order(film: Path) -> None:
    brightness = [frame.to_ndarray(format="gray").mean() for frame in film_frames(film, 3)]
    assert brightness == pytest.approx([0.0, 60.0, 120.0], abs=3.0)


@pytest.mark.parametrize("count", [2, 4])
def test_another_number_of_frames_is_refused(film: Path, count: int) -> None:
    with pytest.raises(InputError, match=f"3 frames.*{count} frames"):
        list(film_frames(film, count))


@pytest.mark.parametrize("content", [None, b"", b"no film"])
def test_what_is_no_film_is_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "film.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match="an MP4 file"):
        list(film_frames(path, 1))


def test_of_a_video_of_190_frames() -> None:
    assert key_frames(190) == (0, 23, 47, 70, 94, 118, 141, 165, 189)
    assert batches(key_frames(190)) == ((0, 23, 47, 70, 94, 118, 141, 165), (189,))


def test_the_shortest_video() -> None:
    assert key_frames(9) == tuple(range(9))
    with pytest.raises(InputError, match="9 frames"):
        key_frames(8)
