"""Converts measurements and frames: images, point clouds, sound, inertial and satellite measurements, odometry, TF.

Point clouds are read and written as structured numpy arrays, without copying points one by one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Matrix
from siren_ros.data.interfaces.messages import header, make_message, sequence
from siren_ros.data.interfaces.wire import COUNT, STAMPED, CdrWriter, Layout, stamped, text
from siren_ros.errors import InputError
from siren_ros.simulation.world.carrier import (
    BASE_FRAME,
    ODOM_FRAME,
    AudioChunk,
    CameraIntrinsics,
    GnssFix,
    ImuSample,
    Odometry,
)

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""A quaternion as x, y, z, w."""


@dataclass(frozen=True)
class Transform:
    """A transform between frames: ``point_in_parent = rotation · point_in_child + translation``."""

    parent: str
    child: str
    translation_m: Vector
    rotation_xyzw: Quaternion


def quaternion_of_yaw(yaw_rad: float) -> Quaternion:
    """Rotation about the vertical axis, counter-clockwise."""
    return 0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0)


def yaw_of_quaternion(quaternion: Quaternion) -> float:
    """Inverse of ``quaternion_of_yaw``, within (−π, π]; roll and pitch are ignored."""
    x, y, z, w = quaternion
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def quaternion_of_matrix(rotation: Floats) -> Quaternion:
    """Unit quaternion with w ≥ 0 of a rotation matrix of shape ``(3, 3)``."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - this import takes a quarter of a node's loading time

    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return float(x), float(y), float(z), float(w)


def matrix_of_quaternion(quaternion: Quaternion) -> Floats:
    """Rotation matrix, shape ``(3, 3)``."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - as above

    matrix: Floats = Rotation.from_quat(quaternion).as_matrix()
    return matrix


