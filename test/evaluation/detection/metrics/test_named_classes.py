"""Which labels should be found by which name."""

import numpy as np
from detection_boxes import made_boxes

from siren_ros.evaluation.detection.metrics.named_classes import CLASS_NAMES, labels_named, names_kinds
from siren_ros.world.actors import EMERGENCY_CLASSES, ActorClass


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
