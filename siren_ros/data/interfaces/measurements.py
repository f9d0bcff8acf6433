"""Converts measurements: images and camera models, point clouds, sound, inertial and satellite measurements.

Point clouds are read and written as structured numpy arrays, without copying points one by one.
"""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats
from siren_ros.data.interfaces.messages import header, make_message, sequence, step_of
from siren_ros.data.interfaces.transforms import to_vector
from siren_ros.errors import InputError
from siren_ros.simulation.world.measurements import AudioChunk, CameraIntrinsics, GnssFix, ImuSample

_ENCODINGS: Final[dict[str, tuple[np.dtype[Any], int]]] = {
    "rgb8": (np.dtype("u1"), 3),
    "mono8": (np.dtype("u1"), 1),
    "mono16": (np.dtype("<u2"), 1),
    "32FC1": (np.dtype("<f4"), 1),
}
"""Encodings of ``sensor_msgs/image_encodings.hpp`` that the project writes: element type and number of channels."""


def to_compressed_image(step: int, frame_id: str, jpeg: bytes) -> Any:
    """Makes the message ``sensor_msgs/CompressedImage`` of a JPEG file's bytes."""
    return make_message(
        "sensor_msgs/msg/CompressedImage",
        header=header(step, frame_id),
        format="jpeg",
        data=sequence(np.frombuffer(jpeg, dtype=np.uint8)),
    )


def from_compressed_image(message: Any) -> bytes:
    """Reads the message that ``to_compressed_image`` makes: the bytes of the JPEG file."""
    return np.asarray(message.data, dtype=np.uint8).tobytes()


def to_image(step: int, frame_id: str, pixels: npt.NDArray[np.generic]) -> Any:
    """Makes the message ``sensor_msgs/Image`` of ``(H, W, 3)`` uint8 (``rgb8``) or ``(H, W)`` uint8, uint16, float32.

    Else InputError.
    """
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    encodings = [name for name, kind in _ENCODINGS.items() if kind == (pixels.dtype, channels)]
    if not encodings or pixels.ndim not in {2, 3}:
        allowed = "(H, W, 3) uint8, or (H, W) uint8, uint16 or float32"
        raise InputError("pixels", f"{pixels.shape} {pixels.dtype}", allowed)
    return make_message(
        "sensor_msgs/msg/Image",
        header=header(step, frame_id),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encodings[0],
        is_bigendian=0,
        step=pixels.shape[1] * channels * pixels.dtype.itemsize,
        data=sequence(np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)),
    )


def from_image(message: Any) -> npt.NDArray[np.generic]:
    """Reads the message that ``to_image`` makes: the array, which shares the message's memory.

    Raises InputError for an encoding that the project does not write, or sizes that do not fit the data.
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
    """``sensor_msgs/CameraInfo`` of a camera without distortion (``plumb_bob`` with zero coefficients)."""
    matrix = camera.matrix
    return make_message(
        "sensor_msgs/msg/CameraInfo",
        header=header(step, frame_id),
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
    """Reads the message that ``to_camera_info`` makes."""
    focal_x, _, centre_x, _, focal_y, centre_y = (float(value) for value in message.k[:6])
    return CameraIntrinsics(int(message.width), int(message.height), focal_x, focal_y, centre_x, centre_y)


_FORMAT_OF_DATATYPE: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""numpy's type names for the datatype constants of ``sensor_msgs/PointField``."""
_DATATYPE_OF_FORMAT: Final = {name: datatype for datatype, name in _FORMAT_OF_DATATYPE.items()}


