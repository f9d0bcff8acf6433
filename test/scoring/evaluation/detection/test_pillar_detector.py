"""Points in their pillars, networks taken for detectors, and boxes from their answers.

The detector that ships is tested on the recorded sweeps and while they were recorded.
"""

from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from known_outputs import assert_known
from made_detections import map_from_lidar

from siren_ros.base.numerics.arrays import Matrix
from siren_ros.base.params.folders import params_dir
from siren_ros.data.interfaces.topics import DETECTIONS
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection import pillar_detector as module
from siren_ros.scoring.evaluation.detection.boxes import CLASS_NAMES, FoundBoxes, FoundSet
from siren_ros.scoring.evaluation.detection.detectors import run_detector
from siren_ros.scoring.evaluation.detection.frames import Frames
from siren_ros.scoring.evaluation.detection.metrics import devkit_score
from siren_ros.scoring.evaluation.detection.pillar_detector import (
    FEATURES,
    SENSOR_HEIGHT_M,
    SHIPPED,
    DetectorNetwork,
    PillarDetector,
    PillarGrid,
    SweepMemory,
    apart,
    class_of,
    detect_pillars,
    detector_file,
    load_detector,
    pillars_of,
    seen_in_training,
    sorted_points,
)
from siren_ros.scoring.evaluation.detection.result_files import read_topic
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES, counted_boxes
from siren_ros.simulation.scenario.episode import SHIPPED_DETECTOR, EpisodeIdentity, Split
from siren_ros.simulation.world.actors import ActorClass

GRID = PillarGrid(half_width_m=8.0, cells=16, points=4, pillars=50)


def _points(*rows: tuple[float, ...]) -> np.ndarray:
    return np.array([(*row, 0.5, 0.1)[:5] for row in rows], dtype=np.float32).reshape(-1, 5)


@pytest.mark.parametrize(
    ("point", "cell"),
    [
        # One metre a cell: x from 2 to 3 is column 10, y from -4 to -3 is row 4.
        ((2.4, -3.2, 0.0), 4 * 16 + 10),
        ((-8.0, 0.0, 0.0), 8 * 16),
        ((0.0, -8.0, 0.0), 8),
        ((7.999, 0.0, 0.0), 8 * 16 + 15),
        ((5.6, 5.6, 3.0), 13 * 16 + 13),
        *((outside, None) for outside in ((8.0, 0.0, 0.0), (0.0, 8.0, 0.0), (8.1, 0.0, 0.0), (0.0, -8.1, 0.0))),
        *((outside, None) for outside in ((6.0, 6.0, 0.0), (1.0, 1.0, 3.1), (1.0, 1.0, -5.1))),
    ],
)
def test_a_point_is_in_the_pillar_that_contains_it(point: tuple[float, float, float], cell: int | None) -> None:
    """The grid is a circle, which holds its lower edges and not its upper ones."""
    assert sorted_points(_points(point), GRID).cell.tolist() == ([] if cell is None else [cell])


def test_features_are_places_and_ways_from_mean_and_middle() -> None:
    found = pillars_of(_points((2.2, -3.4, 1.0), (2.6, -3.8, 0.0)), GRID)
    first = dict(zip(FEATURES, found.points[0, 0].tolist(), strict=True))
    expected = {"x": 2.2 / 8.0, "y": -3.4 / 8.0, "z": 0.5, "intensity": 0.5, "age": 0.4}
    expected |= {"x_mean": -0.2, "y_mean": 0.2, "z_mean": 0.5, "x_middle": -0.3, "y_middle": 0.1}
    assert first == pytest.approx(expected, abs=1e-6)
    assert np.array_equal(found.points[0, 2], found.points[0, 0]), "free slots repeat the first point"
    assert not np.array_equal(found.points[0, 1], found.points[0, 0])


