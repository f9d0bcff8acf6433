"""Limits of the EMV's speed."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import STRAIGHT, STRAIGHT_LEFT, crossing

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.numerics.braking import speed_before_mps
from siren_ros.simulation.behaviour.driving.driver_states import (
    ROUTE,
    Compliance,
    Driver,
    EmvUnit,
    LateralRequest,
    YieldUnit,
)
from siren_ros.simulation.behaviour.driving.navigator import SPEED_GAIN_1PS, NavigatorState, SpeedLimit
from siren_ros.simulation.behaviour.driving.speed_mechanisms import (
    LEAVING_MPS,
    MECHANISMS,
    SIDE_MARGIN_M,
    UNLIMITED,
    Drive,
    Mechanism,
    anticipated_limit,
    approach_limits,
    approach_speed_mps,
    entry_limit,
    free_way,
    navigate,
    passage_limit,
    riders_limit,
)
from siren_ros.simulation.behaviour.driving.tracked_path import Curve, TrackedPath
from siren_ros.simulation.behaviour.emv.controller import follow_route
from siren_ros.simulation.conflicts.course import Outlook
from siren_ros.simulation.conflicts.junction_approach import (
    LineBook,
    Lookout,
    Outlines,
    people_at,
    safe_mps,
    side_streets,
)
from siren_ros.simulation.scenario.driver_parameters import (
    AnticipationConfig,
    CivilianDriver,
    EmvDriver,
    JunctionEntryConfig,
)
from siren_ros.simulation.scenario.presets import Attention, TruncatedNormal
from siren_ros.simulation.world.actors import NO_ACTOR, ActorClass, Mode, SignalState


def scene(lab, *others, speed=5.0, corridor=True):
    view = lab.view(lab.straight_road(), lab.L3, [lab.Car(1, 0, 100, speed, (0,), ActorClass.AMBULANCE), *others])
    path = TrackedPath.of(Curve.through(np.array([[95.0, 0.0], [180.0, 0.0]])), view.ego(0).navigator_config)
    return EmvUnit(1, NavigatorState().following(path, 100.0, 0.0), corridor=corridor), view


@pytest.mark.parametrize(
    ("mode", "used"), [({}, "anticipation"), ({"corridor": True}, "passage"), ({"gap_escape_active": True}, "passage")]
)
def test_between_others_the_footprint_limits_the_speed_and_elsewhere_anticipation(lab, mode, used):
    """One of the two limits, and the other does not."""
    unit, view = scene(lab, lab.Car(2, 0, 120, 0, (0,)), corridor=False)
    drive = Drive(replace(unit, **mode), view.ego(0), unit.navigator.path, 100.0, 13.0, view.ego(0).navigator_config)
    limits = {mechanism.name: mechanism.limit(drive) for mechanism in MECHANISMS}
    assert [name for name in ("anticipation", "passage") if limits[name] != UNLIMITED] == [used]
    assert passage_limit(EmvUnit(1, corridor=True), view.ego(0)) == UNLIMITED, "without a path"


def people_limit(unit, view, left_m, *, row=0):
    """A crossing from 16 to 20 m ahead reaches 9 m to both sides; somebody is at its middle, or beside it."""
    ego, corners = view.ego(row), np.array([(116.0, -9.0), (120.0, -9.0), (120.0, 9.0), (116.0, 9.0)])
    outlines = Outlines(corners, np.array([0, 4]))
    place = np.array([118.0]), np.array([left_m]), np.zeros(1), np.zeros(1)
    world = replace(ego.world)
    vars(world)["crossings"] = outlines
    ego = replace(ego, world=world, seen=replace(ego.seen, people=people_at([7], place, outlines)))
    (people,) = (mechanism for mechanism in MECHANISMS if mechanism.name == "people")
    return people.limit(Drive(unit, ego, unit.navigator.path, 5.0, 13.0, ego.navigator_config))


@pytest.mark.parametrize(("beside_m", "limited"), [(1.5, True), (3.0, False)])
def test_people_on_a_crossing_beside_the_path_limit_the_speed(lab, beside_m, limited):
    unit, view = scene(lab, corridor=False)
    found = people_limit(unit, view, view.ego(0).half_width_m + beside_m)
    assert (found.blocker_id == 7, found.brake_mps2) == (limited, 0.0), "comfortable braking is enough"
    assert found.speed_mps == (pytest.approx(math.sqrt(1.6**2 + 4.0 * (found.free_m - 0.4))) if limited else math.inf)


@pytest.mark.parametrize(("emv", "pace_mps"), [(True, 30.0 / 3.6), (False, 1.6)])
def test_who_makes_way_passes_people_beside_a_crossing_at_walking_pace_and_the_emv_faster(lab, emv, pace_mps):
    """They may step on it; the path leads along the edge of the road, where the crossing begins."""
    path = TrackedPath.of(Curve.through(np.array([[95.0, 8.0], [180.0, 8.0]])), scene(lab)[1].ego(0).navigator_config)
    cars = [lab.Car(1, 0, 100, 5.0, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, 100, 5.0, (0,))]
    view = lab.view(lab.straight_road(), lab.L3, cars, poses=np.array(2 * [[100.0, 8.0, 0.0, 5.0]]))
    unit = EmvUnit(1, NavigatorState().following(path, 100.0, 0.0))
    found = people_limit(unit, view, 10.5, row=0 if emv else 1)
    assert found.blocker_id == 7
    assert found.speed_mps == pytest.approx(math.sqrt(pace_mps**2 + 4.0 * (found.free_m - 0.4)))


@pytest.mark.parametrize(
    ("kind", "speed_mps", "limited"),
    [(ActorClass.MOTORCYCLE, 0.0, True), (ActorClass.MOTORCYCLE, 2.0, False), (ActorClass.SEDAN, 0.0, False)],
)
def test_off_its_path_the_emv_stops_before_riders_who_stand(lab, kind, speed_mps, limited):
    """The path lies 1.5 m to the right of the EMV; what stands 1.2 m to its left is no leader on the path."""
    _, view = scene(lab, replace(lab.Car(2, 0, 106, speed_mps, (0,), kind), left=1.2), corridor=False)
    path = TrackedPath.of(Curve.through(np.array([[95.0, -1.5], [180.0, -1.5]])), view.ego(0).navigator_config)
    unit = EmvUnit(1, replace(NavigatorState().following(path, 100.0, 0.0), steered_1pm=0.0))
    limit = riders_limit(unit, view.ego(0))
    assert (limit.blocker_id == 2) is limited
    assert (limit.brake_mps2 > 2.0) is limited
    assert riders_limit(replace(unit, corridor=True), view.ego(0)) == UNLIMITED


@pytest.mark.parametrize(("strays_m", "stops"), [(0.4, False), (0.8, True), (-0.8, True)])
def test_the_farther_the_emv_is_off_its_path_the_more_it_keeps_from_riders(lab, strays_m, stops):
    """Half of it, at least 0.1 m; the rider stands 0.3 m beside it."""
    widths_m = sum(lab.vehicles[kind].width_m for kind in (ActorClass.AMBULANCE, ActorClass.MOTORCYCLE))
    car = replace(lab.Car(2, 0, 106, 0.0, (0,), ActorClass.MOTORCYCLE), left=0.5 * widths_m + 0.3)
    unit, view = scene(lab, car, corridor=False)
    unit = replace(unit, navigator=replace(unit.navigator, left_m=strays_m))
    assert (riders_limit(unit, view.ego(0)).blocker_id == 2) is stops


@pytest.mark.parametrize("turn", [2.2, -1.0])
@pytest.mark.parametrize(
    ("kind", "at_m", "left_m", "speed_mps", "emv_mps", "stops"),
    [
        *[(ActorClass.BICYCLE, 90.0, -1.9, 5.5, 2.0, True), (ActorClass.BICYCLE, 101.0, -1.9, 5.5, 2.0, True)],
        *[(ActorClass.BICYCLE, 90.0, -1.9, 1.5, 2.0, False), (ActorClass.BICYCLE, 80.0, -1.9, 5.5, 2.0, False)],
        *[(ActorClass.BICYCLE, 90.0, -1.9, 5.5, 5.0, False), (ActorClass.BICYCLE, 90.0, -0.1, 5.5, 2.0, False)],
        *[(ActorClass.SEDAN, 90.0, -1.9, 5.5, 2.0, False), (ActorClass.SEDAN, 90.0, -2.3, 5.5, 2.0, True)],
    ],
)
def test_between_queues_the_emv_moves_sideways_behind_whoever_comes_up_beside_it(
    lab, turn, kind, at_m, left_m, speed_mps, emv_mps, stops
):
    """The path leads 2 m to the right within 12 m, where the other one goes past on the right of the EMV."""
    unit, ego = moving_right(lab, kind, at_m, left_m, speed_mps, emv_mps, turn)
    limit = passage_limit(unit, ego)
    assert (limit.blocker_id == 2) is stops
    assert limit.speed_mps == (0.0 if stops else math.inf), "it waits for the other one to be past"


def moving_right(lab, kind, at_m, left_m, speed_mps, emv_mps, turn=0.0):
    cars = [lab.Car(1, 0, 100, emv_mps, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, at_m, speed_mps, (0,), kind)]
    network, along, across = lab.turned_road(turn)
    poses = [[*(100.0 * along), turn, emv_mps], [*(at_m * along + left_m * across), turn, speed_mps]]
    view = lab.view(network, lab.L3, cars, poses=np.array(poses))
    s_m = np.linspace(0.0, 80.0, 161)[:, None]
    points = (100.0 + s_m) * along - 2.0 * np.clip(s_m / 12.0, 0.0, 1.0) * across
    path = TrackedPath.of(Curve.through(points), view.ego(0).navigator_config)
    return replace(EmvUnit(1, NavigatorState().following(path, *(100.0 * along))), corridor=True), view.ego(0)


def test_whoever_is_beside_the_emv_and_no_faster_leaves_way_as_one_ahead_does(lab):
    rolls, stands = (
        free_way(*moving_right(lab, ActorClass.BICYCLE, 103.0, -1.9, mps, 2.0)).free_m for mps in (1.5, 0.0)
    )
    assert rolls - stands == pytest.approx(1.5**2 / 8.0)


@pytest.mark.parametrize(("gap_m", "stops"), [(0.05, True), (0.07, False)])
def test_in_a_gap_escape_the_emv_passes_bodies_by_more_than_it_strays_from_its_path(lab, gap_m, stops):
    """5 cm, at walking pace; a contact would stop it for good."""
    half_widths_m = 0.5 * (lab.vehicles[ActorClass.AMBULANCE].width_m + lab.vehicles[ActorClass.SEDAN].width_m)
    unit, view = scene(lab, replace(lab.Car(2, 0, 112, 0.0, (0,)), left=half_widths_m + gap_m))
    limit = passage_limit(replace(unit, gap_escape_active=True), view.ego(0))
    assert (limit.blocker_id == 2) is stops


def test_stops_before_a_vehicle_that_stands_on_the_path(lab):
    unit, view = scene(lab, lab.Car(2, 0, 120, 0, (0,)))
    bumpers = 20.0 - 0.5 * (lab.vehicles[ActorClass.AMBULANCE].length_m + lab.vehicles[ActorClass.SEDAN].length_m)
    assert free_way(unit, view.ego(0)).free_m == pytest.approx(bumpers, abs=0.6)
    limit = passage_limit(unit, view.ego(0))
    assert limit.blocker_id == 2
    free = limit.free_m - view.world.config.emv_driver.corridor.stop_short_m
    assert limit.speed_mps == pytest.approx(math.sqrt(2.0 * view.world.config.emv_driver.gap_escape.brake_mps2 * free))


def test_vehicles_ahead_that_move_leave_way_and_crossing_ones_count_only_in_the_gap_escape(lab, straight):
    standing, view = scene(lab, lab.Car(2, 0, 120, 0, (0,)))
    moving, moving_view = scene(lab, lab.Car(2, 0, 120, 6, (0,)))
    gain = free_way(moving, moving_view.ego(0)).free_m - free_way(standing, view.ego(0)).free_m
    assert gain == pytest.approx(6.0**2 / 8.0)
    cars = [lab.Car(1, 0, 100, 5, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, 115, 5, (0,))]
    poses = np.array([[100.0, 0.0, 0.0, 5.0], [115.0, -3.0, math.pi / 2.0, 5.0]])
    crossing = lab.view(straight, lab.L3, cars, poses=poses)
    assert math.isinf(free_way(standing, crossing.ego(0)).free_m)
    assert free_way(replace(standing, gap_escape_active=True), crossing.ego(0)).free_m < 12.0
    slowly = np.array([[100.0, 0.0, 0.0, 5.0], [115.0, 0.0, math.pi, 0.9]])
    bumpers = 15.0 - 0.5 * sum(lab.vehicles[kind].length_m for kind in (ActorClass.AMBULANCE, ActorClass.SEDAN))
    way = free_way(standing, lab.view(straight, lab.L3, cars, poses=slowly).ego(0))
    assert way.free_m == pytest.approx(bumpers - 0.8 * 0.9, abs=0.3), "who comes on slowly, in the time that is watched"


def approach_mps(ahead_m, config):
    return speed_before_mps(DRAWN_MPS**2, config.brake_mps2, ahead_m)


def test_the_vehicle_that_cannot_be_passed_is_the_blocker(lab):
    unit, view = scene(lab, lab.Car(2, 0, 110, 0, (0,)))
    ego = view.ego(0)
    assert passage_limit(unit, ego).blocker_id == 2

    def blocker(*limits):
        mechanisms = [Mechanism("", lambda _, limit=limit: limit, "") for limit in limits]
        return navigate(unit, ego, 5.0, ego.navigator_config, mechanisms)[2]

    passage, collision = passage_limit(unit, ego), SpeedLimit(9.0, blocker_id=7)
    assert blocker(SpeedLimit(9.0), passage) == 2
    assert blocker(collision, passage) == 7, "the collision handling comes first"
    assert blocker(SpeedLimit(9.0), UNLIMITED) == NO_ACTOR


CONFIG = AnticipationConfig()
HALF = 0.5 * (6.5 + 4.75)


def approach(gap, lead, overlap=2.0, leaving=0.0):
    return approach_speed_mps(gap, lead, overlap, leaving, *approach_limits(CONFIG))


def anticipated(lab, network, cars, poses):
    """The limit of the first of some cars, an EMV, at poses of x, y, yaw and speed."""
    ego = lab.view(network, lab.L2, cars, poses=np.array(poses)).ego(0)
    return anticipated_limit(follow_route(EmvUnit(1), ego)[0], ego).speed_mps


def scene_of_anticipation(lab, *others, speed=13.0):
    view = lab.view(lab.straight_road(), lab.L2, [lab.Car(1, 0, 100, speed, (0,), ActorClass.AMBULANCE), *others])
    return follow_route(EmvUnit(1), view.ego(0))[0], view.ego(0)


def test_stops_gently_behind_a_standing_vehicle():
    """With the headway's distance in hand, the speed is that of a stop at the constant gentle deceleration."""
    brake, headway, standstill = CONFIG.brake_mps2, CONFIG.headway_s, CONFIG.standstill_gap_m
    speed = 8.0
    gap = standstill + speed * headway + speed**2 / (2.0 * brake)
    assert (approach(gap, 0.0), approach(standstill, 0.0)) == (pytest.approx(speed), 0.0)
    assert approach(standstill + 7.0 * headway, 7.0) == pytest.approx(7.0), "at the same speed after the headway"


