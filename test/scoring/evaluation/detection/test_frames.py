"""Frames of an episode for detectors, and the boxes in them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from datasets.made_bag import BUS, CAR, LIDAR_M, BagSpec, place_of, truth_of, write_made_bag, yaw_of
from evaluation.made_records import moving, record_with
from made_detections import PICTURED, STEPS, columns_ahead, made_boxes, made_frames, truth_boxes
from rosbags.typesys.store import Typestore

from siren_ros.data.episode_source import Need, survey_bag
from siren_ros.scoring.evaluation.detection import frames as episode_reading
from siren_ros.scoring.evaluation.detection.boxes import (
    ATTRIBUTES,
    CLASS_NAMES,
    TruthBoxes,
    attributes_of,
    labels_named,
    names_kinds,
)
from siren_ros.scoring.evaluation.detection.frames import (
    EpisodeFrames,
    frames_of,
    modes_at,
    read_frames,
    velocities_of_annotations,
)
from siren_ros.scoring.evaluation.detection.scoring import (
    FAMILIES,
    SUBSETS,
    Subset,
    order_of_families,
    sentence_of_order,
)
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import EMERGENCY_CLASSES, ActorClass, Mode


def _velocities(steps: list[int], x_m: list[float], actors: list[int] | None = None) -> list[float]:
    centre = np.stack((np.array(x_m), np.zeros(len(x_m)), np.zeros(len(x_m))), axis=-1)
    ids = np.array(actors or [1] * len(steps), dtype=np.uint32)
    return velocities_of_annotations(np.array(steps, dtype=np.intp), ids, centre)[:, 0].tolist()


@pytest.mark.parametrize(
    ("steps", "x_m", "velocity_mps"),
    [
        ([0, 10, 20], [0.0, 1.0, 4.0], [2.0, 4.0, 6.0]),
        ([0, 2, 10, 12], [0.0, 0.0, 1.0, 3.0], [2.0, 6.0, 2.0, 6.0]),
        ([0, 40, 60, 120], [0.0, 2.0, 4.0, 6.0], [np.nan, 4.0 / 3.0, np.nan, np.nan]),
        ([0, 30], [0.0, 3.0], [2.0, 2.0]),
        ([0, 40], [0.0, 4.0], [np.nan, np.nan]),
        ([0, 30, 60], [0.0, 3.0, 6.0], [2.0, 2.0, 2.0]),
    ],
)
def test_velocities_are_ways_between_neighbours_within_the_devkits_limit(
    steps: list[int], x_m: list[float], velocity_mps: list[float]
) -> None:
    """Half a second away; 1.5 s to each side are the limit. Vehicles are kept apart."""
    assert _velocities(steps, x_m) == pytest.approx(velocity_mps, nan_ok=True)
    two = _velocities([0, 0, 10, 10], [0.0, 5.0, 1.0, 7.0], [1, 2, 1, 2])
    assert two == pytest.approx([2.0, 4.0, 2.0, 4.0])


def test_velocities_have_both_axes_whatever_the_height() -> None:
    centre = np.array([[0.0, 0.0, 9.0], [1.5, -2.0, 0.0], [4.0, -3.0, -9.0]])
    found = velocities_of_annotations(np.array([0, 10, 20]), np.full(3, 7, dtype=np.uint32), centre)
    assert found == pytest.approx(np.array([[3.0, -4.0], [4.0, -3.0], [5.0, -2.0]]))


def test_frames_of_two_episodes_are_one_row() -> None:
    """Four frames each, at steps 0, 2, 10 and 12."""
    first, second = made_frames().episodes
    labels = truth_boxes(np.array([0, 3]), np.zeros((2, 3)), np.zeros((2, 2)), np.zeros(2))
    frames = frames_of([replace(first, truth=labels), replace(second, truth=labels)])
    assert (len(frames), frames.first.tolist()) == (8, [0, 4, 8])
    assert frames.episode.tolist() == [0] * 4 + [1] * 4
    assert frames.step.tolist() == list(STEPS) * 2
    assert frames.keyframe.tolist() == [True, False, True, False] * 2
    assert frames.pictured.tolist() == list(PICTURED) * 2
    assert frames.truth.frame.tolist() == [0, 3, 4, 7]
    assert list(frames.by_token.values()) == [0, 2, 4, 6]
    assert frames.vehicle_m[5] == pytest.approx([105.0, 50.0])
    assert frames.map_from_lidar[5][:2, 3] == pytest.approx([105.0, 50.0])
    assert frames.global_from_map_m[[0, 7]].tolist() == [[1000.0, 2000.0], [2000.0, 4000.0]]
    assert frames.name_of(6) == "episode1 step 10"
    assert frames.scored.all()


LABELLED = list(range(4, 42, 2))


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> EpisodeFrames:
    folder = tmp_path_factory.mktemp("bag")
    bag = write_made_bag(folder / "bag", typestore, BagSpec(seed=3))
    return read_frames(survey_bag(bag, "detection", (Need.LIDAR,), folder), "mine")


def test_every_labelled_sweep_is_a_frame(episode: EpisodeFrames) -> None:
    assert episode.step.tolist() == LABELLED
    assert np.flatnonzero(episode.keyframe).tolist() == [LABELLED.index(step) for step in (10, 20, 30, 40)]
    assert episode.pictured.all()
    assert (episode.episode_id, episode.template, episode.seed, episode.suite) == ("mine", "S2", 3, "made")
    assert (episode.identity.text, bytes.fromhex(episode.identity.map_sha256)[:8]) == ("straight S2 3", b"straight")
    assert episode.lidar_frame == "lidar"


def test_poses_are_those_of_the_steps(episode: EpisodeFrames) -> None:
    for row, step in enumerate(LABELLED):
        x_m, y_m, z_m = place_of(step)
        assert episode.vehicle_m[row] == pytest.approx([x_m, y_m])
        origin = episode.map_from_lidar[row] @ [0.0, 0.0, 0.0, 1.0]
        ahead = LIDAR_M[0] * np.array([np.cos(yaw_of(step)), np.sin(yaw_of(step))])
        assert origin == pytest.approx([x_m + ahead[0], y_m + ahead[1], z_m + LIDAR_M[2], 1.0])
    assert episode.global_from_map_m.tolist() == [60.0, 66.0]
    assert episode.camera_from_lidar is not None
    assert episode.camera_from_lidar @ [10.0, 2.0, 0.0, 1.0] == pytest.approx([-2.0, -0.5, 9.0, 1.0])


def test_boxes_are_the_labels_in_the_map(episode: EpisodeFrames) -> None:
    truth = episode.truth
    assert truth.frame.tolist() == np.repeat(np.arange(len(LABELLED)), 2).tolist()
    assert truth.actor_id.tolist() == [CAR, BUS] * len(LABELLED)
    for row in range(len(truth)):
        step, which = LABELLED[int(truth.frame[row])], row % 2
        labels = truth_of(step)
        local = np.array([labels.x_m[which], labels.y_m[which], labels.z_m[which], 1.0])
        assert truth.centre_m[row] == pytest.approx((episode.map_from_lidar[int(truth.frame[row])] @ local)[:3])
        assert np.exp(1j * truth.yaw_rad[row]) == pytest.approx(np.exp(1j * (labels.yaw_rad[which] + yaw_of(step))))
        sizes = [labels.length_m[which], labels.width_m[which], labels.height_m[which]]
        assert truth.size_m[row].tolist() == sizes
        assert truth.lidar_points[row] == labels.lidar_points[which]
    moving, stopped = ATTRIBUTES.index("vehicle.moving"), ATTRIBUTES.index("vehicle.stopped")
    assert truth.attribute.tolist() == [moving, stopped] * len(LABELLED)
    # Half of the car is beyond the edge of the front picture; the rear camera sees nine tenths of the bus.
    assert truth.visible == pytest.approx([0.45, 0.9] * len(LABELLED))


def test_velocities_are_differences_of_the_boxes_places(episode: EpisodeFrames) -> None:
    """As nuScenes has them: between the keyframe before and the one after."""
    truth = episode.truth
    rows = {step: 2 * LABELLED.index(step) for step in (10, 20, 30, 40)}
    for before, at, after in ((10, 20, 30), (20, 30, 40)):
        for which in (0, 1):
            moved = truth.centre_m[rows[after] + which] - truth.centre_m[rows[before] + which]
            assert truth.velocity_mps[rows[at] + which] == pytest.approx(moved[:2] / (0.05 * (after - before)))


def test_modes_are_those_of_each_actors_state(straight_road: RoadNetwork, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a label whose actor has no state nothing is known: before the first, between two, and behind the last."""
    (there,) = record_with({key: moving(0.0, 0.0, 5.0, steps=1) for key in (3, 5, 9)}, straight_road).states
    states = replace(there, mode=np.array([Mode.YIELD_HOLD, Mode.REJOIN, Mode.STOPPED], dtype=np.uint8))
    monkeypatch.setattr(episode_reading, "from_actor_states", lambda _: states)
    message: Any = SimpleNamespace(read=lambda: None)
    asked = np.array([9, 1, 5, 4, 12, 3], dtype=np.uint32)
    nothing = Mode.NOMINAL
    assert modes_at(asked, message).tolist() == [Mode.STOPPED, nothing, Mode.REJOIN, nothing, nothing, Mode.YIELD_HOLD]
    assert modes_at(asked, None).tolist() == [nothing] * 6


