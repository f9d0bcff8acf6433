"""Lane changes of civilians at L2, and the way back to the lane."""

import math
from dataclasses import replace

import numpy as np
import pytest
from behaviour.civilians.civilian_steps import NEAR
from behaviour.civilians.civilian_steps import UNIT as HOLDING
from behaviour.lab import kinds
from synthetic_episode import rotate

from siren_ros.base.numerics.units import NEVER
from siren_ros.simulation.behaviour.civilians.yield_lane_change import (
    LEAST_SIDEWAYS_M,
    Seek,
    change_lane,
    choose_seek,
    defer,
    intent_of,
    is_over_red_line,
    keep_lane,
    rejoin,
    seek_gap,
    seek_speed_mps,
    soon_free,
    start_lane_change,
    start_rejoin,
)
from siren_ros.simulation.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.simulation.behaviour.driving.driver_states import Compliance, Driver, Refusal, YieldUnit
from siren_ros.simulation.behaviour.driving.lane_change import LaneChangeQuery, LaneGaps, assess
from siren_ros.simulation.behaviour.driving.navigator import FULL_BRAKE, NavigatorState
from siren_ros.simulation.behaviour.driving.tracked_path import LanePath, blend_length_m
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.scenario.driver_parameters import YieldConfig
from siren_ros.simulation.world.actors import ActorClass, Mode, Owner, SignalState, TrafficFlags

CONFIG = YieldConfig(seek_speed_mps=2.5)
BEHIND = LaneGaps(math.inf, 0.0, 3.0, 8.0)
AHEAD = LaneGaps(1.0, 6.0, math.inf, 0.0)


@pytest.mark.parametrize(
    ("gaps", "own_free", "refusal", "limit", "expected"),
    [
        (BEHIND, 50.0, Refusal.GAP_REAR, 13.9, Seek.DRAW_AHEAD),
        (BEHIND, 5.0, Refusal.GAP_REAR, 13.9, Seek.FALL_BACK),
        (AHEAD, 50.0, Refusal.GAP_FRONT, 13.9, Seek.FALL_BACK),
        # Ahead of who is alongside and further ahead the way is longer: 2.5 m/s must be gained.
        (LaneGaps(-2.0, 6.0, math.inf, 0.0), 50.0, Refusal.BESIDE, 8.4, Seek.FALL_BACK),
        (LaneGaps(-2.0, 6.0, math.inf, 0.0), 50.0, Refusal.BESIDE, 8.6, Seek.DRAW_AHEAD),
        (LaneGaps(-2.0, 6.0, math.inf, 0.0), 5.0, Refusal.BESIDE, 8.6, Seek.FALL_BACK),
        (LaneGaps(math.inf, 0.0, -2.0, 6.0), 50.0, Refusal.BESIDE, 13.9, Seek.DRAW_AHEAD),
        # Who drives at the limit cannot be left behind.
        (BEHIND, 50.0, Refusal.GAP_REAR, 8.3, Seek.FALL_BACK),
    ],
)
def test_draws_ahead_of_what_is_behind_and_lets_the_rest_past(gaps, own_free, refusal, limit, expected):
    assert choose_seek(gaps, LaneGaps(own_free, 6.0, math.inf, 0.0), refusal, CONFIG, limit) is expected


def test_speed_differs_from_the_vehicle_in_the_way_within_limits():
    assert seek_speed_mps(Seek.DRAW_AHEAD, BEHIND, CONFIG, 13.9) == pytest.approx(10.5)
    assert seek_speed_mps(Seek.DRAW_AHEAD, BEHIND, CONFIG, 9.0) == pytest.approx(9.0)
    assert seek_speed_mps(Seek.FALL_BACK, AHEAD, CONFIG, 13.9) == pytest.approx(3.5)
    assert seek_speed_mps(Seek.FALL_BACK, AHEAD._replace(front_mps=1.0), CONFIG, 13.9) == CONFIG.seek_least_mps


