from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.interfaces.images import (
    CameraIntrinsics,
    from_camera_info,
    from_compressed_image,
    from_image,
    to_camera_info,
    to_compressed_image,
    to_image,
)


@pytest.mark.parametrize(
    ("shape", "dtype", "encoding"),
    [((3, 5, 3), "u1", "rgb8"), ((3, 5), "u1", "mono8"), ((3, 5), "<u2", "mono16"), ((3, 5), "<f4", "32FC1")],
)
def test_pixels_come_back_as_they_were(
    round_trip: Callable[[object], Any], shape: tuple[int, ...], dtype: str, encoding: str
) -> None:
    pixels = np.arange(np.prod(shape)).reshape(shape).astype(dtype)
    message = round_trip(to_image(7, "camera_front_optical_frame", pixels))
    assert message.encoding == encoding
    assert np.array_equal(from_image(message), pixels)


def test_a_transposed_image_is_stored_in_reading_order() -> None:
    pixels = np.arange(24, dtype=np.uint8).reshape(4, 2, 3).transpose(1, 0, 2)
    assert np.array_equal(from_image(to_image(0, "camera", pixels)), pixels)


def test_refuses_pixels_of_an_unknown_kind() -> None:
    with pytest.raises(InputError, match="pixels"):
        to_image(0, "camera", np.zeros((2, 2, 4), np.uint8))


@pytest.mark.parametrize("change", [{"encoding": "yuv422"}, {"height": 9}, {"step": 1}, {"is_bigendian": 1}])
def test_refuses_images_that_do_not_fit(change: dict[str, object]) -> None:
    message = to_image(0, "camera", np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(InputError, match="image"):
        from_image(replace(message, **change))


def test_jpeg_bytes_pass_unchanged(round_trip: Callable[[object], Any]) -> None:
    jpeg = bytes(range(256))
    message = round_trip(to_compressed_image(2, "camera", jpeg))
    assert (message.format, from_compressed_image(message)) == ("jpeg", jpeg)


def test_intrinsics_come_back(round_trip: Callable[[object], Any]) -> None:
    camera = CameraIntrinsics(800, 600, 335.6, 336.7, 400.0, 300.0)
    message = round_trip(to_camera_info(1, "camera", camera))
    assert from_camera_info(message) == camera
    assert np.array_equal(message.p.reshape(3, 4)[:, :3], camera.matrix)
    assert camera.matrix.tolist() == [[335.6, 0.0, 400.0], [0.0, 336.7, 300.0], [0.0, 0.0, 1.0]]