def test_pillars_of_the_newest_points_come_first() -> None:
    points = _points((0.5, 0.5, 0.0), (1.5, 0.5, 0.0), (2.5, 0.5, 0.0))
    found = pillars_of(points, replace(GRID, pillars=2))
    assert found.cell.tolist() == [8 * 16 + 8, 8 * 16 + 9]


@pytest.mark.parametrize("count", [4, 5, 40])
def test_a_full_pillar_leaves_the_next_one_alone(count: int) -> None:
    """The pillars lie next to each other in memory: a point behind the last slot would be the first of the next."""
    points = np.array(
        [(0.5, 0.5, 0.0, 0.1, 0.0), (3.5, 0.5, 0.0, 0.9, 0.0), *[(0.6, 0.6, 0.0, 0.2, 0.0)] * (count - 1)]
    )
    found = sorted_points(points.astype(np.float32), GRID)
    assert found.count.tolist() == [4, 1]
    assert found.slots[1, 0] == pytest.approx([3.5, 0.5, 0.0, 0.9, 0.0])
    assert not found.slots[1, 1:].any()
    assert found.slots[0, :, 3].min() >= 0.1 - 1e-6


def test_of_five_points_every_one_has_four_chances_in_five() -> None:
    """In every pillar of the circle, whose centres lie within 7 m: the last point stays in four of five."""
    middles = np.arange(-7.5, 8.0, 1.0)
    places = [(x, y) for x in middles for y in middles if np.hypot(x, y) < 7.0]
    points = np.array([(x, y, 0.0, number / 10.0, 0.0) for x, y in places for number in range(5)], dtype=np.float32)
    slots = sorted_points(points, GRID).slots[..., 3]
    assert len(slots) == 50, "no more pillars than the grid allows"
    slots = sorted_points(points, replace(GRID, pillars=len(places))).slots[..., 3]
    stays = [float(np.isclose(slots, number / 10.0).any(axis=1).mean()) for number in range(5)]
    assert stays == pytest.approx([0.8] * 5, abs=0.12)
    assert np.array_equal(sorted_points(points, replace(GRID, pillars=len(places))).slots[..., 3], slots)


CARD = {"form_version": 1, "grid": GRID.to_json(), "class_names": ["car", "police"]}


def loaded(monkeypatch: pytest.MonkeyPatch, card: dict[str, Any], *inputs: tuple[str, list[Any]]) -> DetectorNetwork:
    """A network of a card and of inputs with their shapes."""
    asked = inputs or (("points", ["P", 4, len(FEATURES)]), ("cell", ["P"]))
    session = SimpleNamespace(get_inputs=lambda: [SimpleNamespace(name=name, shape=shape) for name, shape in asked])
    monkeypatch.setattr(module, "open_network", lambda _: SimpleNamespace(card=card, session=session))
    return load_detector(Path("a.onnx"))


@pytest.mark.parametrize("change", [{"form_version": 2}, {"form_version": None}, {"grid": None}, {"grid": [8.0]}])
def test_another_form_is_refused(monkeypatch: pytest.MonkeyPatch, change: dict[str, Any]) -> None:
    found = loaded(monkeypatch, CARD)
    assert (found.grid, found.class_names) == (GRID, ("car", "police"))
    with pytest.raises(InputError, match="a detector of form 1"):
        loaded(monkeypatch, {**CARD, **change})


@pytest.mark.parametrize(
    "inputs",
    [
        (("points", ["P", 5, 10]), ("cell", ["P"])),
        (("points", ["P", 4, 9]), ("cell", ["P"])),
        (("cell", ["P"]), ("points", ["P", 4, 10])),
        (("points", ["P", 4, 10]),),
    ],
)
def test_inputs_of_another_grid_are_refused(monkeypatch: pytest.MonkeyPatch, inputs: Any) -> None:
    with pytest.raises(InputError, match="inputs points, cell"):
        loaded(monkeypatch, CARD, *inputs)