def test_a_vehicle_that_leaves_the_path_is_approached_so_as_to_arrive_when_it_has_left():
    staying, leaving = approach(26.0, 3.0), approach(26.0, 3.0, overlap=1.2, leaving=1.0)
    assert leaving == pytest.approx(3.0 + (26.0 - CONFIG.standstill_gap_m) / (1.2 / LEAVING_MPS))
    assert leaving > staying
    assert approach(26.0, 3.0, overlap=1.2, leaving=0.1) == staying
    assert approach(26.0, 3.0, overlap=9.0, leaving=1.0) == staying
    assert approach(26.0, 3.0, overlap=2.0, leaving=-1.0) == staying


def test_of_the_vehicles_on_the_path_in_the_same_direction_the_one_that_asks_for_least_counts(lab):
    """Whoever has which id; the path ends 3 m before the road's end at 400 m."""
    stands, rolls, aside, behind, beyond = (
        (30.0, 0, 0.0),
        (50.0, 0, 4.0),
        (20.0, 1, 0.0),
        (-30.0, 0, 0.0),
        (296.0, 0, 0.0),
    )

    def limit(*others):
        cars = [lab.Car(2 + n, lane, 100.0 + m, mps, (0,)) for n, (m, lane, mps) in enumerate(others)]
        return anticipated_limit(*scene_of_anticipation(lab, *cars, speed=5.0)).speed_mps

    gap = 30.0 - 0.5 * sum(lab.vehicles[kind].length_m for kind in (ActorClass.AMBULANCE, ActorClass.SEDAN))
    assert limit(stands) == pytest.approx(approach(gap, 0.0), rel=1e-4)
    assert limit(stands, rolls) == limit(rolls, stands) == limit(aside, stands, behind, rolls) == limit(stands)
    assert limit(aside, behind) == math.inf
    cars = [lab.Car(1, 0, 360, 5, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, 100.0 + beyond[0], 0, (0,))]
    ego = lab.view(lab.straight_road(), lab.L2, cars).ego(0)
    assert anticipated_limit(follow_route(EmvUnit(1), ego)[0], ego).speed_mps == math.inf