@pytest.mark.parametrize(
    ("seek", "gaps", "expected"),
    [
        (Seek.FALL_BACK, LaneGaps(-1.0, 8.0, math.inf, 0.0), True),  # 3 m are wanted, 2 s at 1.5 m/s give them
        (Seek.FALL_BACK, LaneGaps(-1.1, 8.0, math.inf, 0.0), False),
        (Seek.FALL_BACK, LaneGaps(-1.0, 5.0, math.inf, 0.0), False),
        (Seek.FALL_BACK, LaneGaps(-1.0, 8.0, -0.5, 6.0), False),
        (Seek.FALL_BACK, LaneGaps(30.0, 8.0, -0.5, 8.0), False),  # the one in the way has still to pass
        (Seek.DRAW_AHEAD, LaneGaps(math.inf, 0.0, -1.0, 5.0), True),
        (Seek.DRAW_AHEAD, LaneGaps(math.inf, 0.0, -1.0, 8.0), False),
        (Seek.DRAW_AHEAD, LaneGaps(-0.5, 5.0, -1.0, 5.0), False),
        (Seek.NOT, LaneGaps(-1.0, 8.0, math.inf, 0.0), False),
    ],
)
def test_a_gap_is_soon_free_if_the_way_gained_until_then_is_enough(seek, gaps, expected):
    assert soon_free(seek, gaps, 6.5, 2.0, 2.0) is expected


def test_a_deferred_driver_falls_back_and_then_changes_lanes(lab):
    cars = [
        lab.Car(1, 0, 40, 8, (0,), ActorClass.AMBULANCE),
        lab.Car(2, 0, 75, 7, (0,), desired=7),
        lab.Car(3, 1, 76, 7, (0,), desired=7),
    ]
    loop = lab.Loop(lab.world_of(lab.straight_road(2, 700.0), lab.L2), cars).run(10)
    assert (loop.modes[2], loop.owners[2]) == (Mode.YIELD_DEFERRED, Owner.SUMO)
    loop.run(5)
    assert (loop.modes[2], loop.owners[2]) == (Mode.YIELD_DEFERRED, Owner.ROS)
    loop.run(300)
    assert [event.actor_id for event in loop.of("yield_completed")] == [2]
    assert len(loop.of("yield_deferred")) == 1
    assert not loop.touching()


def test_no_gap_is_sought_right_before_a_junction(lab, junction):
    cars = [
        lab.Car(1, 0, 90, 3, (0, 2), ActorClass.AMBULANCE),
        lab.Car(2, 0, 128, 3, (0, 2), desired=3),
        lab.Car(3, 1, 128, 3, (0, 2), desired=3),
    ]
    loop = lab.Loop(lab.world_of(junction, lab.L2), cars).run(40)
    assert loop.of("yield_deferred")
    assert all(row[2][4] == Owner.SUMO for row in loop.log)


NEW_UNIT = YieldUnit(2, 1, Driver(Compliance.COMPLIES, 0.0, 40.0), 0)


def view_at(lab, *others, lane=1, lanes=3, step=200, speed=5.0, flags=0, network=None, route=(0,), s=80.0):
    network = network or lab.straight_road(lanes)
    cars = [
        lab.Car(1, lane, 50, 8, route, ActorClass.AMBULANCE),
        lab.Car(2, lane, s, speed, route, flags=flags),
        *others,
    ]
    return lab.view(network, lab.L2, cars, step=step)


@pytest.mark.parametrize(("since", "starts"), [(39, False), (40, True)])
def test_the_cooldown_since_the_last_change_comes_first(lab, since, starts):
    view = view_at(lab)
    assert view.world.cooldown_steps == 40
    outcome = start_lane_change(replace(NEW_UNIT, change_step=200 - since), view.ego(1))
    assert kinds(outcome.events) == (["yield_started"] if starts else ["yield_deferred"])
    assert outcome.unit.change_step == (200 if starts else 200 - since)