@pytest.mark.parametrize(
    "change", [{"cells": 0}, {"half_width_m": -1.0}, {"points": 0}, {"low_m": 3.0}, {"high_m": -5.0}, {"more": 1}]
)
def test_grids_of_no_use_are_refused(change: dict[str, Any]) -> None:
    assert PillarGrid.from_json(GRID.to_json()) == GRID
    assert GRID.cell_m == 1.0
    with pytest.raises(InputError, match="card"):
        PillarGrid.from_json({**GRID.to_json(), **change})


def test_a_detector_is_one_that_ships_or_a_file() -> None:
    assert detector_file("pillars") == params_dir() / SHIPPED
    assert detector_file("pillars").is_file()
    assert detector_file("mine/pillars.onnx") == Path("mine/pillars.onnx")


def test_classes_without_a_name_of_their_own_are_cars() -> None:
    names = ["car", "ambulance", "fire_truck", "police"]
    kinds = ActorClass.SEDAN, ActorClass.BUS, ActorClass.AMBULANCE, ActorClass.POLICE
    assert [names[class_of(member)] for member in kinds] == ["car", "car", "ambulance", "police"]


def test_returns_of_the_own_vehicle_are_left_out() -> None:
    memory = SweepMemory(2)
    memory.add(0, sweep((3.0, 1.0, 0.0), (3.0, 2.0, 0.0), (-4.0, -1.2, 0.5)), np.eye(4))
    assert memory.points()[:, :2].tolist() == [[3.0, 2.0]]


def test_a_step_back_begins_anew() -> None:
    memory = SweepMemory(3)
    for step in (7, 8, 3):
        memory.add(step, sweep((10.0, float(step), 0.0)), np.eye(4))
    assert memory.points()[:, 1].tolist() == [3.0]


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


def test_faint_unreadable_and_overlapping_boxes_are_left_out() -> None:
    """The second is 1.7 m from the first, the third 1.9 m, in the other axis; then one without a place, one faint."""
    places = [(0.0, 5.0, 0.0), (1.7, 5.0, 0.0), (0.0, 6.9, 0.0), (np.nan, 0.0, 0.0), (-5.0, 0.0, 0.0), (-5.0, 5.0, 0.0)]
    session = Answers(places, [0.9, 0.8, 0.7, 0.6, 0.031, 0.029])
    found = PillarDetector(network(session))
    assert (len(found.boxes()), session.asked) == (0, []), "without a point"
    found.add(0, sweep((5.25, 2.75, -1.0)), np.eye(4))
    assert found.boxes().score == pytest.approx([0.9, 0.7, 0.031])


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
    episode: Any = SimpleNamespace(frame_of_step={0: 0, 4: 1, 6: 2, 8: 3}, bag="bag")
    found = detect_pillars(episode, Path("made.onnx"))
    assert found.frame.tolist() == [1, 3]
    ahead, left = np.array([cos, sin]), np.array([-sin, cos])
    assert found.centre_m[1, :2] == pytest.approx(np.array([100.0, 50.0]) + (5.0 + 1.0) * ahead + 2.0 * left)
    assert found.centre_m[1, 2] == pytest.approx(-1.0 - HIGHER_M + SENSOR_HEIGHT_M + HIGHER_M)
    assert np.exp(1j * found.yaw_rad[1]) == pytest.approx(np.exp(1j * (TURNED_RAD + yaw)))
    assert found.velocity_mps[0] == pytest.approx(3.0 * ahead - 4.0 * left), "a track begins as the network says"
    assert found.velocity_mps[1] == pytest.approx([0.0, 0.0], abs=1e-9), "and goes on as its boxes say"
    assert found.attribute.tolist() == [1, 2]
    assert session.asked[0][0, 0, 2] == pytest.approx((-1.0 + HIGHER_M) / 2.0)