def test_slows_down_no_more_than_gently_and_leaves_braking_to_the_collision_handling(lab):
    unit, ego = scene_of_anticipation(lab, lab.Car(2, 0, 100 + HALF + 7.0, 0, (0,)))
    limit = anticipated_limit(unit, ego)
    gain = SPEED_GAIN_1PS
    assert (limit.speed_mps, limit.brake_mps2) == (pytest.approx(13.0 - CONFIG.ease_off_mps2 / gain), 0.0)


def test_adapts_to_the_lane_that_the_route_needs_before_it_can_change(lab):
    unit, ego = scene_of_anticipation(lab, lab.Car(2, 1, 100 + HALF + 20.0, 5, (0,)), speed=8.0)
    asked = replace(unit, request=LateralRequest(1, ROUTE, 0))
    for request in (LateralRequest(), LateralRequest(1, "intent", 0), LateralRequest(-1, ROUTE, 0)):
        assert math.isinf(anticipated_limit(replace(unit, request=request), ego).speed_mps)
    expected = max(approach(20.0, 5.0), 8.0 - CONFIG.ease_off_mps2 / SPEED_GAIN_1PS)
    assert anticipated_limit(asked, ego).speed_mps == pytest.approx(expected)


@pytest.mark.parametrize("turn", np.radians([0.0, 40.0, -110.0]))
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("turned", [0.0, 0.3, -0.3])
def test_a_vehicle_is_in_the_way_up_to_both_half_bodies_and_a_margin_aside(lab, turn, side, turned):
    network, along, across = lab.turned_road(turn, lanes=1)
    sedan, ambulance = lab.vehicles[ActorClass.SEDAN], lab.vehicles[ActorClass.AMBULANCE]
    side_m = 0.5 * (sedan.width_m * np.cos(turned) + sedan.length_m * abs(np.sin(turned)) + ambulance.width_m)
    cars = [lab.Car(1, 0, 100, 13, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, 130, 0, (0,))]
    for more, counts in ((-0.02, True), (0.02, False)):
        left = side * (side_m + SIDE_MARGIN_M + more)
        poses = [[*(100.0 * along), turn, 13.0], [*(130.0 * along + left * across), turn + turned, 0.0]]
        assert math.isfinite(anticipated(lab, network, cars, poses)) is counts