def test_nothing_of_a_deferral_is_left_when_the_change_starts(lab):
    waiting = replace(NEW_UNIT, phase=Mode.YIELD_DEFERRED, deferred="gap_rear", seek=1, side=1, change_step=NEVER)
    outcome = start_lane_change(waiting, view_at(lab).ego(1))
    unit = outcome.unit
    assert (unit.phase, unit.side, unit.deferred, unit.seek) == (Mode.YIELD_LANE_CHANGE, -1, "", 0)
    assert outcome.events[0].detail == {"side": -1, "from_lane": 1, "to_lane": 0}
    assert unit.navigator.path.curve.points[-1, 1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("flags", "intent"),
    [
        *[(0, 0), (TrafficFlags.WANTS_LEFT, 1)],
        *[(TrafficFlags.WANTS_RIGHT, -1), (TrafficFlags.WANTS_LEFT | TrafficFlags.WANTS_RIGHT, 0)],
    ],
)
def test_sumos_intent_as_a_side(lab, flags, intent):
    assert intent_of(view_at(lab, flags=int(flags)).ego(1)) == intent


def beside(lab, lane=2):
    return lab.Car(3, lane, 81, 5, (0,))


@pytest.mark.parametrize(
    ("lane", "others", "reason"), [(0, [1], "vehicle_beside"), (0, [], None), (1, [0, 2], "vehicle_beside")]
)
def test_the_reason_of_a_deferral_is_what_keeps_the_driver_from_a_lane(lab, lane, others, reason):
    """A missing lane on the other side is no reason."""
    cars = [lab.Car(3 + k, at, 81, 5, (0,)) for k, at in enumerate(others)]
    outcome = start_lane_change(NEW_UNIT, view_at(lab, *cars, lane=lane).ego(1))
    assert outcome.unit.deferred == (reason or "")
    if reason:
        assert (outcome.unit.deferred_step, outcome.unit.phase) == (200, Mode.YIELD_DEFERRED)
        assert outcome.events[0].detail["reason"] == reason


def test_on_a_road_of_one_lane_there_is_no_lane(lab):
    assert start_lane_change(NEW_UNIT, view_at(lab, lane=0, lanes=1).ego(1)).unit.deferred == "no_lane"


@pytest.mark.parametrize(("side", "kept"), [(1, 1), (-1, -1), (0, -1)])
def test_of_two_blocked_sides_the_driver_stays_with_its_own_and_begins_with_the_right_one(lab, side, kept):
    cars = [beside(lab, 0), replace(beside(lab, 2), actor_id=4)]
    waiting = replace(NEW_UNIT, side=side, phase=Mode.YIELD_DEFERRED, deferred_step=199)
    assert start_lane_change(waiting, view_at(lab, *cars).ego(1)).unit.side == kept


@pytest.mark.parametrize(
    ("waited", "seeks"),
    [(9, False), (10, True), (89, True), (90, False), (169, False), (170, True), (249, True), (250, False)],
)
def test_a_gap_is_sought_for_4_s_after_half_a_second_and_again_after_4_s(lab, waited, seeks):
    waiting = replace(NEW_UNIT, side=1, phase=Mode.YIELD_DEFERRED, deferred_step=200 - waited + 100)
    view = view_at(lab, beside(lab, 0), replace(beside(lab, 2), actor_id=4), step=300)
    outcome = start_lane_change(waiting, view.ego(1))
    assert (outcome.command is not None) is seeks
    assert (outcome.unit.seek != 0) is seeks
    assert (outcome.unit.deferred, outcome.unit.deferred_step) == ("vehicle_beside", waiting.deferred_step)


def changing(lab, left=1.5, speed=5.0, **emv):
    unit = start_lane_change(NEW_UNIT, view_at(lab, speed=speed).ego(1)).unit
    network = lab.straight_road(3)
    cars = [lab.Car(1, 1, 50, 8, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, 84, speed, (0,), left=left)]
    later = lab.view(network, lab.L2, cars, step=210)
    return change_lane(replace(unit, off_path_steps=9, stopped_steps=30), later.ego(1), replace(NEAR, **emv)), unit


def test_a_change_goes_on_until_the_vehicle_is_in_its_lane(lab):
    outcome, _ = changing(lab)
    assert outcome.unit.phase is Mode.YIELD_LANE_CHANGE
    assert outcome.command is not None
    outcome, _ = changing(lab, left=0.0)
    assert kinds(outcome.events) == ["yield_completed"]
    unit = outcome.unit
    assert (unit.phase, unit.navigator.path, unit.off_path_steps) == (Mode.YIELD_KEEP_LANE, None, 0)
    assert outcome.command is None
    assert outcome.events[0].detail == {"lane": 0}