def test_the_more_confident_of_near_boxes_stays() -> None:
    centre = np.array([[0.0, 0.0], [1.0, 0.0], [2.5, 0.0], [2.5, 3.0]])
    assert apart(centre, np.array([0.5, 0.9, 0.4, 0.1]), 1.8).tolist() == [False, True, False, True]
    assert apart(centre, np.array([0.5, 0.2, 0.4, 0.1]), 1.8).tolist() == [True, False, True, True]
    assert apart(np.zeros((0, 2)), np.zeros(0), 1.0).shape == (0,)


def test_the_episodes_of_the_training_are_those_of_the_card() -> None:
    seen = seen_in_training()
    assert seen is not None
    assert seen.maps == {"town", "Town04"}
    assert seen.split_of(EpisodeIdentity("town", "S2", 103, "emv.headway_s=2")) is Split.TRAIN
    assert seen.split_of(EpisodeIdentity("town", "S2", 1000)) is Split.TEST_SEED
    network = load_detector(detector_file(SHIPPED_DETECTOR))
    assert network.class_names == CLASS_NAMES
    for judged in network.card["judged"].values():
        for name, seeds in judged["seeds_by_map"].items():
            assert not set(seeds) & set(network.card["training"]["seeds_by_map"].get(name, ()))


@pytest.fixture(scope="module", name="found")
def _found(frames: Frames) -> FoundBoxes:
    return run_detector(SHIPPED_DETECTOR, frames.episodes[0], None)[0]


def test_it_finds_vehicles_of_a_recorded_episode(frames: Frames, found: FoundBoxes) -> None:
    boxes = FoundSet("p", "p", found, frames.scored, has_velocity=True)
    score = devkit_score(*counted_boxes(frames, boxes, VEHICLE_NAMES))
    assert score.mean_average_precision > 0.7
    assert score.errors["ATE"] < 0.4
    assert score.errors["AOE"] < 0.4


def test_the_node_said_the_same_while_the_episode_ran(frames: Frames, found: FoundBoxes) -> None:
    live = read_topic("live", DETECTIONS.name, frames).boxes
    assert np.array_equal(live.frame, found.frame)
    assert live.label.tolist() == found.label.tolist()
    for name in ("centre_m", "size_m", "score"):
        assert getattr(live, name) == pytest.approx(getattr(found, name), abs=1e-6)
    assert np.cos(live.yaw_rad - found.yaw_rad) == pytest.approx(np.ones(len(found)), abs=1e-6)


def test_pillars_and_boxes_of_five_sweeps() -> None:
    """What the network is given, and what becomes of its answers, while the LiDAR turns and drives on."""
    session = Answers([(5.0, 2.5, 0.25), (-3.0, 6.0, 0.4), (1.0, -6.5, 0.1)], [0.9, 0.4, 0.2])
    found, detector = {}, PillarDetector(network(session), SENSOR_HEIGHT_M - 0.3)
    wave = np.arange(60.0)
    for number, step in enumerate((10, 12, 14, 18, 20)):
        rows = np.column_stack((7.5 * np.sin(wave + number), 7.5 * np.cos(1.3 * wave), 2.0 * np.sin(0.7 * wave) - 0.5))
        detector.add(step, sweep(*map(tuple, rows)), map_from_lidar(number) @ turned_by(0.1 * number))
        session.places_m = [(x + 0.3 * number, y - 0.1 * number, z) for x, y, z in session.places_m]
        boxes, asked = detector.boxes(), session.asked[-1]
        found[str(step)] = {
            "pillars": [*asked.shape, *asked.mean(axis=(0, 1)).tolist()],
            "points": asked[:: max(len(asked) // 2, 1), 0],
            **{name: getattr(boxes, name) for name in ("centre_m", "yaw_rad", "velocity_mps", "score", "attribute")},
        }
    assert_known(Path(__file__).parent / "known" / "pillars.json", found, digits=4, decimals=4)


def turned_by(yaw_rad: float) -> Matrix:
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cos, -sin, 0, 0], [sin, cos, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]])
