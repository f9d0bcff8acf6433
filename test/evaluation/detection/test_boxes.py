"""Attributes at their limit, and tables of boxes put together and taken apart."""

import numpy as np
import pytest
from detection_boxes import made_boxes

from siren_ros.evaluation.detection.boxes import CLASS_NAMES, attributes_of, joined, labels_named, names_kinds
from siren_ros.world.actors import EMERGENCY_CLASSES, ActorClass


@pytest.mark.parametrize("turn_rad", [0.0, 2.0, -1.0])
def test_a_vehicle_moves_above_three_tenths_of_a_metre_a_second(turn_rad: float) -> None:
    speed = np.array([0.0, 0.29, 0.31, 20.0])[:, None]
    codes = attributes_of(speed * np.array([np.cos(turn_rad), np.sin(turn_rad)]))
    assert codes.tolist() == [2, 2, 1, 1]
    assert attributes_of(np.array([[0.0, np.nan], [np.nan, 5.0]])).tolist() == [0, 0]


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
    wanted = {name: classes[labels_named(truth, name)].tolist() for name in CLASS_NAMES}
    for member in EMERGENCY_CLASSES:
        assert wanted[member.name.lower()] == [member]
    assert set(wanted["car"]) == set(classes.tolist()) - {int(member) for member in EMERGENCY_CLASSES}
    assert sum(map(len, wanted.values())) == len(classes)


def test_one_name_of_an_emergency_vehicle_names_kinds() -> None:
    _, found = made_boxes([], [0.0, 1.0], [0.5, 0.5])
    assert not names_kinds(found)
    for name in CLASS_NAMES[1:]:
        _, named = made_boxes([], [0.0, 1.0], [0.5, 0.5])
        assert names_kinds(type(named)(**{**vars(named), "label": np.array(["car", name])}))
    assert not names_kinds(made_boxes([], [], [])[1])
