"""Bytes of nuScenes' sweeps, and how visible a box is."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from siren_ros.datasets.nuscenes.exporter import sweep_bytes, visible_fractions

POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("instance", "<u2")])


def test_points_have_x_to_the_right_and_y_ahead() -> None:
    points = np.array([(5.0, 2.0, -1.0, 0.2, 7, 0), (-3.0, -4.0, 0.5, 1.0, 31, 9)], dtype=POINT)
    read = np.frombuffer(sweep_bytes(points), dtype="<f4").reshape(-1, 5)
    assert read == pytest.approx(np.array([(-2.0, 5.0, -1.0, 51.0, 7.0), (4.0, -3.0, 0.5, 255.0, 31.0)]))


def labels(**shares: tuple[float, float]) -> Any:
    """A camera's labels by actor: visible share of what is in the picture, and how much is cut off."""
    return SimpleNamespace(
        actor_id=np.array([int(name[1:]) for name in shares]),
        visible_fraction=np.array([share for share, _ in shares.values()]),
        truncation=np.array([cut for _, cut in shares.values()]),
    )


class Truth(SimpleNamespace):
    def __len__(self) -> int:
        return len(self.actor_id)


def test_of_several_cameras_the_one_that_sees_most_counts() -> None:
    frame: Any = SimpleNamespace(
        truth=Truth(actor_id=np.array([3, 5, 8])),
        points=np.zeros(0, dtype=POINT),
        image_truths={"front": labels(a3=(0.9, 0.5), a5=(0.2, 0.0)), "rear": labels(a5=(0.8, 0.25), a3=(0.4, 0.0))},
    )
    assert visible_fractions(frame) == pytest.approx([0.45, 0.6, 0.0])


def test_nothing_is_visible_without_a_sweep() -> None:
    frame: Any = SimpleNamespace(truth=Truth(actor_id=np.array([3])), points=None, image_truths={})
    assert len(visible_fractions(frame)) == 0
