"""L3 next to a shoulder on which an EMV comes: who stays, and who goes to the left."""

import numpy as np
import pytest
from behaviour.civilians.pull_over_steps import kinds, shoulder_road, steps

from siren_ros.world.actors import ActorClass, Mode


def in_queue(lab, world, speed=0.0, left=0.0, turned=0.0, apart_m=0.0):
    """The first steps of a driver in lane 1 and one in lane 2, as an EMV comes that will turn right."""
    cars = [
        lab.Car(1, 1, 40, 8, (0, 1), ActorClass.AMBULANCE),
        lab.Car(2, 1, 75, speed, (0, 2)),
        lab.Car(3, 2, 75 - apart_m, speed, (0, 2)),
    ]
    poses = np.array([[40.0, 3.3, 0.0, 8.0], [75.0, 3.3 + left, turned, speed], [75.0 - apart_m, 6.6, 0.0, speed]])
    return steps(lab, world, cars, 30, poses=poses)


def test_who_stands_and_leaves_the_shoulder_free_stays_there(lab):
    state, commands, events = in_queue(lab, shoulder_road(lab))
    assert {actor: unit.phase for actor, unit in state.units.items()} == dict.fromkeys((2, 3), Mode.YIELD_HOLD)
    assert commands.brake.tolist() == [1.0, 1.0]
    told = {kind: sorted(e.actor_id for e in events if e.kind.value == kind) for kind in kinds(events)}
    assert told == {kind: [2, 3] for kind in ("yield_requested", "yield_started", "yield_held")}
    assert [event.detail["partial"] for event in events if event.kind.value == "yield_held"] == [0, 0]


@pytest.mark.parametrize(
    ("place", "phase"),
    [
        ({"left": -1.4}, Mode.YIELD_HOLD),
        ({"left": -1.5}, Mode.YIELD_PULL_OVER),
        ({"turned": -0.2}, Mode.YIELD_PULL_OVER),
        ({"speed": 1.4}, Mode.YIELD_HOLD),
        ({"speed": 1.6}, Mode.YIELD_PULL_OVER),
    ],
)
def test_who_stands_in_the_way_along_the_shoulder_or_drives_pulls_over(lab, place, phase):
    # 3.3 m of shoulder and 1.65 m to the lane's middle, less half a width of 0.915 m, are 4.035 m; 2.6 m are needed.
    state, _, _ = in_queue(lab, shoulder_road(lab), **place)
    assert state.units[2].phase is phase
    assert state.units[2].side == 1


@pytest.mark.parametrize(("width", "phase"), [(1.9, Mode.YIELD_HOLD), (1.83, Mode.YIELD_PULL_OVER)])
def test_next_to_a_narrow_shoulder_all_lanes_go_to_the_left(lab, width, phase):
    state, _, _ = in_queue(lab, shoulder_road(lab, width))
    assert {state.units[actor].phase for actor in (2, 3)} == {phase}


@pytest.mark.parametrize(("apart_m", "phase"), [(14.0, Mode.YIELD_PULL_OVER), (16.0, Mode.YIELD_HOLD)])
def test_a_driver_gives_space_to_who_stands_near_on_the_right(lab, apart_m, phase):
    state, _, _ = in_queue(lab, shoulder_road(lab, 1.83), apart_m=apart_m)
    assert (state.units[2].phase, state.units[3].phase) == (Mode.YIELD_PULL_OVER, phase)
