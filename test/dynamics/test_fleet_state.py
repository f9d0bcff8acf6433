"""Actors join and leave in the middle of the rows; everything that is known of the others stays theirs."""

from dataclasses import replace

import numpy as np
import pytest
from dynamics.fleet_scenes import PARAMETERS, description, started, traffic_of

from siren_ros.dynamics.fleet_state import with_spawned, without_actors
from siren_ros.errors import EpisodeError
from siren_ros.world.actors import ActorClass, Owner

ROWS = {i: (10.0 * i, 50.0 * i, 0.1 * i, 3.0 * i) for i in (1, 2, 3, 4)}


def fleet_of_three():
    """Actors 1 to 3; each field of each row has its own value."""
    fleet, _ = started(3)
    columns = {name: np.arange(3.0) + 10.0 * place for place, name in enumerate(vars(fleet.bodies), start=1)}
    tracked = {name: np.arange(3.0) + 200.0 * place for place, name in enumerate(vars(fleet.tracker), start=1)}
    owner = np.array([Owner.SUMO, Owner.ROS, Owner.SUMO], np.uint8)
    return replace(
        fleet, bodies=replace(fleet.bodies, **columns), tracker=replace(fleet.tracker, **tracked), owner=owner
    )


def test_who_leaves_takes_its_row_alone():
    fleet = fleet_of_three()
    left = without_actors(fleet, np.array([1, 8], np.uint32))
    assert left.actor_id.tolist() == [2, 3]
    assert [item.actor_id for item in left.descriptions] == [2, 3]
    assert left.owner.tolist() == [Owner.ROS, Owner.SUMO]
    assert left.bodies.brake.tolist() == fleet.bodies.brake[1:].tolist()
    assert left.tracker.pace.tolist() == fleet.tracker.pace[1:].tolist()
    assert len(left.table) == len(left.length_m) == len(left.width_m) == 2
    assert without_actors(fleet, np.empty(0, np.uint32)) is fleet


def test_who_joins_starts_at_sumos_pose_with_its_speed_and_the_others_keep_theirs():
    fleet = without_actors(fleet_of_three(), np.array([2], np.uint32))
    bus = description(2, ActorClass.BUS)
    joined, fresh = with_spawned(fleet, traffic_of(1, {i: ROWS[i] for i in (1, 2, 3)}, [bus]))
    assert fresh.tolist() == [False, True, False]
    assert joined.actor_id.tolist() == [1, 2, 3]
    assert joined.owner.tolist() == [Owner.SUMO, Owner.SUMO, Owner.SUMO]
    assert (joined.length_m[1], joined.width_m[1]) == (bus.length_m, bus.width_m)
    assert joined.table.mass_kg[1] == PARAMETERS[ActorClass.BUS].mass_kg
    body, tracker = joined.bodies.select(np.array([1])), joined.tracker.select(np.array([1]))
    assert (body.x_m[0], body.y_m[0], body.yaw_rad[0], body.forward_mps[0]) == ROWS[2]
    assert not any(getattr(body, name)[0] for name in ("lateral_mps", "yaw_rate_radps", "steer_rad", "throttle"))
    assert (tracker.x_m[0], tracker.y_m[0], tracker.yaw_rad[0]) == ROWS[2][:3]
    assert (tracker.pace[0], tracker.accel_mps2[0]) == (1.0, 0.0)
    assert joined.bodies.steer_rad[[0, 2]].tolist() == fleet.bodies.steer_rad.tolist()
    assert joined.tracker.accel_mps2[[0, 2]].tolist() == fleet.tracker.accel_mps2.tolist()


def test_owners_follow_their_actors_as_others_join_before_and_after_them():
    fleet = without_actors(fleet_of_three(), np.array([1, 3], np.uint32))
    spawned = [description(4), description(1)]
    joined, fresh = with_spawned(fleet, traffic_of(1, {i: ROWS[i] for i in (1, 2, 4)}, spawned))
    assert joined.owner.tolist() == [Owner.SUMO, Owner.ROS, Owner.SUMO]
    assert fresh.tolist() == [True, False, True]
    assert joined.bodies.x_m.tolist() == [10.0, fleet.bodies.x_m[0], 40.0]
    assert [item.actor_id for item in joined.descriptions] == [1, 2, 4]


def test_without_arrivals_the_fleet_is_the_same_and_others_than_sumos_are_named():
    fleet = fleet_of_three()
    same, fresh = with_spawned(fleet, traffic_of(1, {i: ROWS[i] for i in (1, 2, 3)}))
    assert same is fleet
    assert not fresh.any()
    with pytest.raises(EpisodeError, match=r"not removed: \[3, 4\]"):
        with_spawned(fleet, traffic_of(1, {i: ROWS[i] for i in (1, 2, 4)}))
