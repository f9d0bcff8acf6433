"""The same interactions on roads that point elsewhere: nothing may depend on where x and y point."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.numerics.geometry import Polyline, rotate
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.world.actors import ActorClass

AMBULANCE = ActorClass.AMBULANCE
TURNS = np.radians([37.0, -128.0])
SHIFT = np.array([40.0, -25.0])


def turned(network, angle):
    """The network turned about the origin and shifted; indices and ids stay."""
    lanes = tuple(
        replace(lane, centre=Polyline.through(rotate(lane.centre.points, angle) + SHIFT)) for lane in network.lanes
    )
    return RoadNetwork(lanes, network.edges, network.connections, {}, (0.0, 0.0), "!")


def lane_change(lab):
    cars = [lab.Car(1, 0, 40, 11, (0,), AMBULANCE)]
    cars += [lab.Car(2, 0, 75, 7, (0,), desired=7), lab.Car(3, 1, 62, 7, (0,), desired=7)]
    return lab.straight_road(2, 500.0), lab.L2, cars, 120


def pull_over_and_corridor(lab):
    cars = [lab.Car(1, 0, 30, 11, (0,), AMBULANCE)]
    cars += [lab.Car(10 + i, 0, 60 + 9 * i, 2, (0,), desired=2) for i in range(2)]
    cars += [lab.Car(20 + i, 1, 63 + 9 * i, 2, (0,), desired=2) for i in range(2)]
    return lab.straight_road(2, 500.0), lab.L3, cars, 110


def crossing(lab):
    network = lab.junction_road()
    cars = [lab.Car(1, 0, 90, 12, (0, 2), AMBULANCE), lab.Car(5, len(network.lanes) - 1, 55, 8, (5,), desired=8)]
    return network, lab.L1, cars, 120


def right_turn(lab):
    return lab.junction_road(), lab.L1, [lab.Car(1, 1, 80, 13.0, (0, 4), AMBULANCE)], 140


def gap_escape(lab):
    cars = [lab.Car(1, 0, 50, 0, (0,), AMBULANCE)]
    cars += [lab.Car(2, 0, 62, 0, (0,), desired=0), lab.Car(3, 1, 55, 0, (0,), desired=0)]
    return lab.straight_road(2, 300.0), lab.L3, cars, 130


@pytest.mark.parametrize("angle", TURNS)
@pytest.mark.parametrize("scene", [lane_change, pull_over_and_corridor, crossing, right_turn, gap_escape])
def test_a_turned_road_turns_the_interaction_and_changes_nothing_else(lab, scene, angle):
    network, level, cars, steps = scene(lab)
    plain = lab.Loop(lab.world_of(network, level), cars).run(steps)
    other = lab.Loop(lab.world_of(turned(network, angle), level), cars).run(steps)
    assert [(e.kind, e.actor_id, e.other_id) for e in other.events] == [
        (e.kind, e.actor_id, e.other_id) for e in plain.events
    ]
    # Rounding decides how many points a path gets, which moves vehicles by some centimetres and an event by a step.
    assert [e.step for e in other.events] == pytest.approx([e.step for e in plain.events], abs=1)
    for before, after in zip(plain.log, other.log, strict=True):
        for actor_id, pose in before.items():
            x, y = rotate(np.array(pose[:2]), angle) + SHIFT
            assert after[actor_id][:2] == pytest.approx((x, y), abs=0.5)
            assert np.cos(after[actor_id][2] - pose[2] - angle) > np.cos(0.05)
            assert after[actor_id][3] == pytest.approx(pose[3], abs=0.5)
