"""Labels of the detector's training."""

from dataclasses import replace

import numpy as np
from datasets.made_bag import truth_of

from siren_ros.lab.training.detection.samples import boxes_of_truth
from siren_ros.simulation.world.actors import ActorClass


def test_people_are_no_vehicles() -> None:
    """Of a car and a bus; then one of them is a person."""
    truth = truth_of(10)
    whole = boxes_of_truth(truth)
    assert len(whole) == 2
    for kind in (ActorClass.PEDESTRIAN, ActorClass.BICYCLE, ActorClass.MOTORCYCLE):
        changed = replace(truth, actor_class=np.array([kind, ActorClass.BUS], dtype=np.uint8))
        assert np.array_equal(boxes_of_truth(changed), whole[1:])