def test_the_gap_is_between_the_bumpers_also_of_a_vehicle_at_an_angle(lab, straight):
    """The speed is that of the formula, unless easing off is harder than the EMV does for anticipation alone."""
    sedan = lab.vehicles[ActorClass.SEDAN]
    cars = [lab.Car(1, 0, 100, 6, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, 130, 2, (0,))]
    for turned in (0.0, 0.3, -0.3):
        poses = [[100.0, 0.0, 0.0, 6.0], [130.0, 0.0, turned, 2.0]]
        reach = 0.5 * (sedan.length_m * np.cos(turned) + sedan.width_m * abs(np.sin(turned)))
        gap = 30.0 - reach - 0.5 * lab.vehicles[ActorClass.AMBULANCE].length_m
        expected = approach(gap, 2.0 * np.cos(turned))
        assert anticipated(lab, straight, cars, poses) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_turns_away_from_the_path_leaves_it_to_either_side(lab, straight, side):
    """A car that stands 0.5 m aside and points away leaves; one that points back to the path stays."""
    cars = [lab.Car(1, 0, 100, 3, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, 130, 3, (0,))]
    poses = {turned: [[100.0, 0.0, 0.0, 3.0], [130.0, 0.5 * side, side * turned, 3.0]] for turned in (0.3, -0.3)}
    speeds = {turned: anticipated(lab, straight, cars, placed) for turned, placed in poses.items()}
    sedan, ambulance = lab.vehicles[ActorClass.SEDAN], lab.vehicles[ActorClass.AMBULANCE]
    cos, sin = np.cos(0.3), np.sin(0.3)
    gap = 30.0 - 0.5 * (sedan.length_m * cos + sedan.width_m * sin) - 0.5 * ambulance.length_m
    inside = 0.5 * (sedan.length_m * sin + sedan.width_m * cos + ambulance.width_m) + SIDE_MARGIN_M
    for turned, leaving in ((0.3, 3.0 * sin), (-0.3, -3.0 * sin)):
        assert speeds[turned] == pytest.approx(approach(gap, 3.0 * cos, inside - 0.5, leaving), rel=1e-4)
    assert speeds[0.3] > speeds[-0.3] + 0.5