def on_the_way(lab, speed, coming_mps, at_m, left=0.0, lane=1):
    network = lab.straight_road(3)
    unit = replace(start_lane_change(NEW_UNIT, view_at(lab).ego(1)).unit, side=-1)
    cars = [
        lab.Car(1, 1, 50, 0, (0,), ActorClass.AMBULANCE),
        lab.Car(2, lane, 84, speed, (0,), left=left),
        lab.Car(3, 0, 84 + at_m, coming_mps, (0,)),
    ]
    return change_lane(unit, lab.view(network, lab.L2, cars, step=210).ego(1), NEAR).command


def test_who_had_to_stop_on_the_way_lets_those_pass_who_come_in_the_new_lane(lab):
    """The gap was free when the change began; whoever comes at 10 m/s from 20 m behind cannot stop for it now."""
    for at_m, waits in ((-20.0, True), (-3.0, True), (-50.0, False), (20.0, False)):
        assert (on_the_way(lab, speed=0.0, coming_mps=10.0, at_m=at_m).throttle == 0.0) is waits
    assert on_the_way(lab, speed=0.0, coming_mps=0.0, at_m=-20.0).throttle > 0.0
    assert on_the_way(lab, speed=2.0, coming_mps=10.0, at_m=-20.0).throttle > 0.0, "it moves"
    assert on_the_way(lab, speed=0.0, coming_mps=10.0, at_m=-20.0, lane=0, left=1.5).throttle > 0.0


@pytest.mark.parametrize(("emv", "reason"), [({"passed": True}, "emv_passed"), ({"in_region": False}, "emv_gone")])
def test_a_change_is_cancelled_and_the_way_back_counts_its_standstill_anew(lab, emv, reason):
    outcome, _ = changing(lab, **emv)
    assert outcome.events[0].detail["reason"] == reason
    assert (outcome.unit.phase, outcome.unit.stopped_steps) == (Mode.REJOIN, 0)


@pytest.mark.parametrize(("stood", "phase"), [(78, Mode.YIELD_LANE_CHANGE), (79, Mode.REJOIN)])
def test_who_stands_on_the_way_for_4_s_goes_back_to_the_lane(lab, stood, phase):
    unit = replace(start_lane_change(NEW_UNIT, view_at(lab).ego(1)).unit, stopped_steps=stood)
    network = lab.straight_road(3)
    cars = [lab.Car(1, 1, 50, 0, (0,), ActorClass.AMBULANCE), lab.Car(2, 1, 84, 0, (0,), left=-1.0)]
    outcome = change_lane(unit, lab.view(network, lab.L2, cars, step=300).ego(1), NEAR)
    assert outcome.unit.phase is phase
    if phase is Mode.REJOIN:
        assert outcome.events[0].detail["reason"] == "blocked"
        path = outcome.unit.navigator.path
        assert path.lane_at(path.length_m) == 1


@pytest.mark.parametrize(("passed", "reason"), [(False, "lane_ended"), (True, "emv_passed")])
def test_who_stands_at_the_end_of_its_path_has_no_lane_left(lab, passed, reason):
    unit = replace(NEW_UNIT, phase=Mode.YIELD_LANE_CHANGE, side=-1, navigator=NavigatorState())
    network = lab.straight_road(3)
    cars = [lab.Car(1, 1, 50, 8, (0,), ActorClass.AMBULANCE), lab.Car(2, 1, 84, 0, (0,), left=-1.4)]
    view = lab.view(network, lab.L2, cars, step=210)
    assert change_lane(unit, view.ego(1), replace(NEAR, passed=passed)).events[0].detail["reason"] == reason


def keeping(lab, unit, **emv):
    return keep_lane(unit, view_at(lab, lane=0).ego(1), replace(NEAR, **emv))


