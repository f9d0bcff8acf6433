from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.interfaces.point_cloud import from_point_cloud, to_point_cloud
from siren_ros.sensors.lidar.lidar_points import LIDAR_POINT_DTYPE

SHARED_FIXTURES = settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])


def _sweep(count: int, seed: int = 0) -> npt.NDArray[np.void]:
    rng = np.random.default_rng(seed)
    points = np.zeros(count, LIDAR_POINT_DTYPE)
    for axis in ("x", "y", "z", "intensity", "time"):
        points[axis] = rng.normal(size=count)
    points["ring"] = rng.integers(0, 64, count)
    points["instance"] = rng.integers(0, 2**16, count)
    return points


@SHARED_FIXTURES
@given(count=st.integers(0, 200), step=st.integers(0, 10**6))
def test_a_sweep_comes_back_as_it_was(round_trip: Callable[[object], Any], count: int, step: int) -> None:
    points = _sweep(count)
    message = round_trip(to_point_cloud(step, "lidar", points))
    assert message.header.frame_id == "lidar"
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == step * 50_000_000
    back = from_point_cloud(message)
    assert back.dtype == LIDAR_POINT_DTYPE
    assert np.array_equal(back, points)


def test_a_point_takes_24_bytes_and_the_fields_say_where() -> None:
    message = to_point_cloud(0, "lidar", _sweep(3))
    assert message.point_step == 24
    assert [(field.name, field.offset) for field in message.fields] == [
        ("x", 0),
        ("y", 4),
        ("z", 8),
        ("intensity", 12),
        ("time", 16),
        ("ring", 20),
        ("instance", 22),
    ]


def test_wider_instances_are_kept(round_trip: Callable[[object], Any]) -> None:
    points = np.array([(1.5, 70_000)], dtype=[("x", "<f4"), ("instance", "<u4")])
    assert from_point_cloud(round_trip(to_point_cloud(0, "lidar", points)))["instance"][0] == 70_000


def test_reads_big_endian_rows_with_padding() -> None:
    message = to_point_cloud(0, "lidar", np.array([(1.0,), (2.0,)], dtype=[("x", "<f4")]))
    rows = np.zeros((2, 6), np.uint8)
    rows[:, :4] = np.array([[3.5], [-7.0]], dtype=">f4").view(np.uint8)
    foreign = replace(message, height=2, width=1, row_step=6, is_bigendian=True, data=rows.reshape(-1))
    assert from_point_cloud(foreign)["x"].tolist() == [3.5, -7.0]


@pytest.mark.parametrize("count", [2, 3])
def test_a_field_of_several_numbers_has_an_axis(count: int) -> None:
    message = to_point_cloud(
        0, "lidar", np.array([(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)], dtype=[(n, "<f4") for n in "xyz"])
    )
    merged = from_point_cloud(replace(message, fields=[replace(message.fields[0], count=count)]))
    assert merged["x"].tolist() == [[1.0, 2.0, 3.0][:count], [4.0, 5.0, 6.0][:count]]


@pytest.mark.parametrize(
    "change",
    [
        {"data": np.zeros(5, np.uint8)},
        {"point_step": 2},
        {"row_step": 1},
        {"width": 2**31},
        {"height": 3},
    ],
)
def test_refuses_clouds_whose_sizes_do_not_fit(change: dict[str, object]) -> None:
    message = to_point_cloud(0, "lidar", _sweep(4))
    with pytest.raises(InputError, match="point cloud"):
        from_point_cloud(replace(message, **change))


def test_refuses_fields_without_a_ros_type() -> None:
    with pytest.raises(InputError, match=r"points\.t"):
        to_point_cloud(0, "lidar", np.zeros(2, dtype=[("t", "<i8")]))


@pytest.mark.parametrize("kind", ["f4", "f8", "u2", "i4"])
def test_big_endian_numbers_are_refused_and_little_endian_ones_taken(kind: str) -> None:
    """The message says once for all fields that it is little-endian."""
    with pytest.raises(InputError, match=r"points\.x.*little-endian"):
        to_point_cloud(0, "lidar", np.zeros(2, dtype=[("x", f">{kind}")]))
    written = np.array([(1,), (3,)], dtype=[("x", f"<{kind}")])
    assert from_point_cloud(to_point_cloud(0, "lidar", written))["x"].tolist() == [1, 3]