ENTRY = JunctionEntryConfig()
DRAWN_MPS = Attention().emv_line_mps.draw(random_stream(1, "emv at lines", 1))
"""Of the driver of actor 1 with the seed of these tests."""
HALF_EMV = 0.5 * 6.5


def limit(lab, network, front_m, state, speed=9.0, attention=None):
    cars = [lab.Car(1, 0, front_m - HALF_EMV, speed, (0, 2), ActorClass.AMBULANCE)]
    traffic = replace(lab.traffic_of(network, cars), signals=(SignalState("J", state),))
    world = lab.world_of(network, lab.L2)
    if attention is not None:
        world = replace(world, preset=replace(world.preset, attention=attention))
    return entry_limit(EmvUnit(1), lab.view_of(world, traffic).ego(0)).speed_mps


def test_comes_to_the_drivers_speed_at_the_line_by_constant_gentle_braking(lab):
    lines = lab.world_of(lab.junction_road(), lab.L2).lines
    connection = lab.junction_road().connections[0]
    way = np.linspace(0.0, 60.0, 25)
    energy = np.array([lines.approach_mps(1, 6.5, connection, ahead) for ahead in way]) ** 2
    assert energy[0] == pytest.approx(DRAWN_MPS**2)
    assert np.allclose(np.diff(energy) / np.diff(way), 2.0 * ENTRY.brake_mps2)