def to_vector(vector: Sequence[float]) -> Any:
    """Makes the message ``geometry_msgs/Vector3``."""
    x, y, z = (float(value) for value in vector)
    return make_message("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def to_quaternion(quaternion: Quaternion) -> Any:
    """Makes the message ``geometry_msgs/Quaternion``."""
    x, y, z, w = (float(value) for value in quaternion)
    return make_message("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def to_pose(position_m: Sequence[float], quaternion: Quaternion) -> Any:
    """Makes the message ``geometry_msgs/Pose``."""
    x, y, z = (float(value) for value in position_m)
    return make_message(
        "geometry_msgs/msg/Pose",
        position=make_message("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=to_quaternion(quaternion),
    )


def from_vector(message: Any) -> Vector:
    """Reads the message that ``to_vector`` makes; reads a ``geometry_msgs/Point`` as well."""
    return float(message.x), float(message.y), float(message.z)


def from_quaternion(message: Any) -> Quaternion:
    """Reads the message that ``to_quaternion`` makes."""
    return float(message.x), float(message.y), float(message.z), float(message.w)


_TRANSFORM: Final = Layout(f"{STAMPED} s 3d 4d")


def to_tf(step: int, transforms: Sequence[Transform]) -> bytes:
    """Transforms that hold at one step, as ``tf2_msgs/TFMessage`` in CDR."""
    writer = CdrWriter()
    writer.put(COUNT, len(transforms))
    for item in transforms:
        places = (*item.translation_m, *item.rotation_xyzw)
        writer.put(_TRANSFORM, *stamped(step, item.parent), text(item.child), *places)
    return writer.cdr()


def from_tf(message: Any) -> tuple[Transform, ...]:
    """Reads the message that ``to_tf`` makes."""
    return tuple(
        Transform(
            parent=str(stamped.header.frame_id),
            child=str(stamped.child_frame_id),
            translation_m=from_vector(stamped.transform.translation),
            rotation_xyzw=from_quaternion(stamped.transform.rotation),
        )
        for stamped in message.transforms
    )


def matrix_of_transform(transform: Transform) -> Matrix:
    """Matrix that converts points in the child to points in the parent, shape ``(4, 4)``."""
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_of_quaternion(transform.rotation_xyzw)
    matrix[:3, 3] = transform.translation_m
    return matrix


def matrix_between(transforms: Sequence[Transform], parent: str, child: str) -> Matrix:
    """Matrix that converts points in ``child`` to points in ``parent`` through the frames between them, ``(4, 4)``.

    Raises InputError where the transforms do not lead from one to the other.
    """
    by_child = {transform.child: transform for transform in transforms}
    matrix, frame = np.eye(4), child
    while frame != parent:
        if frame not in by_child:
            raise InputError("frames", child, f"a frame with a chain of transforms from {parent}")
        transform = by_child.pop(frame)
        matrix, frame = matrix_of_transform(transform) @ matrix, transform.parent
    return matrix


_CONSTRAINED_VARIANCE: Final = 1e-6
"""Variance of z, roll and pitch, (1 mm)² and (1 mrad)². The world is flat, but filters need an invertible matrix."""
_CONSTRAINED: Final[list[float]] = (np.eye(6) * _CONSTRAINED_VARIANCE).ravel().tolist()
_PLANAR: Final = np.ix_([0, 1, 5], [0, 1, 5])
"""Indices of x, y and yaw in a covariance of x, y, z and rotations about x, y, z."""
_PLANAR_PLACES: Final[list[int]] = np.arange(36).reshape(6, 6)[_PLANAR].ravel().tolist()


_ODOMETRY: Final = Layout(f"{STAMPED} s 7d 36d 6d 36d")


def to_odometry(step: int, odometry: Odometry, parent: str = ODOM_FRAME, child: str = BASE_FRAME) -> bytes:
    """``nav_msgs/Odometry`` as CDR: pose and its covariance in ``parent``, velocity and its covariance in ``child``."""
    writer = CdrWriter()
    writer.put(
        _ODOMETRY,
        *stamped(step, parent),
        text(child),
        *(odometry.x_m, odometry.y_m, 0.0, *quaternion_of_yaw(odometry.yaw_rad)),
        *_to_covariance(odometry.pose_covariance),
        *(odometry.forward_mps, odometry.left_mps, 0.0, 0.0, 0.0, odometry.yaw_rate_radps),
        *_to_covariance(odometry.twist_covariance),
    )
    return writer.cdr()


def _to_covariance(planar: Floats) -> list[float]:
    """Expand a covariance of x, y and yaw to the message's 36 elements, row by row."""
    full = _CONSTRAINED.copy()
    for place, value in zip(_PLANAR_PLACES, planar.ravel().tolist(), strict=True):
        full[place] = value
    return full


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


_AUTOWARE: Final = [
    *(("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "u1"), ("return_type", "u1"), ("channel", "<u2")),
    *(("azimuth", "<f4"), ("elevation", "<f4"), ("distance", "<f4"), ("time_stamp", "<u4")),
]
"""Fields of Autoware's ``PointXYZIRCAEDT``; the first six are those of ``PointXYZIRC`` (``autoware_point_types``)."""
_AS_READ: Final = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("instance", "<u2")]
_STRONGEST, _FULL = 1, 255.0
"""Autoware's ``ReturnType::SINGLE_STRONGEST``, and its intensity where ours is 1."""


def in_layout(points: npt.NDArray[np.void], layout: str, turn_s: float) -> npt.NDArray[np.void]:
    """The points of a sweep in one of ``POINT_LAYOUTS``, shape ``(N,)``; in metres, radians and nanoseconds.

    Time stamps count from the begin of a rotation that takes ``turn_s``; they are 0 where it takes no time.
    """
    if layout not in {"xyzirc", "xyzircaedt"}:
        return points
    x, y, z, time_s = (points[name].astype(np.float64) for name in ("x", "y", "z", "time"))
    flat_m = np.hypot(x, y)
    kinds = _AUTOWARE if layout == "xyzircaedt" else _AUTOWARE[:6]
    columns = [x, y, z, np.rint(_FULL * points["intensity"]), _STRONGEST, points["ring"]]
    columns += [np.arctan2(y, x) % (2.0 * np.pi), np.arctan2(z, flat_m), np.hypot(flat_m, z)]
    columns += [np.rint(1e9 * np.clip(time_s + turn_s, 0.0, turn_s))]
    made = np.empty(len(points), kinds)
    for (name, _), column in zip(kinds, columns, strict=False):
        made[name] = column
    return made


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

    Clouds of other programs are read as well: any field offsets, big-endian data, several rows. Of Autoware's
    layouts it gives place, intensity and ring, and no actor. Raises InputError where
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
    points = np.empty(0, dtype)
    if height * width > 0:
        rows = data.reshape(height, row_step)[:, : width * point_step]
        points = np.ascontiguousarray(rows).reshape(-1).view(dtype)
    if "return_type" not in names or "channel" not in names:
        return points
    made = np.zeros(len(points), _AS_READ)
    made["x"], made["y"], made["z"], made["ring"] = points["x"], points["y"], points["z"], points["channel"]
    made["intensity"] = points["intensity"] / _FULL
    return made


def to_audio(chunk: AudioChunk) -> Any:
    """Makes the message ``siren_msgs/AudioChunk`` of mono 16-bit PCM that ends at the step."""
    return make_message(
        "siren_msgs/msg/AudioChunk",
        header=header(chunk.step, chunk.frame_id),
        sample_rate_hz=chunk.sample_rate_hz,
        samples=sequence(chunk.samples),
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


def _triple(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