def test_the_steps_in_which_the_emv_follows_are_counted_and_begin_again(lab):
    unit = replace(NEW_UNIT, phase=Mode.YIELD_KEEP_LANE, in_lane_steps=18, off_path_steps=7)
    assert keeping(lab, unit).unit.in_lane_steps == 19
    assert keeping(lab, unit, on_path=False).unit.in_lane_steps == 0
    asked = keeping(lab, replace(unit, in_lane_steps=19))
    assert kinds(asked.events) == ["yield_requested"]
    again = asked.unit
    assert (again.phase, again.react_step) == (Mode.YIELD_REACTING, 200)
    assert (again.in_lane_steps, again.off_path_steps) == (0, 0)


def test_the_steps_off_the_road_are_counted_and_begin_again(lab):
    unit = replace(NEW_UNIT, phase=Mode.YIELD_KEEP_LANE, off_path_steps=18)
    assert keeping(lab, unit, on_path=False, on_road=False).unit.off_path_steps == 19
    assert keeping(lab, unit, on_path=False).unit.off_path_steps == 0
    gone = keeping(lab, replace(unit, off_path_steps=20), on_path=False, on_road=False)
    assert gone.unit is None
    assert gone.events[0].detail["reason"] == "emv_gone"
    assert keeping(lab, replace(unit, off_path_steps=20)).unit is not None
    for emv, reason in (({"passed": True}, "emv_passed"), ({"in_region": False}, "emv_gone")):
        assert keeping(lab, unit, **emv).events[0].detail["reason"] == reason


@pytest.mark.parametrize("phase", [Mode.YIELD_REACTING, Mode.YIELD_DEFERRED])
def test_who_is_deferred_seeks_no_gap_any_more_and_has_no_path(lab, phase):
    view = view_at(lab)
    path = start_lane_change(NEW_UNIT, view.ego(1)).unit.navigator
    seeking = replace(NEW_UNIT, phase=phase, seek=1, side=1, navigator=path, deferred_step=150)
    outcome = defer(seeking, view.ego(1), "no_room")
    unit = outcome.unit
    assert (unit.phase, unit.seek, unit.side, unit.navigator.path) == (Mode.YIELD_DEFERRED, 0, 1, None)
    assert (unit.deferred, unit.deferred_step) == ("no_room", 200 if phase is Mode.YIELD_REACTING else 150)
    assert kinds(outcome.events) == (["yield_deferred"] if phase is Mode.YIELD_REACTING else [])
    assert outcome.command is None


def test_between_two_turns_of_seeking_nothing_of_the_first_is_left(lab):
    world = lab.world_of(lab.straight_road(2, 900.0), lab.L2)
    config = world.config.civilian_driver.yielding
    state, units = YieldState(), {}
    for step in range(round((config.seek_after_s + config.seek_for_s + 0.5) / 0.05)):
        x = 100.0 + 0.25 * step
        cars = [lab.Car(1, 0, x - 30.0, 5, (0,), ActorClass.AMBULANCE)]
        cars += [lab.Car(2, 0, x, 5, (0,)), lab.Car(3, 1, x, 5, (0,))]
        state, _ = step_yield(state, lab.traffic_of(world.network, cars, step=step, spawn=step == 0), world)
        units[step] = state.units[2]
    before, during, after = units[5], units[60], units[max(units)]
    assert (before.seek, before.navigator.path) == (0, None)
    assert during.seek != 0
    assert during.navigator.path is not None
    assert (after.seek, after.navigator.path) == (0, None)
    assert {unit.deferred_step for unit in units.values()} == {0}
    assert {unit.side for unit in units.values()} == {1}


def seeking(lab, step, deferred_step, seek):
    """One step of a driver with a vehicle close behind in the next lane, which is no reason to fall back."""
    network = lab.straight_road(2, 900.0)
    view = lab.view(network, lab.L2, [lab.Car(2, 0, 100, 6, (0,)), lab.Car(3, 1, 92, 7, (0,))], step=step)
    unit = YieldUnit(
        2, 1, Driver(Compliance.COMPLIES, 0.0, 40.0), 0, Mode.YIELD_DEFERRED, side=1, deferred_step=deferred_step
    )
    return seek_gap(replace(unit, seek=seek), view.ego(0), Refusal.GAP_REAR), view