@pytest.fixture(scope="module")
def sparse(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> EpisodeFrames:
    """Without the front camera's picture at steps 8 and 12, without labels at step 6."""
    folder = tmp_path_factory.mktemp("sparse")
    lacking = {8: "camera_front/image", 12: "camera_front/image", 6: "ground_truth"}
    bag = write_made_bag(
        folder / "bag", typestore, BagSpec(steps=16), lambda topic, step: lacking.get(step, "-") in topic
    )
    return read_frames(survey_bag(bag, "detection", (Need.LIDAR,), folder), "mine")


def test_sweeps_without_labels_are_no_frames_and_some_have_no_picture(sparse: EpisodeFrames) -> None:
    assert sparse.step.tolist() == [4, 8, 10, 12, 14]
    assert sparse.pictured.tolist() == [True, False, True, False, True]
    assert sparse.truth.frame.tolist() == np.repeat(np.arange(5), 2).tolist()


@pytest.mark.parametrize("turn_rad", [0.0, 2.0, -1.0])
def test_attributes_follow_from_speeds_and_classes(turn_rad: float) -> None:
    """Above 0.3 m/s somebody moves; a rider sits on two wheels at any speed, known or not."""
    speed = np.array([0.0, 0.29, 0.31, 20.0, np.nan])[:, None] * np.array([np.cos(turn_rad), np.sin(turn_rad)])
    kinds = None, ActorClass.PEDESTRIAN, ActorClass.BICYCLE
    vehicles, walking, riding = (
        [ATTRIBUTES[code] for code in (attributes_of(speed) if kind is None else attributes_of(speed, kind)).tolist()]
        for kind in kinds
    )
    assert vehicles == ["vehicle.stopped"] * 2 + ["vehicle.moving"] * 2 + [""]
    assert walking == ["pedestrian.standing"] * 2 + ["pedestrian.moving"] * 2 + [""]
    assert riding == ["cycle.with_rider"] * 5
    assert attributes_of(np.array([[0.0, np.nan], [np.nan, 5.0]])).tolist() == [0, 0]
    mixed = np.array([ActorClass.SEDAN, ActorClass.PEDESTRIAN, ActorClass.MOTORCYCLE], dtype=np.uint8)
    named = [ATTRIBUTES[code] for code in attributes_of(speed[2:3].repeat(3, axis=0), mixed)]
    assert named == ["vehicle.moving", "pedestrian.moving", "cycle.with_rider"]


def test_every_label_has_one_name() -> None:
    classes = np.array(list(ActorClass), dtype=np.uint8)
    truth, _ = made_boxes([0.0] * len(classes), [], [])
    truth.actor_class[:] = classes
    named = {name: classes[labels_named(truth, name)].tolist() for name in CLASS_NAMES}
    for member in EMERGENCY_CLASSES:
        assert named[member.name.lower()] == [member]
    assert set(named["car"]) == set(classes.tolist()) - {int(member) for member in EMERGENCY_CLASSES}
    assert sum(map(len, named.values())) == len(classes)


def test_one_name_of_an_emergency_vehicle_names_kinds() -> None:
    _, found = made_boxes([], [0.0, 1.0], [0.5, 0.5])
    assert not names_kinds(found)
    for name in CLASS_NAMES[1:]:
        _, named = made_boxes([], [0.0, 1.0], [0.5, 0.5])
        assert names_kinds(type(named)(**{**vars(named), "label": np.array(["car", name])}))
    assert not names_kinds(made_boxes([], [], [])[1])


FRAMES = made_frames()
OF = {(subset.group, subset.name): subset for subset in SUBSETS}


def labels_at(ahead_m: list[float], frame: int = 5) -> TruthBoxes:
    return truth_boxes(*columns_ahead([(frame, ahead) for ahead in ahead_m]))


def holds(subset: Subset, **columns: np.ndarray) -> list[bool]:
    (count,) = {len(values) for values in columns.values()}
    return np.asarray(subset.labels(FRAMES, replace(labels_at([10.0] * count), **columns))).tolist()


def test_each_mode_belongs_to_one_behaviour() -> None:
    modes = np.array(list(Mode), dtype=np.uint8)
    parts = {
        name: set(modes[holds(OF["behaviour", name], mode=modes)].tolist()) for name in ("nominal", "yielding", "held")
    }
    assert parts["held"] == {Mode.YIELD_HOLD, Mode.STOPPED}
    assert Mode.REJOIN in parts["yielding"]
    assert all(mode in parts["yielding"] for mode in Mode if mode.is_yielding and mode is not Mode.YIELD_HOLD)
    assert {Mode.NOMINAL, Mode.ROUTE_FOLLOW} <= parts["nominal"]
    assert sum(map(len, parts.values())) == len(set.union(*parts.values())) == len(Mode)


def test_distances_are_from_the_vehicle_with_the_lidar() -> None:
    boxes = labels_at([0.0, 14.9, 15.1, 29.9, 30.1, 49.9, 50.1, -29.9])
    assert FRAMES.distance_m(boxes) == pytest.approx([0.0, 14.9, 15.1, 29.9, 30.1, 49.9, 50.1, 29.9])
    parts = [OF["distance", name] for name in ("0-15 m", "15-30 m", "30-50 m")]
    inside = [np.flatnonzero(part.labels(FRAMES, boxes)).tolist() for part in parts]
    assert inside == [[0, 1], [2, 3, 7], [4, 5]]
    boxes.centre_m[:, 2] += 30.0
    assert FRAMES.distance_m(boxes)[1] == pytest.approx(14.9), "whatever the height"
    for part in parts:
        assert part.detections is not None
        assert np.array_equal(part.detections(FRAMES, boxes), part.labels(FRAMES, boxes))


def test_shares_of_four_resamples() -> None:
    values = {
        "clearance": np.array([0.1, 0.1, 0.5, 0.1]),
        "stop sign": np.array([0.2, 0.2, 0.4, 0.2]),
        "shoulder": np.array([0.3, 0.1, 0.6, 0.3]),
        "red light": np.array([0.4, 0.4, 0.7, 0.3]),
    }
    order = order_of_families(values)
    assert list(order.values()) == pytest.approx([0.75, 0.75, 0.75, 0.25]), "equal is not below"
    assert list(order)[-1] == "all"
    assert sentence_of_order(order).startswith("clearance < stop sign in 75%, ")
    # The order of the dictionary says nothing.
    assert order_of_families(dict(reversed(values.items()))) == order
    assert order_of_families({name: np.ones(3) for name in list(FAMILIES)[:3]}) == {}, "one is missing"
    assert len([one for members in FAMILIES.values() for one in members]) == 7
