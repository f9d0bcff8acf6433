import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_scores import scored
from shapely import Polygon

from siren_ros.evaluation.prediction.metrics.path_collisions import colliding
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.numerics.geometry import footprint_corners

TIME = 0.2 * np.arange(1, 26)


def straight(x_m: float, y_m: float, vx_mps: float, vy_mps: float) -> np.ndarray:
    """A path of constant velocity from a place."""
    return np.stack((x_m + vx_mps * TIME, y_m + vy_mps * TIME), axis=-1)


def found(
    paths: list[np.ndarray], starts: list[tuple[float, float]], yaw: list[float], frame: list[int]
) -> list[float]:
    hypotheses = Hypotheses.certain(np.array(paths))
    samples = scored(np.array(paths), frame, np.array(starts), np.array(yaw))
    return [float(value) for value in colliding(hypotheses, samples.batch)]


def test_crossing_paths_collide_only_at_the_same_time() -> None:
    """Both are at the origin after 2 s; the third, a frame later, would be, too."""
    paths = [straight(-20.0, 0.0, 10.0, 0.0), straight(0.0, -20.0, 0.0, 10.0), straight(0.0, 20.0, 0.0, -10.0)]
    starts = [(-20.0, 0.0), (0.0, -20.0), (0.0, 20.0)]
    yaw = [0.0, np.pi / 2, -np.pi / 2]
    hit = found(paths, starts, yaw, [0, 0, 1])
    assert hit[:2] == [1.0, 1.0]
    assert np.isnan(hit[2]), "alone in its frame"
    late = [paths[0], straight(0.0, -50.0, 0.0, 10.0)]
    assert found(late, [starts[0], (0.0, -50.0)], yaw[:2], [0, 0]) == [0.0, 0.0]


def test_footprints_are_as_wide_as_vehicles() -> None:
    """2 m wide, side by side at 2.1 m and at 1.9 m."""
    for apart, expected in ((2.1, 0.0), (1.9, 1.0)):
        paths = [straight(0.0, 0.0, 8.0, 0.0), straight(0.0, apart, 8.0, 0.0)]
        assert found(paths, [(0.0, 0.0), (0.0, apart)], [0.0, 0.0], [0, 0]) == [expected, expected]


def test_a_standing_vehicle_keeps_its_heading() -> None:
    """4 m long, across the way: 1.5 m beyond its centre line it is hit, along the way it is not."""
    paths = [straight(0.0, 0.0, 0.0, 0.0), straight(-20.0, 2.5, 10.0, 0.0)]
    starts = [(0.0, 0.0), (-20.0, 2.5)]
    assert found(paths, starts, [np.pi / 2, 0.0], [0, 0]) == [1.0, 1.0]
    assert found(paths, starts, [0.0, 0.0], [0, 0]) == [0.0, 0.0]


@given(seed=st.integers(0, 300))
def test_as_polygons_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = 5
    starts, velocity = rng.uniform(-15.0, 15.0, (count, 2)), rng.uniform(-6.0, 6.0, (count, 2))
    yaw = np.arctan2(velocity[:, 1], velocity[:, 0])
    paths = np.array([straight(*start, *speed) for start, speed in zip(starts, velocity, strict=True)])
    size = np.full(count, 4.0), np.full(count, 2.0)
    boxes = [
        [Polygon(corners) for corners in footprint_corners(paths[:, t, 0], paths[:, t, 1], yaw, *size)]
        for t in range(25)
    ]
    expected = [
        float(any(at[one].intersection(at[two]).area > 1e-9 for at in boxes for two in range(count) if two != one))
        for one in range(count)
    ]
    assert found(list(paths), [tuple(start) for start in starts], list(yaw), [0] * count) == expected


@pytest.mark.parametrize(("leg_m", "expected"), [(0.09, 1.0), (0.11, 0.0)])
def test_a_leg_of_a_decimetre_turns_the_vehicle(leg_m: float, expected: float) -> None:
    """It heads north and creeps east: as long as it heads north it reaches 2 m to the north, and then 1 m."""
    creeping = np.stack((leg_m * np.arange(1, 26), np.zeros(25)), axis=-1)
    standing = straight(0.0, 2.5, 0.0, 0.0)
    starts = [(0.0, 0.0), (0.0, 2.5)]
    assert found([creeping, standing], starts, [np.pi / 2.0, 0.0], [0, 0]) == [expected, expected]


def test_who_turned_keeps_the_heading_of_its_last_leg() -> None:
    """From north to east within the first leg, then it stands; the other comes past 2.5 m to the north."""
    stops = np.tile([5.0, 0.0], (25, 1))
    passing = straight(-20.0, 2.5, 8.0, 0.0)
    assert found([stops, passing], [(0.0, 0.0), (-20.0, 2.5)], [np.pi / 2.0, 0.0], [0, 0]) == [0.0, 0.0]
    assert found([stops[:, ::-1], passing], [(0.0, 0.0), (-20.0, 2.5)], [0.0, 0.0], [0, 0]) == [1.0, 1.0]