@pytest.mark.parametrize(("step", "again"), [(36, False), (37, True), (38, False), (67, True)])
def test_the_driver_thinks_again_each_one_and_a_half_seconds_from_the_deferral_on(lab, step, again):
    """Deferred at step 7: 30 steps later, and 30 later again."""
    assert seeking(lab, step, 7, Seek.FALL_BACK)[0].unit.seek == (Seek.DRAW_AHEAD if again else Seek.FALL_BACK)


def test_the_path_of_a_driver_who_seeks_a_gap_ends_with_a_stop(lab):
    outcome, view = seeking(lab, 8, 7, Seek.NOT)
    path = outcome.unit.navigator.path
    assert path.speed_cap_mps(path.length_m) < 0.1
    assert path.curve.points[0, 0] == pytest.approx(98.0)
    assert path.length_m == pytest.approx(80.0 - float(view.seen.half_length_m[0]) - 1.0)


@pytest.mark.parametrize(("spare", "verdict"), [(0.3, LanePath), (-0.3, Refusal)])
def test_a_lane_change_ends_with_the_front_before_the_junction(lab, junction, spare, verdict):

    def view_at(s):
        return lab.view(junction, lab.L2, [lab.Car(2, 0, s, 8, (0, 2))])

    def query(view):
        return LaneChangeQuery(view.ego(0), 0, 1, 8.0, civilian=True)

    far = view_at(50.0)
    s = 150.0 - float(far.seen.half_length_m[0]) - query(far).length_m - spare
    view = view_at(s)
    assert isinstance(assess(query(view)), verdict)


HELD_UNIT = replace(HOLDING, stopped_steps=30)
NEAR_M = 0.3
"""Offset from the lane's centre line at which a vehicle counts as in its lane."""


def view_beside(lab, left, turned=0.0, speed=0.0, turn=0.0, s=100.0, length=400.0, kind=ActorClass.SEDAN):
    """A vehicle beside the centre line of the right one of two lanes that point anywhere."""
    network, along, across = lab.turned_road(turn, length=length)
    poses = np.array([[*(s * along + left * across), turn + turned, speed]])
    return lab.view(network, lab.L3, [lab.Car(2, 0, s, speed, (0,), kind)], poses=poses), along, across


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.2])
@pytest.mark.parametrize(
    ("left", "degrees", "back"),
    [
        *[(0.29, 0.0, True), (-0.29, 0.0, True), (0.31, 0.0, False), (-0.31, 0.0, False)],
        *[(0.0, 7.0, True), (0.0, -7.0, True), (0.0, 9.0, False), (0.0, -9.0, False)],
    ],
)
def test_sumo_takes_over_at_once_who_is_in_the_lane_and_straight(lab, turn, left, degrees, back):
    outcome = start_rejoin(HELD_UNIT, view_beside(lab, left, np.radians(degrees), turn=turn)[0].ego(0))
    assert (outcome.unit is None) is back
    assert [event.kind.value for event in outcome.events] == (["yield_released"] if back else [])


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.2])
@pytest.mark.parametrize(("left", "side"), [(-0.8, 1), (0.8, -1)])
def test_the_path_leads_to_the_middle_of_the_lane_and_shows_that_side(lab, turn, left, side):
    view, along, across = view_beside(lab, left, turn=turn)
    outcome = start_rejoin(HELD_UNIT, view.ego(0))
    unit, path = outcome.unit, outcome.unit.navigator.path
    assert (unit.phase, unit.side) == (Mode.REJOIN, side)
    assert unit.stopped_steps == 1, "the count of the hold is not taken over"
    assert path.curve.points[0] == pytest.approx(100.0 * along + left * across)
    assert path.curve.points[-1] @ across == pytest.approx(0.0, abs=1e-6)
    half = float(view.seen.half_length_m[0])
    assert path.curve.points[-1] @ along == pytest.approx(100.0 - 2.0 + 60.0 - half - 1.0, abs=0.01)
    assert path.speed_cap_mps(path.length_m) < 0.1
    assert np.sign(outcome.command.steer_rad) == side
    assert outcome.command.throttle > 0.0


