"""What is known of the actors, row by row, as they come and go."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.simulation.behaviour.driving.step_view import STEER_RATE_SHARE, ActorTable, Surroundings
from siren_ros.simulation.behaviour.driving.tracked_path import Navigation
from siren_ros.simulation.world.actors import ActorClass, Lights


def scene(lab, cars, **more):
    return lab.traffic_of(lab.straight_road(), cars, **more)


def fleet(lab):
    return [
        lab.Car(3, 0, 50, 5, (0,), ActorClass.BUS),
        lab.Car(1, 1, 20, 8, (0,), ActorClass.AMBULANCE),
        lab.Car(7, 1, 90, 2, (0,), ActorClass.SEDAN),
    ]


def test_rows_have_the_sizes_of_their_own_actors_also_of_a_table_that_knows_more(lab):
    table = ActorTable.empty().updated(scene(lab, fleet(lab)))
    for kept in ([0, 1, 2], [0, 2], [2]):
        traffic = scene(lab, [fleet(lab)[row] for row in kept], spawn=False)
        seen = Surroundings.seen(traffic, table)
        classes = [table.by_id[actor_id].actor_class for actor_id in traffic.actor_id.tolist()]
        assert seen.half_length_m.tolist() == [0.5 * lab.vehicles[kind].length_m for kind in classes]
        assert seen.half_width_m.tolist() == [0.5 * lab.vehicles[kind].width_m for kind in classes]
        assert seen.is_emv.tolist() == [kind is ActorClass.AMBULANCE for kind in classes]
    with pytest.raises(KeyError, match="9"):
        Surroundings.seen(scene(lab, [*fleet(lab), lab.Car(9, 0, 10, 0, (0,))]), table)
    with pytest.raises(KeyError, match="9"):
        Surroundings.seen(scene(lab, [fleet(lab)[0], fleet(lab)[1], lab.Car(9, 0, 10, 0, (0,))]), table)


def test_the_table_gains_who_is_spawned_and_loses_who_is_removed(lab):
    table = ActorTable.empty().updated(scene(lab, fleet(lab)))
    assert table.actor_id.tolist() == [1, 3, 7]
    assert table.updated(scene(lab, fleet(lab), spawn=False)) is table
    gone = replace(scene(lab, fleet(lab)[1:], spawn=False), removed=np.array([3], np.uint32))
    assert table.updated(gone).actor_id.tolist() == [1, 7]
    again = replace(scene(lab, [fleet(lab)[0]]), removed=np.array([1, 3], np.uint32))
    assert table.updated(again).actor_id.tolist() == [3, 7], "who is removed and spawned at one step is there"
    assert table.updated(gone).length_m.tolist() == [table.length_m[0], table.length_m[2]]


def test_near_is_within_the_radius_and_without_one_row_if_wanted(lab):
    """The three stand at 50, 20 and 90 m; the last row is as good as any other."""
    traffic = scene(lab, fleet(lab))
    seen = Surroundings.seen(traffic, ActorTable.empty().updated(traffic))
    x, y = float(seen.x_m[2]), float(seen.y_m[2])
    assert (seen.near(x, y, 41.0).tolist(), seen.near(x, y, 41.0, but=2).tolist()) == ([1, 2], [1])
    assert seen.near(x, y, 41.0, but=0).tolist() == [1, 2]
    first = float(seen.x_m[0]), float(seen.y_m[0])
    assert (seen.near(*first, 1.0).tolist(), seen.near(*first, 1.0, but=0).tolist()) == ([0], [])
    apart = float(np.hypot(x - seen.x_m[1], y - seen.y_m[1]))
    assert (seen.near(x, y, apart - 0.01).tolist(), seen.near(x, y, apart + 0.01).tolist()) == ([2], [1, 2])


def test_emvs_and_civilians_have_their_own_navigator_with_the_limit_of_their_steering(lab):
    cars = [lab.Car(1, 0, 50, 5, (0,), ActorClass.FIRE_TRUCK), lab.Car(2, 0, 90, 5, (0,), ActorClass.BUS)]
    view = lab.view(lab.straight_road(), lab.L2, cars)
    config = view.world.config
    for row, kind, base in (
        (0, ActorClass.FIRE_TRUCK, config.emv_driver.driving),
        (1, ActorClass.BUS, config.civilian_driver.driving),
    ):
        vehicle = lab.vehicles[kind]
        rate = STEER_RATE_SHARE * vehicle.max_steer_rate_radps / vehicle.wheelbase_m
        assert view.ego(row).navigator_config == Navigation.by(base, curvature_rate_1pms=rate)
        assert view.ego(row).vehicle == vehicle
    assert [view.ego(row).navigator_config.standstill_gap_m for row in (0, 1)] == [4.0, 2.0]
    assert (view.ego(1).pose, view.world.edge_of_lane.tolist()) == (pytest.approx((90.0, 0.0, 0.0)), [0, 0])


def test_indicators_are_those_of_a_move_or_of_the_next_turn_without_other_lights(lab):
    left, right, both = Lights.INDICATOR_LEFT, Lights.INDICATOR_RIGHT, Lights.INDICATORS
    for shown in (Lights.NONE, left, right, both):
        every = {3: shown | Lights.BRAKE | Lights.BEACON | Lights.SIREN}
        ego = lab.view(lab.straight_road(), lab.L2, fleet(lab), lights=every).ego(1)
        assert [ego.indicators(side) for side in (0, 1, -1)] == [shown, left, right]


def test_the_gaps_and_decelerations_of_each_task_are_its_own(lab):
    """An EMV that may leave its lane keeps the space to pull out; who makes room comes closer, who holds brakes."""
    worlds = [lab.world_of(lab.straight_road(), level) for level in (lab.L1, lab.L2, lab.L3)]
    assert [world.emv_navigator.standstill_gap_m for world in worlds] == [4.0, 4.0, 6.0]
    world = worlds[-1]
    usual = world.civilian_navigator
    assert world.room_navigator == replace(usual, standstill_gap_m=1.0) != usual
    assert world.hold_navigator == replace(usual, ease_off_mps2=usual.comfort_brake_mps2) != usual


def test_both_controllers_share_their_view_of_a_step(lab):
    world, cars = lab.world_of(lab.straight_road(), lab.L2), fleet(lab)
    traffic, nobody = scene(lab, cars), ActorTable.empty()
    view = world.view(traffic, nobody)
    assert world.view(traffic, ActorTable.empty()) is view
    assert view.actors.actor_id.tolist() == view.seen.actor_id.tolist() == traffic.actor_id.tolist()
    later = scene(lab, cars)
    assert world.view(later, nobody).traffic is later
    assert world.view(later, nobody.updated(traffic)) is not world.view(later, nobody)
