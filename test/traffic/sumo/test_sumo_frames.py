import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.traffic.sumo.sumo_frames import map_from_sumo, sumo_from_map


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-3.1, 3.1), st.floats(1.0, 20.0))
def test_centre_to_front_bumper_and_back(x: float, y: float, yaw: float, length: float) -> None:
    offset = (109.34, 135.96)
    back = map_from_sumo(*sumo_from_map(x, y, yaw, length, offset), length, offset)
    assert np.allclose(back, (x, y, yaw), atol=1e-9)


@pytest.mark.parametrize(
    ("yaw", "front", "angle"),
    [
        (0.0, (12.0, 0.0), 90.0),
        (np.pi / 2, (10.0, 2.0), 0.0),
        (np.pi, (8.0, 0.0), 270.0),
        (-np.pi / 2, (10.0, -2.0), 180.0),
    ],
)
def test_front_bumper_and_angle_clockwise_from_north(yaw: float, front: tuple[float, float], angle: float) -> None:
    x, y, degrees = sumo_from_map(10.0, 0.0, yaw, 4.0, (0.0, 0.0))
    assert (float(x), float(y)) == pytest.approx(front)
    assert float(degrees) == pytest.approx(angle, abs=1e-9)
