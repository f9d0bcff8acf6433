"""Vehicles that are suddenly elsewhere, on roads that point anywhere."""

from types import SimpleNamespace

import numpy as np
import pytest

from siren_ros.numerics.units import STEP_S
from siren_ros.traffic.observation.teleports import find_teleports
from siren_ros.world.actors import Owner
from siren_ros.world.events import EventKind

LENGTH = 4.0
JUMP = 0.5
TURNS = np.radians([0.0, 50.0, 120.0, -100.0])


def column(*values):
    return np.array(values, dtype=float)


def found(moved, turn=0.0, swing=0.0, speeds=(8.0, 8.0), owners=(Owner.SUMO, Owner.SUMO), started=(), on_purpose=()):
    """Events of actor 7, whose front moves along a direction, while its rod swings about the front."""
    then, now = turn, turn + swing
    front = np.array([30.0, -10.0])
    after = front + moved * np.array([np.cos(turn), np.sin(turn)])
    before = front - 0.5 * LENGTH * np.array([np.cos(then), np.sin(then)])
    centre = after - 0.5 * LENGTH * np.array([np.cos(now), np.sin(now)])
    last = SimpleNamespace(
        actor_id=np.array([3, 7], np.uint32),
        owner=np.array([Owner.SUMO, owners[0]], np.uint8),
        sumo_x_m=column(0.0, before[0]),
        sumo_y_m=column(0.0, before[1]),
        sumo_yaw_rad=column(0.0, then),
        sumo_speed_mps=column(0.0, speeds[0]),
    )
    readings = SimpleNamespace(
        x_m=column(centre[0]), y_m=column(centre[1]), yaw_rad=column(now), speed_mps=column(speeds[1])
    )
    return find_teleports(
        12,
        np.array([7], np.uint32),
        readings,
        column(LENGTH),
        np.array([owners[1]], np.uint8),
        started,
        on_purpose,
        last,
        JUMP,
    )


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_front_that_moves_farther_than_the_speed_explains_has_jumped(turn, way):
    most = 8.0 * STEP_S + JUMP
    assert found(way * (most - 0.01), turn) == []
    (event,) = found(way * (most + 0.01), turn)
    assert (event.kind, event.actor_id, event.step, event.detail["reason"]) == (EventKind.TELEPORT, 7, 12, "jump")
    front = np.array([30.0, -10.0]) + way * (most + 0.01) * np.array([np.cos(turn), np.sin(turn)])
    centre = front - 0.5 * LENGTH * np.array([np.cos(turn), np.sin(turn)])
    assert (event.x_m, event.y_m) == pytest.approx(tuple(centre))


@pytest.mark.parametrize("swing", [1.5, -1.5])
def test_a_rod_that_swings_behind_its_front_has_not_jumped(swing):
    assert found(0.4, 0.6, swing) == []


@pytest.mark.parametrize("speeds", [(12.0, 2.0), (2.0, 12.0)])
def test_the_larger_of_both_speeds_explains_the_way(speeds):
    assert found(12.0 * STEP_S + JUMP - 0.01, speeds=speeds) == []
    assert len(found(12.0 * STEP_S + JUMP + 0.01, speeds=speeds)) == 1


@pytest.mark.parametrize("owners", [(Owner.ROS, Owner.SUMO), (Owner.SUMO, Owner.ROS), (Owner.ROS, Owner.ROS)])
def test_only_vehicles_that_sumo_owned_before_and_after_can_jump(owners):
    assert found(9.0, owners=owners) == []


def test_who_was_put_elsewhere_on_purpose_has_not_jumped():
    assert found(9.0, on_purpose=(7,)) == []
    assert len(found(9.0, on_purpose=(3,))) == 1


def test_what_sumo_calls_a_teleport_is_one_whether_or_not_the_vehicle_is_still_there():
    assert [(event.actor_id, event.detail["reason"]) for event in found(9.0, started=(7,))] == [(7, "sumo")]
    gone, present = found(0.4, started=(9, 7))[::-1]
    assert (present.actor_id, present.detail["reason"]) == (7, "sumo")
    assert (gone.actor_id, gone.x_m, gone.y_m) == (9, 0.0, 0.0)


def test_without_a_step_before_nobody_jumps():
    readings = SimpleNamespace(x_m=column(0.0), y_m=column(0.0), yaw_rad=column(0.0), speed_mps=column(1.0))
    ids, owner = np.array([7], np.uint32), np.array([Owner.SUMO], np.uint8)
    assert find_teleports(0, ids, readings, column(LENGTH), owner, (), (), None, JUMP) == []
