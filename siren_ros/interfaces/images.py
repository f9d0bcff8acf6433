"""Camera messages: compressed and raw images, and the pinhole model of a camera."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.errors import InputError
from siren_ros.interfaces.messages import header, make_message, sequence
from siren_ros.numerics.units import time_ns_of_step

_ENCODINGS: Final[dict[str, tuple[np.dtype[Any], int]]] = {
    "rgb8": (np.dtype("u1"), 3),
    "mono8": (np.dtype("u1"), 1),
    "mono16": (np.dtype("<u2"), 1),
    "32FC1": (np.dtype("<f4"), 1),
}
"""Encodings of ``sensor_msgs/image_encodings.hpp`` that the project writes: element type and channels."""


@dataclass(frozen=True)
class CameraIntrinsics:
    """Intrinsics of an ideal camera: no distortion, principal point in pixels from the top left corner."""

    width: int
    height: int
    focal_x_px: float
    focal_y_px: float
    centre_x_px: float
    centre_y_px: float

    @property
    def matrix(self) -> npt.NDArray[np.float64]:
        """``pixels = matrix @ point`` for points in the optical frame, shape ``(3, 3)``."""
        return np.array(
            [[self.focal_x_px, 0.0, self.centre_x_px], [0.0, self.focal_y_px, self.centre_y_px], [0.0, 0.0, 1.0]]
        )


def to_compressed_image(step: int, frame_id: str, jpeg: bytes) -> Any:
    """``sensor_msgs/CompressedImage`` of a JPEG file's bytes."""
    return make_message(
        "sensor_msgs/msg/CompressedImage",
        header=header(time_ns_of_step(step), frame_id),
        format="jpeg",
        data=sequence(np.frombuffer(jpeg, dtype=np.uint8)),
    )


def from_compressed_image(message: Any) -> bytes:
    """Inverse of ``to_compressed_image``: the JPEG file's bytes."""
    return np.asarray(message.data, dtype=np.uint8).tobytes()


def to_image(step: int, frame_id: str, pixels: npt.NDArray[np.generic]) -> Any:
    """``sensor_msgs/Image``.

    Args:
        step: Step whose simulated time becomes the stamp.
        frame_id: Optical frame of the camera.
        pixels: ``(H, W, 3)`` uint8 for colour (``rgb8``); ``(H, W)`` uint8, uint16 or float32 otherwise.

    Raises:
        InputError: an array of another kind.
    """
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    found = [name for name, kind in _ENCODINGS.items() if kind == (pixels.dtype, channels)]
    if not found or pixels.ndim not in {2, 3}:
        allowed = "(H, W, 3) uint8, or (H, W) uint8, uint16 or float32"
        raise InputError("pixels", f"{pixels.shape} {pixels.dtype}", allowed)
    return make_message(
        "sensor_msgs/msg/Image",
        header=header(time_ns_of_step(step), frame_id),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=found[0],
        is_bigendian=0,
        step=pixels.shape[1] * channels * pixels.dtype.itemsize,
        data=sequence(np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)),
    )


def from_image(message: Any) -> npt.NDArray[np.generic]:
    """Inverse of ``to_image``: the array, over the message's own memory.

    Raises:
        InputError: an encoding that the project does not write, or sizes that do not fit the data.
    """
    if message.encoding not in _ENCODINGS or message.is_bigendian:
        raise InputError("image encoding", message.encoding, f"little-endian {', '.join(_ENCODINGS)}")
    dtype, channels = _ENCODINGS[message.encoding]
    height, width = int(message.height), int(message.width)
    data = np.frombuffer(message.data, dtype=np.uint8)
    row = width * channels * dtype.itemsize
    if int(message.step) != row or len(data) != height * row:
        sizes = f"{width}x{height} {message.encoding}, rows of {message.step} bytes, {len(data)} bytes"
        raise InputError("image", sizes, "data of height x step bytes")
    shape = (height, width, channels) if channels > 1 else (height, width)
    return data.view(dtype).reshape(shape)


def to_camera_info(step: int, frame_id: str, camera: CameraIntrinsics) -> Any:
    """``sensor_msgs/CameraInfo`` of an ideal camera (``plumb_bob`` with zero coefficients)."""
    matrix = camera.matrix
    return make_message(
        "sensor_msgs/msg/CameraInfo",
        header=header(time_ns_of_step(step), frame_id),
        height=camera.height,
        width=camera.width,
        distortion_model="plumb_bob",
        d=sequence(np.zeros(5)),
        k=matrix.reshape(-1),
        r=np.eye(3).reshape(-1),
        p=np.hstack((matrix, np.zeros((3, 1)))).reshape(-1),
        binning_x=0,
        binning_y=0,
        roi=make_message(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )


def from_camera_info(message: Any) -> CameraIntrinsics:
    """Inverse of ``to_camera_info``."""
    focal_x, _, centre_x, _, focal_y, centre_y = (float(value) for value in message.k[:6])
    return CameraIntrinsics(int(message.width), int(message.height), focal_x, focal_y, centre_x, centre_y)