def to_point_cloud(step: int, frame_id: str, points: npt.NDArray[np.void]) -> Any:
    """Makes the message ``sensor_msgs/PointCloud2`` of one sweep, a structured array of shape ``(N,)``.

    Each field becomes a PointField.

    Raises InputError for a field whose type has no PointField datatype.
    """
    dtype = points.dtype
    if dtype.fields is None:
        raise InputError("points", str(dtype), "a structured array")
    fields = []
    for name, (kind, offset, *_) in dtype.fields.items():
        datatype = _DATATYPE_OF_FORMAT.get(kind.str[1:])
        if datatype is None or kind.str[0] == ">":
            raise InputError(f"points.{name}", str(kind), "a little-endian integer or float field")
        fields.append(make_message("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=datatype, count=1))
    return make_message(
        "sensor_msgs/msg/PointCloud2",
        header=header(step, frame_id),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=dtype.itemsize,
        row_step=dtype.itemsize * len(points),
        data=sequence(np.ascontiguousarray(points).view(np.uint8).reshape(-1)),
        is_dense=True,
    )


def from_point_cloud(message: Any) -> npt.NDArray[np.void]:
    """Inverse of ``to_point_cloud``: a structured array over the message's own memory, shape ``(N,)``.

    Clouds of other programs are read as well: any field offsets, big-endian data, several rows. Raises InputError where
    fields, sizes and data do not fit together.
    """
    order = ">" if message.is_bigendian else "<"
    names, formats, offsets = [], [], []
    point_step = int(message.point_step)
    for field in message.fields:
        kind = _FORMAT_OF_DATATYPE.get(int(field.datatype))
        if kind is None or not field.name or field.name in names:
            raise InputError("point cloud field", f"{field.name}:{field.datatype}", "distinct fields of types 1 to 8")
        names.append(str(field.name))
        formats.append(order + kind if field.count <= 1 else f"({int(field.count)},){order}{kind}")
        offsets.append(int(field.offset))
    try:
        layout = {"names": names, "formats": formats, "offsets": offsets, "itemsize": point_step}
        dtype = np.dtype(layout)  # type: ignore[call-overload] # numpy's stubs ask for literal keys
    except (ValueError, TypeError) as error:
        raise InputError("point cloud fields", layout, "fields within the point step") from error
    height, width, row_step = int(message.height), int(message.width), int(message.row_step)
    data = np.frombuffer(message.data, dtype=np.uint8)
    if row_step < width * point_step or len(data) != height * row_step:
        sizes = f"{height}x{width} points of {point_step} bytes in rows of {row_step}, {len(data)} bytes of data"
        raise InputError("point cloud", sizes, "data of height x row_step bytes")
    if height * width == 0:
        return np.empty(0, dtype)
    rows = data.reshape(height, row_step)[:, : width * point_step]
    return np.ascontiguousarray(rows).reshape(-1).view(dtype)


def to_audio(chunk: AudioChunk) -> Any:
    """Makes the message ``siren_msgs/AudioChunk`` of mono 16-bit PCM that ends at the step."""
    return make_message(
        "siren_msgs/msg/AudioChunk",
        header=header(chunk.step, chunk.frame_id),
        sample_rate_hz=chunk.sample_rate_hz,
        samples=sequence(chunk.samples),
    )


def from_audio(message: Any) -> AudioChunk:
    """Reads the message that ``to_audio`` makes."""
    return AudioChunk(
        step=step_of(message),
        frame_id=str(message.header.frame_id),
        sample_rate_hz=int(message.sample_rate_hz),
        samples=np.array(message.samples, dtype=np.int16),
    )


_UNKNOWN: Final = -1.0
"""Value of a covariance's first element that marks a quantity as not measured (``sensor_msgs/Imu``)."""
_STATUS_FIX: Final = 0
_SERVICE_GPS: Final = 1
_COVARIANCE_DIAGONAL_KNOWN: Final = 2


def to_imu(sample: ImuSample) -> Any:
    """Makes the message ``sensor_msgs/Imu`` without orientation, which this sensor does not estimate."""
    return make_message(
        "sensor_msgs/msg/Imu",
        header=header(sample.step, sample.frame_id),
        orientation=make_message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.array([_UNKNOWN, *np.zeros(8)]),
        angular_velocity=to_vector(_triple(sample.angular_rate_radps)),
        angular_velocity_covariance=(np.eye(3) * sample.rate_variance).reshape(-1),
        linear_acceleration=to_vector(_triple(sample.specific_force_mps2)),
        linear_acceleration_covariance=(np.eye(3) * sample.force_variance).reshape(-1),
    )


def from_imu(message: Any) -> ImuSample:
    """Reads the message that ``to_imu`` makes."""
    force, rate = message.linear_acceleration, message.angular_velocity
    return ImuSample(
        step=step_of(message),
        frame_id=str(message.header.frame_id),
        specific_force_mps2=np.array([force.x, force.y, force.z]),
        angular_rate_radps=np.array([rate.x, rate.y, rate.z]),
        force_variance=float(message.linear_acceleration_covariance[0]),
        rate_variance=float(message.angular_velocity_covariance[0]),
    )


def to_nav_sat_fix(fix: GnssFix) -> Any:
    """Makes the message ``sensor_msgs/NavSatFix`` with the covariance in east, north, up."""
    return make_message(
        "sensor_msgs/msg/NavSatFix",
        header=header(fix.step, fix.frame_id),
        status=make_message("sensor_msgs/msg/NavSatStatus", status=_STATUS_FIX, service=_SERVICE_GPS),
        latitude=fix.latitude_deg,
        longitude=fix.longitude_deg,
        altitude=fix.altitude_m,
        position_covariance=np.diag(fix.variance_m2).reshape(-1),
        position_covariance_type=_COVARIANCE_DIAGONAL_KNOWN,
    )


def from_nav_sat_fix(message: Any) -> GnssFix:
    """Reads the message that ``to_nav_sat_fix`` makes."""
    return GnssFix(
        step=step_of(message),
        frame_id=str(message.header.frame_id),
        latitude_deg=float(message.latitude),
        longitude_deg=float(message.longitude),
        altitude_m=float(message.altitude),
        variance_m2=np.asarray(message.position_covariance, dtype=np.float64).reshape(3, 3).diagonal().copy(),
    )


def _triple(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
