"""Nine key frames, eight and one."""

import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.key_frames import batches, key_frames


def test_of_a_video_of_190_frames() -> None:
    assert key_frames(190) == (0, 23, 47, 70, 94, 118, 141, 165, 189)
    assert batches(key_frames(190)) == ((0, 23, 47, 70, 94, 118, 141, 165), (189,))


def test_the_shortest_video() -> None:
    assert key_frames(9) == tuple(range(9))
    with pytest.raises(InputError, match="9 frames"):
        key_frames(8)
