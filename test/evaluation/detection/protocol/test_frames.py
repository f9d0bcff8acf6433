"""Velocities of labels as the devkit computes them."""

import numpy as np
import pytest

from siren_ros.evaluation.detection.protocol.boxes import ATTRIBUTES, attributes_of
from siren_ros.evaluation.detection.protocol.frames import velocities_of_annotations


def _velocities(steps: list[int], x_m: list[float], actors: list[int] | None = None) -> list[float]:
    centre = np.stack((np.array(x_m), np.zeros(len(x_m)), np.zeros(len(x_m))), axis=-1)
    ids = np.array(actors or [1] * len(steps), dtype=np.uint32)
    return velocities_of_annotations(np.array(steps, dtype=np.intp), ids, centre)[:, 0].tolist()


def test_the_way_between_the_neighbours_half_a_second_away() -> None:
    assert _velocities([0, 10, 20], [0.0, 1.0, 4.0]) == pytest.approx([2.0, 4.0, 6.0])
    assert _velocities([0, 2, 10, 12], [0.0, 0.0, 1.0, 3.0]) == pytest.approx([2.0, 6.0, 2.0, 6.0])


def test_gaps_of_more_than_the_devkits_limit_have_no_velocity() -> None:
    found = _velocities([0, 40, 60, 120], [0.0, 2.0, 4.0, 6.0])
    assert np.isnan(found[0])
    assert found[1:3] == pytest.approx([4.0 / 3.0, np.nan], nan_ok=True)
    assert np.isnan(found[3])


def test_vehicles_are_kept_apart() -> None:
    assert _velocities([0, 0, 10, 10], [0.0, 5.0, 1.0, 7.0], [1, 2, 1, 2]) == pytest.approx([2.0, 4.0, 2.0, 4.0])
    assert np.isnan(_velocities([0, 10], [0.0, 1.0], [1, 2])).all()


def test_attributes_follow_from_speeds() -> None:
    codes = attributes_of(np.array([[0.0, 0.2], [0.3, 0.1], [np.nan, 0.0]]))
    assert [ATTRIBUTES[code] for code in codes.tolist()] == ["vehicle.stopped", "vehicle.moving", ""]


def test_velocities_have_both_axes_whatever_the_height() -> None:
    centre = np.array([[0.0, 0.0, 9.0], [1.5, -2.0, 0.0], [4.0, -3.0, -9.0]])
    found = velocities_of_annotations(np.array([0, 10, 20]), np.full(3, 7, dtype=np.uint32), centre)
    assert found == pytest.approx(np.array([[3.0, -4.0], [4.0, -3.0], [5.0, -2.0]]))


@pytest.mark.parametrize(("steps", "known"), [((0, 30), True), ((0, 40), False), ((0, 30, 60), True)])
def test_one_and_a_half_seconds_to_each_side_are_the_limit(steps: tuple[int, ...], *, known: bool) -> None:
    found = _velocities(list(steps), [0.1 * step for step in steps])
    assert np.isfinite(found).all() == known
    if known:
        assert found == pytest.approx([2.0] * len(steps))