def test_a_long_vehicle_comes_back_on_one_and_a_half_of_its_lengths(lab):
    for kind in (ActorClass.BUS, ActorClass.SEDAN):
        view, *_ = view_beside(lab, -0.8, kind=kind)
        path = start_rejoin(HELD_UNIT, view.ego(0)).unit.navigator.path
        assert path.settled_m >= 3.0 * float(view.seen.half_length_m[0])


def rejoining(lab, **place):
    view, _, _ = view_beside(lab, -0.8, **place)
    return replace(start_rejoin(HELD_UNIT, view.ego(0)).unit, stopped_steps=0), view


def steps(unit, view, count):
    for _ in range(count):
        outcome = rejoin(unit, view.ego(0))
        if outcome.unit is None:
            return outcome
        unit = outcome.unit
    return outcome


def test_who_stands_straight_for_two_seconds_on_end_is_handed_back_where_it_stands(lab):
    unit, view = rejoining(lab)
    patience = round(view.world.config.civilian_driver.yielding.rejoin_blocked_s / 0.05)
    assert steps(unit, view, patience).unit is None
    waiting = steps(unit, view, patience - 1).unit
    moved = steps(waiting, view_beside(lab, -0.8, speed=1.0)[0], 1).unit
    assert moved.stopped_steps == 0
    assert steps(moved, view, patience - 1).unit is not None
    assert steps(*rejoining(lab, turned=np.radians(12.0)), 60).unit is not None, "it stands at an angle"


TURN = 2.2


def with_other(view, ahead_m, aside_m):
    """The pose of the vehicle on the turned road, and of one that stands ahead of it and to its left."""
    place = np.array(view.ego(0).place)
    other = place + rotate(np.array([ahead_m, aside_m]), TURN)
    return np.array([[*place, TURN, view.ego(0).speed_mps], [*other, TURN, 0.0]])


@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "back"), [(5.5, 2.4, False), (5.5, 2.8, True), (-1.0, 2.4, True), (13.5, 2.4, True)]
)
def test_nobody_is_handed_back_into_the_way_of_who_is_in_front(lab, ahead_m, aside_m, back):
    """The vehicle stands 0.8 m right of the middle; on the way there it sweeps 1.7 m on its left."""
    unit, view = rejoining(lab, turn=TURN)
    cars = [lab.Car(2, 0, 100.0, 0.0, (0,)), lab.Car(3, 1, 100.0 + ahead_m, 0.0, (0,))]
    beside = lab.view(view.world.network, lab.L3, cars, poses=with_other(view, ahead_m, aside_m))
    assert (steps(unit, beside, 60).unit is None) is back


@pytest.mark.parametrize(
    ("lane", "ahead_m", "aside_m", "speed", "back"),
    [
        (1, 1.0, 2.1, 5.0, False),  # both bodies are 1.83 m wide: 0.27 m lie between them, less than two mirrors
        (1, 1.0, 2.3, 5.0, True),
        (1, -1.0, 2.1, 5.0, True),  # the driver itself is in front
        (1, 18.0, 2.1, 5.0, True),  # it can stop, and move aside, before
        (0, 8.0, 0.1, 5.0, True),  # SUMO follows who is ahead in the lane
        (1, 1.0, 2.1, 0.0, True),
    ],
)
def test_who_moves_is_not_handed_back_next_to_a_body_that_sumo_would_brake_for(
    lab, lane, ahead_m, aside_m, speed, back
):
    view = view_beside(lab, 0.0, speed=speed, turn=TURN)[0]
    cars = [lab.Car(2, 0, 100.0, speed, (0,)), lab.Car(3, lane, 100.0 + ahead_m, 0.0, (0,))]
    beside = lab.view(view.world.network, lab.L3, cars, poses=with_other(view, ahead_m, aside_m))
    assert (start_rejoin(HELD_UNIT, beside.ego(0)).unit is None) is back