def test_lines_at_which_others_have_the_right_of_way_count(lab, junction):
    """Red, a stop sign and a give-way sign; neither green nor green that gives way to oncoming traffic."""
    expected = pytest.approx(approach_mps(30.0, ENTRY), abs=0.05)
    assert limit(lab, junction, 120.0, "r") == expected
    assert math.isinf(limit(lab, junction, 120.0, "G"))
    assert math.isinf(limit(lab, junction, 120.0, "g"))
    for sign in ({"must_stop": True}, {"gives_way": True}):
        signed = tuple(replace(movement, signal_id=None, **sign) for movement in junction.connections)
        assert limit(lab, replace(junction, connections=signed), 120.0, "G") == expected


@pytest.mark.parametrize("mean_mps", [4.0, 11.0])
def test_each_driver_has_an_own_speed_around_the_presets_mean(lab, mean_mps):
    speeds = TruncatedNormal(mean_mps, 0.5, mean_mps - 1.0, mean_mps + 1.0)
    world = lab.world_of(lab.junction_road(), lab.L2)
    world = replace(world, preset=replace(world.preset, attention=Attention(emv_line_mps=speeds)))
    drawn = [replace(world, seed=seed).lines.driver_mps(1) for seed in range(200)]
    assert np.mean(drawn) == pytest.approx(mean_mps, abs=0.1)
    assert np.std(drawn) == pytest.approx(0.44, abs=0.1)
    assert replace(world, seed=3).lines.driver_mps(1) == drawn[3] != replace(world, seed=3).lines.driver_mps(2)
    calibrated = LineBook(lab.junction_road(), JunctionEntryConfig(speed_mps=3.0), Attention(), 5)
    assert {calibrated.driver_mps(emv) for emv in range(5)} == {3.0}
    at_line = limit(lab, lab.junction_road(), 149.999, "r", speed=1.0, attention=Attention(emv_line_mps=speeds))
    assert at_line == pytest.approx(world.lines.driver_mps(1), abs=0.01)


def test_where_the_view_is_closed_the_emv_comes_more_slowly(lab):
    """A street from the right crosses 4 m behind the line; façades stand 3 m behind the roads."""
    road = lab.RoadBuilder().edge([[0, 0], [100, 0]], 1, ("W", "J"))
    road.edge([[100, 0], [110, 0]], 1, ("J", "J"), internal=True).edge([[110, 0], [300, 0]], 1, ("J", "E"))
    road.edge([[104, -100], [104, -6]], 1, ("S", "J"))
    road.edge([[104, -6], [104, 6]], 1, ("J", "J"), internal=True).edge([[104, 6], [104, 100]], 1, ("J", "N"))
    network = road.connect(0, 2, via=(1,)).connect(3, 5, via=(4,)).built()
    fast = Attention(emv_line_mps=TruncatedNormal(9.0, 0.0, 9.0, 9.0))
    lines = LineBook(network, ENTRY, fast, 1)
    connection = network.connections[0]
    (street,) = side_streets(network, connection)
    lookout = Lookout(8.0, 1.2, ENTRY.stop_mps2, ENTRY.reaction_s, ENTRY.standoff_m, 6.5)
    at = np.arange(0.0, 6.0, 0.5)
    slowest = int(np.argmin([safe_mps(street, before, lookout) for before in at]))
    view_mps = safe_mps(street, float(at[slowest]), lookout)
    assert view_mps < 5.0
    assert lines.approach_mps(1, 6.5, connection, float(at[slowest]) + 1e-6) == pytest.approx(view_mps, abs=1e-3)
    later = math.sqrt(view_mps**2 + 2.0 * ENTRY.brake_mps2 * 20.0)
    assert lines.approach_mps(1, 6.5, connection, float(at[slowest]) + 20.0) == pytest.approx(later, abs=0.1)
    assert lines.approach_mps(1, 6.5, connection, 0.1) == pytest.approx(9.0, abs=0.1)
    books = lines, LineBook(network, ENTRY, fast, 1)
    brief, alone = (book.approach_mps(1, 1.0, connection, float(at[slowest]) + 1e-6) for book in books)
    assert brief == alone > view_mps + 0.1, "a shorter EMV is away sooner"
    blind = replace(fast, emv_horizon_s=0.2)
    assert LineBook(network, ENTRY, blind, 1).approach_mps(1, 6.5, connection, 3.0) > 9.0


