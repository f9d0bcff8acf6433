"""``sensor_msgs/msg/PointCloud2`` to numpy arrays and back; the functions and arguments are those of ROS's module."""

import sys
from collections import namedtuple
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured
from sensor_msgs.msg import PointCloud2, PointField

Array = np.ndarray[Any, Any]
DATATYPES: Final[dict[int, np.dtype[Any]]] = {
    PointField.INT8: np.dtype(np.int8),
    PointField.UINT8: np.dtype(np.uint8),
    PointField.INT16: np.dtype(np.int16),
    PointField.UINT16: np.dtype(np.uint16),
    PointField.INT32: np.dtype(np.int32),
    PointField.UINT32: np.dtype(np.uint32),
    PointField.FLOAT32: np.dtype(np.float32),
    PointField.FLOAT64: np.dtype(np.float64),
}
XYZ_FIELDS: Final = tuple(
    PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1) for index, name in enumerate("xyz")
)


def dtype_from_fields(fields: Iterable[PointField], point_step: int | None = None) -> np.dtype[Any]:
    """The structured type of a point. A field of several values becomes the fields ``name_0``, ``name_1``, ...

    Args:
        fields: As in a cloud.
        point_step: Bytes from one point to the next; None: the fields have no gap behind them.
    """
    names: list[str] = []
    formats: list[np.dtype[Any]] = []
    offsets: list[int] = []
    for index, field in enumerate(fields):
        kind = DATATYPES[field.datatype]
        name = field.name or f"unnamed_field_{index}"
        count = max(1, field.count)
        for part in range(count):
            names.append(name if count == 1 else f"{name}_{part}")
            formats.append(kind)
            offsets.append(field.offset + part * kind.itemsize)
    end = max((offset + kind.itemsize for offset, kind in zip(offsets, formats, strict=True)), default=0)
    itemsize = end if point_step is None else point_step
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": itemsize})


def read_points(
    cloud: PointCloud2,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[Any] | None = None,
    reshape_organized_cloud: bool = False,
) -> Array:
    """The points of a cloud as a structured array.

    Args:
        cloud: The message.
        field_names: Fields to return; None: all.
        skip_nans: Leave out points with a NaN in a returned field.
        uvs: Indices of the points to return, or pairs of column and row; None: all.
        reshape_organized_cloud: Return rows and columns (height, width) of an organized cloud.
    """
    row_bytes = np.frombuffer(memoryview(cloud.data), dtype=np.uint8).reshape(cloud.height, cloud.row_step)
    packed = np.ascontiguousarray(row_bytes[:, : cloud.width * cloud.point_step])
    points: Array = np.ndarray(
        shape=(cloud.height * cloud.width,), dtype=dtype_from_fields(cloud.fields, cloud.point_step), buffer=packed
    )
    if cloud.is_bigendian != (sys.byteorder == "big"):
        points = points.byteswap()
    if field_names is not None:
        points = points[list(field_names)]
    if uvs is not None:
        pixels = np.asarray(list(uvs) if not isinstance(uvs, np.ndarray) else uvs)
        points = points[pixels[:, 1] * cloud.width + pixels[:, 0] if pixels.ndim == 2 else pixels]
    if skip_nans and not cloud.is_dense:
        names = points.dtype.names or ()
        points = points[~np.any([np.isnan(points[name]) for name in names], axis=0)]
    if reshape_organized_cloud and cloud.height > 1:
        points = points.reshape(cloud.height, cloud.width)
    return points


def read_points_numpy(
    cloud: PointCloud2,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[Any] | None = None,
    reshape_organized_cloud: bool = False,
) -> Array:
    """The points as an array of shape (points, fields); all returned fields have one type. Args: ``read_points``."""
    names = [field.name for field in cloud.fields] if field_names is None else list(field_names)
    kinds = {field.datatype for field in cloud.fields if field.name in names}
    if len(kinds) > 1:
        raise AssertionError("All fields need to have the same datatype. Use `read_points()` otherwise.")
    return structured_to_unstructured(read_points(cloud, field_names, skip_nans, uvs, reshape_organized_cloud))


def read_points_list(
    cloud: PointCloud2,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[Any] | None = None,
) -> list[Any]:
    """The points as named tuples. Args: ``read_points``."""
    points = read_points(cloud, field_names, skip_nans, uvs)
    point = namedtuple("Point", points.dtype.names or ())  # type: ignore[misc]  # noqa: PYI024 - names are data
    return [point._make(values) for values in points.tolist()]


def create_cloud(
    header: Any, fields: Sequence[PointField], points: Any, step: int | None = None, point_step: int | None = None
) -> PointCloud2:
    """A cloud of points.

    Args:
        header: ``std_msgs/msg/Header``.
        fields: Fields of a point.
        points: Structured array with the layout of the fields; or numbers of shape (..., fields). Two dimensions of
            points make an organized cloud.
        step: Bytes from one point to the next; None: that of the fields.
        point_step: Another name of ``step``.
    """
    kind = dtype_from_fields(fields, step if step is not None else point_step)
    values = points if isinstance(points, np.ndarray) else np.array(list(map(tuple, points)))
    if values.dtype.names is None:
        bare = dtype_from_fields(fields)
        values = unstructured_to_structured(values.reshape(*values.shape[:-1], len(bare.names or ())), bare)
    packed = np.zeros(values.shape, kind)
    for name in kind.names or ():
        packed[name] = values[name]
    height, width = packed.shape if packed.ndim == 2 else (1, packed.size)
    cloud = PointCloud2(
        header=header,
        height=height,
        width=width,
        is_dense=False,
        is_bigendian=False,
        fields=list(fields),
        point_step=kind.itemsize,
        row_step=kind.itemsize * width,
    )
    cloud.data.frombytes(packed.tobytes())
    return cloud


def create_cloud_xyz32(header: Any, points: Any) -> PointCloud2:
    """A cloud of points (..., 3) with fields x, y, z of 32 bits."""
    return create_cloud(header, XYZ_FIELDS, points)
