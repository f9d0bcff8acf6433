"""What a network's answer becomes: boxes of the sweep, and then of the map."""

from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from siren_ros.evaluation.detection.pillars import detector as module
from siren_ros.evaluation.detection.pillars.detector import PillarDetector, apart, detect_pillars
from siren_ros.evaluation.detection.pillars.grid import SENSOR_HEIGHT_M, PillarGrid
from siren_ros.evaluation.detection.pillars.network_file import DetectorNetwork

GRID = PillarGrid(half_width_m=8.0, cells=16, points=4, pillars=50)
HIGHER_M = 0.5
"""The LiDAR is this much above the one that networks see."""
TURNED_RAD = 2.4


@dataclass
class Answers:
    """In place of a network's session: one box at each place, and what it was asked."""

    places_m: list[tuple[float, float, float]]
    scores: list[float]
    asked: list[np.ndarray] = field(default_factory=list)

    def run(self, _outputs: object, given: dict[str, np.ndarray]) -> tuple[np.ndarray, ...]:
        self.asked.append(given["points"])
        rest = (4.5, 1.8, 1.5, np.sin(TURNED_RAD), np.cos(TURNED_RAD), 3.0, -4.0)
        box = np.array([(*place, *rest) for place in self.places_m], dtype=np.float32)
        share = np.tile(np.array([0.2, 0.7, 0.1], dtype=np.float32), (len(box), 1))
        return box, np.array(self.scores, dtype=np.float32), share


def network(session: Answers) -> DetectorNetwork:
    return DetectorNetwork(session, {}, GRID, ("car", "ambulance", "police"))


def sweep(*places_m: tuple[float, float, float]) -> np.ndarray:
    points = np.zeros(len(places_m), dtype=[(name, "<f4") for name in ("x", "y", "z", "intensity")])
    points["x"], points["y"], points["z"] = np.array(places_m, dtype=np.float32).reshape(-1, 3).T
    return points


def test_a_sweep_from_higher_up_is_lifted_for_the_network_and_its_boxes_put_back() -> None:
    session = Answers([(5.0, 2.5, 0.25)], [0.9])
    found = PillarDetector(network(session), SENSOR_HEIGHT_M + HIGHER_M)
    found.add(0, sweep((5.25, 2.75, -1.0)), np.eye(4))
    boxes = found.boxes()
    # Places over the half width of 8 m, heights over 2 m.
    assert session.asked[0][0, 0, :3] == pytest.approx([5.25 / 8.0, 2.75 / 8.0, (-1.0 + HIGHER_M) / 2.0])
    assert boxes.centre_m[0] == pytest.approx([5.0, 2.5, 0.25 - HIGHER_M])
    assert boxes.size_m[0] == pytest.approx([4.5, 1.8, 1.5])
    assert boxes.yaw_rad[0] == pytest.approx(TURNED_RAD)
    assert boxes.velocity_mps[0] == pytest.approx([3.0, -4.0])
    assert boxes.label.tolist() == ["ambulance"]
    assert boxes.score == pytest.approx([0.9])


def test_faint_unreadable_and_overlapping_boxes_are_left_out() -> None:
    """The second is 1.7 m from the first, the third 1.9 m, in the other axis; then one without a place, one faint."""
    places = [(0.0, 5.0, 0.0), (1.7, 5.0, 0.0), (0.0, 6.9, 0.0), (np.nan, 0.0, 0.0), (-5.0, 0.0, 0.0), (-5.0, 5.0, 0.0)]
    session = Answers(places, [0.9, 0.8, 0.7, 0.6, 0.031, 0.029])
    found = PillarDetector(network(session))
    found.add(0, sweep((5.25, 2.75, -1.0)), np.eye(4))
    assert found.boxes().score == pytest.approx([0.9, 0.7, 0.031])


def test_nothing_is_found_without_a_point() -> None:
    session = Answers([(5.0, 2.5, 0.25)], [0.9])
    found = PillarDetector(network(session))
    assert len(found.boxes()) == 0
    assert session.asked == []


def test_boxes_of_labelled_sweeps_come_in_the_map(monkeypatch: pytest.MonkeyPatch) -> None:
    """The EMV stands at (100, 50) and looks along −x + y; of four sweeps the second has no pose, the last no label."""
    yaw = 0.75 * np.pi
    cos, sin = np.cos(yaw), np.sin(yaw)
    pose = np.array([[cos, -sin, 0.0, 100.0], [sin, cos, 0.0, 50.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    mount = np.eye(4)
    mount[:3, 3] = (1.0, 0.0, SENSOR_HEIGHT_M + HIGHER_M)
    points = sweep((5.25, 2.75, -1.0))
    sweeps = [
        SimpleNamespace(step=step, points=points, map_from_base=None if step == 6 else pose) for step in (4, 6, 8, 9)
    ]
    session = Answers([(5.0, 2.0, -1.0)], [0.9])
    replaced: dict[str, Any] = {
        "load_detector": lambda _: network(session),
        "open_source": lambda _: nullcontext(None),
        "lidar_of": lambda _: SimpleNamespace(base_from_sensor=mount),
        "lidar_frames": lambda _, pose: sweeps if pose else [],
    }
    for name, value in replaced.items():
        monkeypatch.setattr(module, name, value)
    episode: Any = SimpleNamespace(step=np.array([0, 4, 6, 8]), bag="bag")
    found = detect_pillars(episode, Path("made.onnx"))
    assert found.frame.tolist() == [1, 3]
    ahead, left = np.array([cos, sin]), np.array([-sin, cos])
    assert found.centre_m[1, :2] == pytest.approx(np.array([100.0, 50.0]) + (5.0 + 1.0) * ahead + 2.0 * left)
    assert found.centre_m[1, 2] == pytest.approx(-1.0 - HIGHER_M + SENSOR_HEIGHT_M + HIGHER_M)
    assert np.exp(1j * found.yaw_rad[1]) == pytest.approx(np.exp(1j * (TURNED_RAD + yaw)))
    assert found.velocity_mps[1] == pytest.approx(3.0 * ahead - 4.0 * left)
    assert found.attribute.tolist() == [1, 1], "they move"
    assert session.asked[0][0, 0, 2] == pytest.approx((-1.0 + HIGHER_M) / 2.0)


def test_the_more_confident_of_near_boxes_stays() -> None:
    centre = np.array([[0.0, 0.0], [1.0, 0.0], [2.5, 0.0], [2.5, 3.0]])
    assert apart(centre, np.array([0.5, 0.9, 0.4, 0.1]), 1.8).tolist() == [False, True, False, True]
    assert apart(centre, np.array([0.5, 0.2, 0.4, 0.1]), 1.8).tolist() == [True, False, True, True]


def test_nothing_stays_of_nothing() -> None:
    assert apart(np.zeros((0, 2)), np.zeros(0), 1.0).shape == (0,)
