"""Attributes at their limit, tables of boxes put together and taken apart, and parts of labels at their limits."""

from dataclasses import replace

import numpy as np
import pytest
from detection_boxes import made_boxes, truth_boxes
from evaluation.made_frames import columns_ahead, made_frames

from siren_ros.scoring.evaluation.detection.boxes import (
    ATTRIBUTES,
    CLASS_NAMES,
    TruthBoxes,
    attributes_of,
    joined,
    labels_named,
    names_kinds,
)
from siren_ros.scoring.evaluation.detection.frames import RANGE_M
from siren_ros.scoring.evaluation.detection.scoring import FAMILIES, SUBSETS, FamilyOrder, Subset
from siren_ros.simulation.world.actors import EMERGENCY_CLASSES, ActorClass, Mode


@pytest.mark.parametrize("turn_rad", [0.0, 2.0, -1.0])
def test_a_vehicle_moves_above_three_tenths_of_a_metre_a_second(turn_rad: float) -> None:
    speed = np.array([0.0, 0.29, 0.31, 20.0])[:, None]
    codes = attributes_of(speed * np.array([np.cos(turn_rad), np.sin(turn_rad)]))
    assert codes.tolist() == [2, 2, 1, 1]
    assert attributes_of(np.array([[0.0, np.nan], [np.nan, 5.0]])).tolist() == [0, 0]


def test_people_have_attributes_of_their_own() -> None:
    """A rider sits on two wheels at any speed, known or not."""
    speed = np.array([[0.31, 0.0], [0.29, 0.0], [np.nan, np.nan]])
    kinds = ActorClass.PEDESTRIAN, ActorClass.BICYCLE
    walking, riding = ([ATTRIBUTES[code] for code in attributes_of(speed, kind)] for kind in kinds)
    assert walking == ["pedestrian.moving", "pedestrian.standing", ""]
    assert riding == ["cycle.with_rider"] * 3
    mixed = np.array([ActorClass.SEDAN, ActorClass.PEDESTRIAN, ActorClass.MOTORCYCLE], dtype=np.uint8)
    assert [ATTRIBUTES[code] for code in attributes_of(speed[:1].repeat(3, axis=0), mixed)] == [
        "vehicle.moving",
        "pedestrian.moving",
        "cycle.with_rider",
    ]


def test_tables_are_joined_in_their_order_and_rows_keep_together() -> None:
    first, second = (made_boxes([], places, scores)[1] for places, scores in (([1.0, 2.0], [0.1, 0.2]), ([3.0], [0.3])))
    whole = joined([first, second])
    assert len(whole) == 3
    assert whole.centre_m[:, 0].tolist() == [1.0, 2.0, 3.0]
    some = whole.at(np.array([2, 0]))
    assert (some.centre_m[:, 0].tolist(), some.score.tolist()) == ([3.0, 1.0], [0.3, 0.1])
    assert whole.at(np.array([False, True, False])).score.tolist() == [0.2]


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
    inside = np.array([part.labels(FRAMES, boxes) for part in parts])
    assert inside.argmax(axis=0)[[0, 1, 2, 3, 4, 5, 7]].tolist() == [0, 0, 1, 1, 2, 2, 1]
    assert inside.sum(axis=0).tolist() == [1, 1, 1, 1, 1, 1, 0, 1]
    assert (FRAMES.distance_m(boxes) < RANGE_M).tolist() == [True] * 6 + [False, True]
    for part in parts:
        assert part.detections is not None
        assert np.array_equal(part.detections(FRAMES, boxes), part.labels(FRAMES, boxes))


def test_numbers_of_points() -> None:
    points = np.array([0, 1, 4, 5, 19, 20, 99, 100, 5000], dtype=np.uint32)
    names = ["1 to 4", "5 to 19", "20 to 99", "100 and more"]
    inside = np.array([holds(OF["LiDAR points", name], lidar_points=points) for name in names])
    assert inside.sum(axis=0).tolist() == [0] + [1] * 8
    assert inside.argmax(axis=0)[1:].tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


def test_shares_that_are_visible() -> None:
    visible = np.array([0.0, 0.39, 0.4, 0.59, 0.6, 0.79, 0.8, 1.0])
    names = ["0-40 %", "40-60 %", "60-80 %", "80-100 %"]
    inside = np.array([holds(OF["visible", name], visible=visible) for name in names])
    assert inside.sum(axis=0).tolist() == [1] * 8
    assert inside.argmax(axis=0).tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


def test_emergency_vehicles_by_their_class() -> None:
    classes = np.array(list(ActorClass), dtype=np.uint8)
    for member in (ActorClass.AMBULANCE, ActorClass.FIRE_TRUCK, ActorClass.POLICE):
        subset = OF["emergency vehicles", member.name.lower().replace("_", " ")]
        assert classes[holds(subset, actor_class=classes)].tolist() == [member]


def test_shares_of_four_resamples() -> None:
    values = {
        "clearance": np.array([0.1, 0.1, 0.5, 0.1]),
        "stop sign": np.array([0.2, 0.2, 0.4, 0.2]),
        "shoulder": np.array([0.3, 0.1, 0.6, 0.3]),
        "red light": np.array([0.4, 0.4, 0.7, 0.3]),
    }
    order = FamilyOrder.of(values)
    assert order is not None
    assert list(order.steps.values()) == pytest.approx([0.75, 0.75, 0.75]), "equal is not below"
    assert order.whole == pytest.approx(0.25)
    assert "whole order in 25%" in order.sentence()
    # The order of the dictionary says nothing.
    assert FamilyOrder.of(dict(reversed(values.items()))) == order


def test_a_missing_family_has_no_order() -> None:
    assert FamilyOrder.of({name: np.ones(3) for name in list(FAMILIES)[:3]}) is None
    assert len([one for members in FAMILIES.values() for one in members]) == 7
