"""What the comparison of an episode with its mirror image finds."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from siren_ros.lab.benchmarks.left_hand import compare
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorStates
from siren_ros.simulation.world.mirror_image import mirror_image
from siren_ros.simulation.world.traffic_state import Event, EventKind

EVENT = Event(0, EventKind.YIELD_HELD, 5, 1, 2.0, 7.0, {"side": -1})


def step(x_m, y_m, ids=(1, 5), events=(EVENT,)):
    columns = {name: np.zeros(2, kind) for name, kind in ACTOR_STATE_DTYPES.items()}
    columns |= {"actor_id": np.array(ids, np.uint32), "x_m": np.array(x_m), "y_m": np.array(y_m)}
    return SimpleNamespace(states=ActorStates(step=0, **columns), events=events)


def image_of(one):
    return SimpleNamespace(states=mirror_image(one.states), events=tuple(map(mirror_image, one.events)))


OWN = step((1.0, 4.0), (3.0, -2.0))


def test_a_mirror_image_is_not_apart():
    found = compare([OWN, OWN], [image_of(OWN), image_of(OWN)])
    assert (found.apart_m, found.events_differ) == (0.0, False)


def test_the_largest_distance_of_all_steps_counts():
    moved = image_of(step((1.0, 4.3), (3.0, -1.6)))
    assert compare([OWN, OWN], [moved, image_of(OWN)]).apart_m == pytest.approx(0.5)
    assert compare([OWN], [OWN]).apart_m == pytest.approx(6.0), "not mirrored"


def test_other_events_and_other_actors():
    other = image_of(step((1.0, 4.0), (3.0, -2.0), events=(replace(EVENT, actor_id=6),)))
    assert compare([OWN], [other]).events_differ
    assert compare([OWN], [image_of(step((1.0, 4.0), (3.0, -2.0), ids=(1, 6)))]).apart_m == float("inf")