def test_at_the_end_of_its_path_and_in_its_lane_a_vehicle_is_handed_back(lab):
    unit, _ = rejoining(lab)
    assert rejoin(unit, view_beside(lab, -NEAR_M + 0.02, speed=3.0, s=110.0)[0].ego(0)).unit is None
    beside, _, _ = view_beside(lab, -NEAR_M - 0.05, speed=3.0, s=110.0)
    assert rejoin(unit, beside.ego(0)).unit is not None
    at_end = replace(unit.navigator, progress_m=unit.navigator.path.length_m)
    assert rejoin(replace(unit, navigator=at_end), beside.ego(0)).unit is None
    laid_out = rejoin(replace(unit, navigator=NavigatorState()), beside.ego(0)).unit
    assert laid_out.navigator.path is not None, "who has waited at the line gets a path then"


@pytest.mark.parametrize(("left", "speed"), [(-0.8, 0.0), (0.9, 4.0), (-0.5, 9.0)])
def test_the_way_back_is_laid_out_for_the_mean_of_the_present_and_the_wanted_speed(lab, left, speed):
    view, _, _ = view_beside(lab, left, speed=speed)
    path = start_rejoin(HELD_UNIT, view.ego(0)).unit.navigator.path
    config = view.world.config.civilian_driver.pull_over
    expected = blend_length_m(
        left, 0.5 * (speed + 5.0), config.duration_s, LEAST_SIDEWAYS_M, view.ego(0).navigator_config
    )
    assert path.settled_m == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("spare", "left_at_end"), [(0.1, 0.0), (-0.1, -0.8)])
def test_the_middle_is_left_where_the_move_and_half_a_length_do_not_fit(lab, spare, left_at_end):
    """The way ends where the front is a metre before the end of the lane."""
    view, _, _ = view_beside(lab, -0.8)
    half = float(view.seen.half_length_m[0])
    merge = start_rejoin(HELD_UNIT, view.ego(0)).unit.navigator.path.settled_m
    length = 100.0 + merge + 2.0 * half + 1.0 + spare
    view, _, across = view_beside(lab, -0.8, np.radians(10.0), s=100.0, length=length)
    path = start_rejoin(HELD_UNIT, view.ego(0)).unit.navigator.path
    assert path.curve.points[-1] @ across == pytest.approx(left_at_end, abs=0.02)
    assert np.sin(path.curve.heading_rad[-1]) == pytest.approx(0.0, abs=0.08)


def over_the_line(lab, over_m, state, speed=0.0):
    """A vehicle at the lane's edge whose front is over the stop line at 150 m."""
    network = lab.junction_road()
    half = 0.5 * load_vehicle_parameters()[ActorClass.SEDAN].length_m
    car = lab.Car(2, 0, 100.0, speed, (0, 2))
    poses = np.array([[150.0 + over_m - half, -0.7, 0.0, speed]])
    traffic = replace(lab.traffic_of(network, [car], poses=poses), signals=(SignalState("J", state),))
    return lab.view_of(lab.world_of(network, lab.L3), traffic), 2.0 * half


@pytest.mark.parametrize("over_m", [0.2, 2.5, 4.3])
def test_who_stands_over_the_line_at_red_stays_there_until_green(lab, over_m):
    red, _ = over_the_line(lab, over_m, "r")
    outcome = start_rejoin(HELD_UNIT, red.ego(0))
    for _ in range(400):
        assert outcome.unit.phase is Mode.REJOIN
        assert (outcome.command, outcome.events) == (FULL_BRAKE, ())
        outcome = rejoin(outcome.unit, red.ego(0))
    moved = rejoin(outcome.unit, over_the_line(lab, over_m, "G")[0].ego(0))
    assert moved.unit is None or moved.command.throttle > 0.0, "on at green"


def test_only_who_is_over_the_line_at_red_waits_there(lab):
    for state in "Ggy":
        assert not is_over_red_line(over_the_line(lab, 2.0, state)[0].ego(0))
    across = {-0.2: False, 0.2: True, 24.8: True, 25.2: False}
    assert {over: is_over_red_line(over_the_line(lab, over, "r")[0].ego(0)) for over in across} == across
    moving = over_the_line(lab, 2.0, "r", speed=1.0)[0].ego(0)
    assert 0.0 < start_rejoin(HELD_UNIT, moving).command.brake < 0.5, "who moves brakes as people do"
    assert not is_over_red_line(view_beside(lab, -0.7)[0].ego(0)), "no line ahead"
