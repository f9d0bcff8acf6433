"""``sensor_msgs/PointCloud2`` from and to structured numpy arrays, without copying points one by one."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.errors import InputError
from siren_ros.interfaces.messages import header, make_message, sequence
from siren_ros.numerics.units import time_ns_of_step

_FORMAT_OF_DATATYPE: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""numpy's names of ``sensor_msgs/PointField``'s datatype constants."""
_DATATYPE_OF_FORMAT: Final = {name: datatype for datatype, name in _FORMAT_OF_DATATYPE.items()}


def to_point_cloud(step: int, frame_id: str, points: npt.NDArray[np.void]) -> Any:
    """``sensor_msgs/PointCloud2`` of one sweep.

    Args:
        step: Step whose simulated time becomes the stamp.
        frame_id: Sensor frame.
        points: Structured array of shape ``(N,)``; every field becomes a PointField of the same name.

    Raises:
        InputError: a field's type has no PointField datatype.
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
        header=header(time_ns_of_step(step), frame_id),
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

    Clouds of other programs are read as well: any field offsets, big-endian data, several rows.

    Raises:
        InputError: fields, sizes and data do not fit together.
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