def test_the_emv_drives_so_and_enters_without_stopping(lab, junction, monkeypatch):
    monkeypatch.setattr(Outlook, "signals", {"J": "r"})
    loop = lab.Loop(lab.world_of(junction, lab.L1), [lab.Car(1, 0, 40.0, 13.0, (0, 2), ActorClass.AMBULANCE)]).run(300)
    front = np.array([row[1][0] for row in loop.log]) + HALF_EMV
    speed = np.array([row[1][3] for row in loop.log])
    line = int(np.searchsorted(front, 150.0))
    assert speed[line] == pytest.approx(DRAWN_MPS, abs=0.4)
    assert speed.min() > DRAWN_MPS - 0.5
    assert np.diff(speed[: line + 1]).min() / 0.05 > -1.6
    assert speed[-1] > 10.0


def test_a_light_that_turns_red_late_asks_for_gentle_braking_only(lab, junction):
    gain = SPEED_GAIN_1PS
    assert limit(lab, junction, 140.0, "r", speed=13.0) == pytest.approx(13.0 - ENTRY.ease_off_mps2 / gain)


@pytest.mark.parametrize(("front", "counts"), [(149.2, True), (149.9, True), (150.1, False)])
def test_a_red_light_counts_up_to_the_line(lab, front, counts):
    speed_limit = limit(lab, lab.junction_road(), front, "r", speed=4.0)
    assert math.isfinite(speed_limit) is counts
    if counts:
        assert speed_limit == pytest.approx(approach_mps(150.0 - front, ENTRY), abs=0.02)


@pytest.mark.parametrize(("front", "ahead"), [(70.0, 30.0), (125.0, 35.0)])
def test_of_two_red_lights_the_nearer_one_ahead_limits(lab, front, ahead):
    """Stop lines at 100 m and at 160 m."""
    road = lab.RoadBuilder()
    for begin, end in ((0, 100), (100, 120), (120, 160), (160, 180), (180, 400)):
        road.edge([[begin, 0], [end, 0]], 1, ("A", "B"), internal=begin in {100, 160})
    road.connect(0, 2, via=(1,), signal=True).connect(2, 4, via=(3,), signal=True)
    network = road.built()
    route = (0, 2, 4)[front > 100.0 :]
    cars = [lab.Car(1, route[0], front % 120.0 - HALF_EMV, 9.0, route, ActorClass.AMBULANCE)]
    traffic = replace(lab.traffic_of(network, cars), signals=(SignalState("J", "r"),))
    speed_limit = entry_limit(EmvUnit(1), lab.view_of(lab.world_of(network, lab.L2), traffic).ego(0)).speed_mps
    assert speed_limit == pytest.approx(approach_mps(ahead, ENTRY), abs=0.05)


CROSSED = crossing()
IN_LANE, OUT_LANE = (CROSSED.lane_by_id[name].index for name in ("s_in_1", "n_out_0"))
WAY = tuple(CROSSED.edge_by_id[name].index for name in ("s_in", "n_out"))


def before_full_exit(lab, rear_m, *others, corridor=False, front_m=80.0, speed=4.0, network=CROSSED):
    """The limit of an ambulance on green; its line is at 100 m, and a car's rear stands beyond the junction."""
    length_m = lab.vehicles[ActorClass.SEDAN].length_m
    cars = [
        lab.Car(1, IN_LANE, front_m - HALF_EMV, speed, WAY, ActorClass.AMBULANCE),
        lab.Car(2, OUT_LANE, rear_m + 0.5 * length_m, 0.0, WAY[1:]),
        *others,
    ]
    traffic = replace(lab.traffic_of(network, cars), signals=(SignalState("J", "G" * 7),))
    view = lab.view_of(lab.world_of(network, lab.L2), traffic)
    return entry_limit(EmvUnit(1, corridor=corridor), view.ego(0)).speed_mps


NEED_M = 2.0 * HALF_EMV + CONFIG.standstill_gap_m
"""Its 6.5 m and the gap of 6 m that it keeps."""


def test_the_emv_stops_before_a_junction_behind_which_there_is_no_room_for_it(lab):
    assert before_full_exit(lab, NEED_M + 0.1) == math.inf
    stop = before_full_exit(lab, NEED_M - 0.1)
    assert stop == pytest.approx(math.sqrt(2.0 * EmvDriver().driving.path_brake_mps2 * (20.0 - ENTRY.standoff_m)))
    assert before_full_exit(lab, NEED_M - 0.1, front_m=99.5, speed=0.0) == 0.0


@pytest.mark.parametrize("beyond", [False, True])
def test_those_who_move_ahead_of_it_need_room_as_well(lab, beyond):
    """A car that drives on the junction, or beyond it, takes its length and gap of what is left behind it."""
    straight, left = (CROSSED.connections[way].via[0] for way in (STRAIGHT, STRAIGHT_LEFT))
    moves = lab.Car(3, OUT_LANE, 3.0, 4.0, WAY[1:]) if beyond else lab.Car(3, straight, 10.0, 4.0, WAY)
    taken_m = lab.vehicles[ActorClass.SEDAN].length_m + CivilianDriver().driving.standstill_gap_m
    assert before_full_exit(lab, NEED_M + taken_m + 0.1, moves) == math.inf
    assert before_full_exit(lab, NEED_M + taken_m - 0.1, moves) < math.inf
    elsewhere = lab.Car(3, left, 10.0, 4.0, WAY)
    assert before_full_exit(lab, NEED_M + 0.1, elsewhere) == math.inf, "in the other lane"


def test_who_cannot_stop_or_drives_between_others_or_blocks_nobody_goes_on(lab):
    assert before_full_exit(lab, 1.0, front_m=98.0, speed=4.0) == math.inf
    assert before_full_exit(lab, 1.0, corridor=True) == math.inf
    alone = replace(CROSSED, connections=tuple(CROSSED.connections[way] for way in (STRAIGHT, STRAIGHT_LEFT)))
    assert before_full_exit(lab, 1.0) < math.inf
    assert before_full_exit(lab, 1.0, network=alone) == math.inf


@pytest.mark.parametrize(
    ("speed_mps", "far_m"), [(0.0, 80.0), (16.9, 80.0), (20.0, 400.0 / 3.6), (36.1, 36.1**2 / 3.6)]
)
def test_a_fast_emv_looks_as_far_ahead_as_it_takes_to_stop(lab, speed_mps, far_m):
    emv = lab.Car(1, 1, 20.0, speed_mps, (0,), ActorClass.AMBULANCE)
    assert lab.view(lab.straight_road(), lab.L1, [emv]).ego(0).far_m(80.0) == pytest.approx(far_m)


def beside_a_neighbour(lab, unit, other, kind):
    """The limit of a driver whose path leads to the left, where actor 1 or 2 is alongside."""
    cars = [lab.Car(3, 0, 100.0, 1.0, (0,), kind), lab.Car(other, 1, 101.0, 1.0, (0,), left=-0.5)]
    ego = lab.view(lab.straight_road(), lab.L3, cars).ego(1)
    points = np.array([[100.0 + s, 0.2 * s] for s in np.arange(0.0, 30.0, 0.5)])
    path = TrackedPath.of(Curve.through(points), ego.navigator_config)
    unit = replace(unit, navigator=NavigatorState().following(path, *ego.place))
    seen = replace(ego.seen, is_emv=ego.seen.actor_id != 2)
    drive = Drive(unit, replace(ego, seen=seen), path, 0.0, 5.0, ego.navigator_config)
    return next(item.limit(drive) for item in MECHANISMS if item.name == "manoeuvring")


@pytest.mark.parametrize(("change_side", "other", "limited"), [(1, 1, True), (0, 1, False), (1, 2, False)])
def test_in_a_lane_change_an_emv_minds_emvs_at_its_side_alone(lab, change_side, other, limited):
    """Civilians make way; an EMV that came up at its side, while the change stood half done, does not."""
    limit = beside_a_neighbour(lab, EmvUnit(3, change_side=change_side), other, ActorClass.AMBULANCE)
    assert limit.blocker_id == (1 if limited else NO_ACTOR)
    assert math.isfinite(limit.speed_mps) is limited


@pytest.mark.parametrize("other", [1, 2])
def test_a_civilian_minds_everybody_at_its_side_on_the_way_to_the_edge_to_a_hold_and_back(lab, other):
    driver = Driver(Compliance.COMPLIES, 0.0, 40.0)
    units = [YieldUnit(3, 1, driver, 0, phase=phase) for phase in Mode]
    limits = [beside_a_neighbour(lab, unit, other, ActorClass.SEDAN).blocker_id for unit in units]
    sideways = {Mode.YIELD_PULL_OVER, Mode.YIELD_HOLD, Mode.REJOIN}
    assert limits == [other if phase in sideways else NO_ACTOR for phase in Mode]
