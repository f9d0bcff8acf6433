"""The guards of the EMV's algorithm, one by one, without SUMO; the first of them is the gap escape."""

from dataclasses import replace

import numpy as np
import pytest
from behaviour.lab import kinds, stepper
from synthetic_episode import rotate

from siren_ros.simulation.behaviour.driving.driver_states import EmvUnit, RoutePlan
from siren_ros.simulation.behaviour.driving.lane_path import path_on_lanes
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState
from siren_ros.simulation.behaviour.driving.speed_mechanisms import ESCAPE_HORIZON_M
from siren_ros.simulation.behaviour.driving.tracked_path import LaneEnd, on_reference
from siren_ros.simulation.behaviour.emv import controller
from siren_ros.simulation.behaviour.emv.controller import OFF_PATH_M, EmvState, mode_of, step_emv, target_speed_mps
from siren_ros.simulation.behaviour.emv.escape_search import STATION_M
from siren_ros.simulation.scenario.presets import Attention, load_preset
from siren_ros.simulation.world.actors import ActorClass, Lights, Mode, Owner

AMBULANCE = ActorClass.AMBULANCE
steps = stepper(step_emv, EmvState())


@pytest.fixture
def emv(lab):
    return lab.Car(1, 0, 50, 10, (0,), AMBULANCE)


def test_at_l0_sumo_drives(lab, emv):
    _, commands, events = steps(lab.world_of(lab.straight_road(), lab.L0), [emv])
    assert len(commands) == 0
    assert not events


@pytest.mark.parametrize(("level", "lights"), [("L1", 0), ("L2", 24), ("L3", 24)])
def test_ros_drives_with_the_levels_cue(lab, emv, level, lights):
    _, commands, events = steps(lab.world_of(lab.straight_road(), getattr(lab, level)), [emv])
    assert (commands.source, commands.actor_id.tolist()) == ("emv_controller", [1])
    assert (commands.owner.tolist(), commands.mode.tolist()) == ([Owner.ROS], [Mode.ROUTE_FOLLOW])
    assert commands.lights.tolist() == [lights]
    assert not events
    assert commands.throttle[0] > 0.0


def test_target_speeds_by_priority(lab):
    view = lab.view(lab.straight_road(), lab.L3, [lab.Car(1, 0, 60, 5, (0,))])
    cases = {
        Mode.ROUTE_FOLLOW: EmvUnit(1),
        Mode.FORCED_LANE_CHANGE: EmvUnit(1, change_side=1),
        Mode.COPY_SUMO: EmvUnit(1, change_side=1, corridor=True),
        Mode.GAP_ESCAPE: EmvUnit(1, change_side=1, corridor=True, gap_escape_active=True, escape_offset_m=1.0),
    }
    speeds = {mode: target_speed_mps(unit, view) * 3.6 for mode, unit in cases.items()}
    assert all(mode_of(unit) is mode for mode, unit in cases.items())
    assert list(speeds.values()) == pytest.approx([50.0, 50.0, 30.0, 20.0])
    assert target_speed_mps(EmvUnit(1, gap_escape_active=True), view) == 0.0


@pytest.mark.parametrize("level", ["L1", "L2"])
def test_a_feasible_intent_is_executed_whatever_it_gains_and_whoever_is_ahead(lab, emv, level):
    world = lab.world_of(lab.straight_road(), getattr(lab, level))
    for cars in ([emv], [emv, lab.Car(2, 0, 80, 2, (0,))]):
        _, _, events = steps(world, cars, 2, advice={"lane_change_intent": 1}, flags=lab.RESCUE)
        assert kinds(events) == ["lane_change_requested", "lane_change_started"]


def test_infeasible_intent_is_reconsidered_and_dropped_after_a_while(lab, emv):
    cars = [emv, lab.Car(2, 0, 80, 2, (0,)), lab.Car(3, 1, 48, 10, (0,))]
    world = lab.world_of(lab.straight_road(), lab.L1)
    state, _, events = steps(world, cars, 3, advice={"lane_change_intent": 1})
    assert kinds(events) == ["lane_change_requested", "lane_change_deferred"]
    freed, _, started = steps(world, cars[:2], 1, state, 3, advice={"lane_change_intent": 1})
    assert kinds(started) == ["lane_change_started"]
    assert freed.units[1].lane_change_forced
    assert kinds(steps(world, cars, 30, state, 3)[2]) == ["lane_change_cancelled"]


def test_the_pause_after_which_an_intent_is_dropped_begins_again_with_each_intent(lab, emv):
    cars = [emv, lab.Car(2, 0, 80, 2, (0,)), lab.Car(3, 1, 48, 10, (0,))]
    world = lab.world_of(lab.straight_road(), lab.L1)
    left = {"lane_change_intent": 1}
    state, _, _ = steps(world, cars, 3, advice=left)
    state, _, none = steps(world, cars, 19, state, 3)
    state, _, again = steps(world, cars, 1, state, 22, advice=left)
    state, _, more = steps(world, cars, 19, state, 23)
    assert not (*none, *again, *more)
    _, _, dropped = steps(world, cars, 1, state, 42)
    assert [(event.kind.value, event.detail["reason"]) for event in dropped] == [
        ("lane_change_cancelled", "intent_gone")
    ]


def test_an_intent_to_the_other_side_replaces_the_first(lab):
    network = lab.straight_road(3)
    cars = [lab.Car(1, 1, 50, 10, (0,), AMBULANCE)]
    cars += [lab.Car(2 + side, lane, 48, 10, (0,)) for side, lane in ((1, 0), (2, 2))]
    world = lab.world_of(network, lab.L1)
    state, commands, _ = steps(world, cars, 3, advice={"lane_change_intent": 1})
    _, _, events = steps(world, cars, 1, state, 3, advice={"lane_change_intent": -1})
    assert kinds(events) == ["lane_change_cancelled", "lane_change_requested", "lane_change_deferred"]
    assert [event.detail["side"] for event in events] == [1, -1, -1]
    assert events[0].detail["reason"] == "intent_changed"
    assert commands.lights[0] & (Lights.INDICATOR_LEFT | Lights.INDICATOR_RIGHT) == 0


@pytest.mark.parametrize("turn", [Lights.INDICATOR_LEFT, Lights.INDICATOR_RIGHT, Lights.NONE])
def test_it_indicates_the_turn_that_comes_next_unless_it_changes_lanes(lab, emv, turn):
    world, sumo = lab.world_of(lab.straight_road(), lab.L1), {1: int(turn | Lights.BRAKE)}
    state, commands, _ = steps(world, [emv], lights=sumo)
    assert commands.lights.tolist() == [turn]
    _, commands, _ = steps(world, [emv], 2, state, 1, advice={"lane_change_intent": 1}, lights=sumo)
    assert commands.lights.tolist() == [Lights.INDICATOR_LEFT]


@pytest.mark.parametrize(("side", "light"), [(1, Lights.INDICATOR_LEFT), (-1, Lights.INDICATOR_RIGHT)])
def test_a_lane_change_shows_its_side_and_ends_inside_the_lane(lab, side, light):
    world = lab.world_of(lab.straight_road(3), lab.L1)
    car = lab.Car(1, 1, 50, 10, (0,), AMBULANCE)
    state, commands, events = steps(world, [car], 2, advice={"lane_change_intent": side})
    assert kinds(events) == ["lane_change_requested", "lane_change_started"]
    assert commands.lights[0] & (Lights.INDICATOR_LEFT | Lights.INDICATOR_RIGHT) == light
    width = 3.3 / 2.0 - 2.1 / 2.0 + 0.15
    for left, done in ((3.3 * side - (width + 0.05) * side, False), (3.3 * side - (width - 0.05) * side, True)):
        _, commands, events = steps(world, [lab.Car(1, 1, 80, 10, (0,), AMBULANCE, left=left)], 1, state, 2)
        assert kinds(events) == (["lane_change_completed"] if done else [])
        assert bool(commands.mode[0] == Mode.ROUTE_FOLLOW) is done
        assert bool(commands.lights[0] & light == 0) is done


def test_cooldown_between_forced_lane_changes(lab, emv):
    world = lab.world_of(lab.straight_road(), lab.L1)
    cars = [emv, lab.Car(2, 0, 80, 2, (0,))]
    before = EmvUnit(1, change_step=100)
    warm, _, _ = steps(world, cars)
    state = EmvState({1: replace(before, navigator=warm.units[1].navigator, plan=warm.units[1].plan)}, warm.actors)
    later, _, events = steps(world, cars, 38, state, 101, advice={"lane_change_intent": 1})
    assert kinds(events) == ["lane_change_requested"]
    _, _, events = steps(world, cars, 2, later, 139, advice={"lane_change_intent": 1})
    assert (kinds(events), events[0].step) == (["lane_change_started"], 140)


@pytest.mark.parametrize("speed", [0.0, 8.0])
def test_a_lane_change_that_the_route_needs_may_end_on_the_junction(lab, speed):
    """Otherwise the EMV would stand for ever at the end of a lane that is too short for the change."""
    world = lab.world_of(lab.junction_road(), lab.L1)
    state, _, events = steps(world, [lab.Car(1, 1, 145, speed, (0, 4), AMBULANCE)], 3)
    assert kinds(events) == ["lane_change_requested", "lane_change_started"]
    assert state.units[1].plan.edges[-1] == 4
    assert state.units[1].navigator.path.curve.points[-1, 1] < -10.0


def test_the_emv_leaves_the_presets_time_behind_those_who_cross_and_looks_out_as_far_ahead_as_it_says(lab):
    world = lab.world_of(lab.junction_road(), lab.L1)
    for name, least_s, most_s in (("paper", 1.0, 2.0), ("realistic", 1.0, 2.0), ("reckless", 0.0, 0.9)):
        conflicts = replace(world, preset=load_preset(name)).emv_navigator.conflicts
        assert least_s < conflicts.after_s < most_s
    short = replace(world, preset=replace(world.preset, attention=Attention(emv_horizon_s=1.0)))
    crossing = lab.Car(5, len(world.network.lanes) - 1, 80, 8, (5,))
    cars = [lab.Car(1, 0, 125, 12, (0, 2), AMBULANCE), crossing]
    assert [steps(seen, cars)[1].brake[0] > 0.0 for seen in (world, short)] == [True, False]


def test_path_reaches_through_the_junction_and_stays_the_same_while_it_serves(lab):
    world = lab.world_of(lab.junction_road(), lab.L1)
    emv = lab.Car(1, 0, 60, 10, (0, 2), AMBULANCE)
    state, _, _ = steps(world, [emv])
    path = state.units[1].navigator.path
    assert path.curve.points[-1, 0] > 150.0
    assert steps(world, [emv], 10, state, 1)[0].units[1].navigator.path is path


@pytest.mark.parametrize(
    ("others", "lane"),
    [([], 0), ([(45.0, 12.0)], 1), ([(62.0, 0.0)], 1), ([(53.0, 0.0)], 0), ([(75.0, 10.0)], 0)],
    ids=["free", "comes", "beside", "stands behind", "ahead"],
)
def test_after_an_escape_the_emv_stays_in_its_lane_while_others_are_in_the_way_back(lab, others, lane):
    """It has come past in the left lane; the path of the escape belongs to the right one."""
    cars = [lab.Car(number, 0, s, mps, (0,)) for number, (s, mps) in enumerate(others, 2)]
    view = lab.view(lab.straight_road(), lab.L1, [lab.Car(1, 1, 62, 5, (0,), AMBULANCE), *cars])
    ego = view.ego(0)
    reference = path_on_lanes(view.world.network, (0,), LaneEnd.HORIZON, 0.0, 200.0)
    path = on_reference(reference, ego.navigator_config, stop_at_end=False, shorten_m=0.0)
    escaped = EmvUnit(1, navigator=NavigatorState().following(path, *ego.place))
    assert controller.follow_route(escaped, ego)[0].navigator.lane == lane


def test_removed_emv_is_forgotten(lab, emv):
    world = lab.world_of(lab.straight_road(), lab.L2)
    state, _, _ = steps(world, [emv, lab.Car(2, 0, 90, 5, (0,))])
    gone = replace(
        lab.traffic_of(world.network, [lab.Car(2, 0, 90, 5, (0,))], step=1, spawn=False),
        removed=np.array([1], dtype=np.uint32),
    )
    state, commands = step_emv(state, gone, world)
    assert not state.units
    assert len(commands) == 0


def test_two_emvs_have_a_row_each(lab, emv):
    second = lab.Car(7, 1, 20, 10, (0,), ActorClass.FIRE_TRUCK)
    assert steps(lab.world_of(lab.straight_road(), lab.L2), [emv, second])[1].actor_id.tolist() == [1, 7]


def test_plans_anew_when_the_route_changes(lab):
    world = lab.world_of(lab.junction_road(), lab.L1)
    state, _, _ = steps(world, [lab.Car(1, 0, 60, 10, (0, 2), AMBULANCE)], 30)
    before = state.units[1].navigator.path
    state, _, _ = steps(world, [lab.Car(1, 0, 60, 10, (0, 4), AMBULANCE)], 1, state, 30)
    after = state.units[1].navigator.path
    assert after is not before
    assert after.curve.points[-1, 1] < -10.0


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("more_m", "anew"), [(-0.05, False), (0.05, True)])
def test_plans_anew_where_it_has_come_off_its_path_to_either_side(lab, emv, side, more_m, anew):
    world = lab.world_of(lab.straight_road(), lab.L1)
    unit = steps(world, [emv], 1)[0].units[1]
    off = replace(unit, navigator=replace(unit.navigator, left_m=side * (OFF_PATH_M + more_m)))
    for step, planned in ((19, False), (20, anew)):
        after, _ = controller.follow_route(off, lab.view_in(world, [emv], step=step).ego(0))
        assert (after.navigator.path is not unit.navigator.path) is planned


def lines_of(space):
    return space.right_m, space.driving_right_m, space.left_m, space.opposite_left_m, space.middle_m


def test_edges_are_those_of_the_shoulder_the_driving_lanes_and_the_opposite_ones(lab):
    road = lab.RoadBuilder().edge([[0, 0], [100, 0]], 3, ("A", "B"), shoulder=True)
    road.edge([[100, 16.5], [0, 16.5]], 2, ("B", "A"))
    network = road.built()
    for lane, shift in ((1, 0.0), (2, -3.3)):
        reference = path_on_lanes(network, (lane,), LaneEnd.HORIZON, 10.0, 50.0)
        lines = lines_of(controller.road_space(network, reference, np.array([0.0, 20.0])))
        expected = np.array([-1.65 - 3.3, -1.65, 4.95, 4.95 + 6.6, 1.65]) + shift
        for line, value in zip(lines, expected, strict=True):
            assert line.tolist() == pytest.approx([value, value])


def test_a_road_that_widens_beyond_a_junction_is_bridged_evenly(lab):
    """One lane, 20 m of a junction, two lanes: the left edge goes from 1.65 m to 4.95 m."""
    road = lab.RoadBuilder().edge([[0, 0], [100, 0]], 1, ("A", "J"))
    road.edge([[100, 0], [120, 0]], 1, ("J", "J"), internal=True)
    road.edge([[120, 0], [200, 0]], 2, ("J", "B"))
    road.connect(0, 2, via=(1,))
    network = road.built()
    reference = path_on_lanes(network, (0, 1, 2), LaneEnd.HORIZON, 90.0, 60.0)
    space = controller.road_space(network, reference, np.array([5.0, 9.0, 20.0, 31.0, 35.0]))
    assert space.left_m.tolist() == pytest.approx([1.65, 1.65, 3.3, 4.95, 4.95])
    assert space.right_m.tolist() == pytest.approx([-1.65] * 5)
    assert space.middle_m.tolist() == pytest.approx([0.0, 0.0, 0.825, 1.65, 1.65])


def test_on_a_junction_alone_there_is_space_of_three_lanes(junction):
    reference = path_on_lanes(junction, (2,), LaneEnd.HORIZON, 2.0, 20.0)
    space = controller.road_space(junction, reference, np.array([0.0, 10.0]))
    for line, widths in zip(lines_of(space), (-1.5, -1.5, 1.5, 1.5, 0.0), strict=True):
        assert line.tolist() == pytest.approx([3.3 * widths] * 2)


def start_of(lab, monkeypatch, *, turn=0.0, left=0.0, turned=0.0, s=100.0, length=400.0):
    """What a search is asked: the vehicle against the line, and the stations."""
    asked = []

    def noted(curve, road, start, obstacles, config):
        asked.append((curve, road, start, obstacles, config))

    monkeypatch.setattr(controller, "search_lattice", noted)
    network, along, across = lab.turned_road(turn, length=length)
    poses = np.array([[*(s * along + left * across), turn + turned, 0.0]])
    view = lab.view(network, lab.L3, [lab.Car(1, 0, s, 0, (0,), AMBULANCE)], poses=poses)
    reference = controller.reference_line(view.ego(0), 0)
    assert controller.search_gap(reference, view.ego(0)) is None
    return asked, reference, along


@pytest.mark.parametrize("turn", np.radians([35.0, -100.0]))
@pytest.mark.parametrize(("left", "turned"), [(0.4, 0.2), (-0.5, -0.15), (0.0, 1.2)])
def test_the_search_begins_at_the_rear_axle_as_the_vehicle_points(lab, monkeypatch, turn, left, turned):
    asked, reference, along = start_of(lab, monkeypatch, turn=turn, left=left, turned=turned)
    ((curve, road, start, *_),) = asked
    vehicle = lab.vehicles[AMBULANCE]
    rear = vehicle.centre_ahead_of_rear_axle_m
    assert curve is reference.curve
    assert start.centre_ahead_m == rear
    assert start.left_m == pytest.approx(left - rear * np.sin(turned), abs=1e-6)
    assert start.slope == pytest.approx(np.tan(min(turned, 0.7)))
    assert (start.body.half_length_m, start.body.half_width_m) == (0.5 * vehicle.length_m, 0.5 * vehicle.width_m)
    assert start.wheelbase_m == vehicle.wheelbase_m
    assert start.sharpest_1pm == pytest.approx(np.tan(0.85 * vehicle.max_steer_rad) / vehicle.wheelbase_m)
    rear_axle = curve.at(road.s_m[:1])[0]
    assert rear_axle @ along == pytest.approx(100.0 - rear * np.cos(turned), abs=1e-6)
    assert np.diff(road.s_m) == pytest.approx(STATION_M)
    assert road.s_m[-1] - road.s_m[0] == pytest.approx(ESCAPE_HORIZON_M)


@pytest.mark.parametrize(("beyond_m", "stations"), [(20.0, 14), (2.9, 0), (3.1, 3)])
def test_stations_end_where_the_front_is_at_the_lines_end(lab, monkeypatch, beyond_m, stations):
    """One each 1.5 m while the front, which is half a length and the rear axle's distance ahead, is on the line."""
    half = 0.5 * lab.vehicles[AMBULANCE].length_m
    asked, *_ = start_of(lab, monkeypatch, s=100.0, length=100.0 + half + beyond_m)
    assert [len(road.s_m) for _, road, *_ in asked] == ([stations] if stations else [])


def test_others_are_swept_for_as_long_as_they_may_go_and_longer_where_they_come_on(lab, monkeypatch):
    asked = []
    monkeypatch.setattr(controller, "search_lattice", lambda *what: asked.append(what))
    cars = [lab.Car(1, 0, 100, 0, (0,), AMBULANCE), lab.Car(2, 0, 120, 4, (0,)), lab.Car(3, 1, 130, 4, (0,))]
    poses = np.array([[100.0, 0.0, 0.0, 0.0], [120.0, 0.0, 0.1, 4.0], [130.0, 3.3, np.pi, 4.0]])
    turn = 2.2  # of the whole scene
    poses = np.column_stack((rotate(poses[:, :2], turn), poses[:, 2] + turn, poses[:, 3]))
    view = lab.view(lab.turned_road(turn)[0], lab.L3, cars, poses=poses)
    controller.search_gap(controller.reference_line(view.ego(0), 0), view.ego(0))
    obstacles, half = asked[0][3], 0.5 * lab.vehicles[ActorClass.SEDAN].length_m
    assert obstacles.actor_id.tolist() == [2, 3]
    ways = np.array([4.0 * 1.5, 4.0 * 6.5])
    assert obstacles.half_length_m == pytest.approx(half + 0.5 * ways)
    ahead_m = rotate(np.stack((obstacles.x_m, obstacles.y_m), axis=-1), -turn)[:, 0]
    assert ahead_m == pytest.approx([120.0 + 0.5 * ways[0] * np.cos(0.1), 130.0 - 0.5 * ways[1]])


def view_at(lab, speed=0.0, others=(), network=None, advice=None, lane=0, step=0):
    network = network or lab.straight_road()
    cars = [lab.Car(1, lane, 100, speed, (0,), ActorClass.AMBULANCE), *others]
    return lab.view(network, lab.L3, cars, step, advice=advice)


def run(unit, view, count):
    events = []
    for _ in range(count):
        unit, happened = controller.gap_escape_mode(unit, view.ego(0))
        events += happened
    return unit, events


def test_entered_after_three_seconds_stopped_behind_a_blocker(lab):
    view = view_at(lab, speed=0.5)
    unit, events = run(EmvUnit(1, blocker_id=2), view, 59)
    assert not unit.gap_escape_active
    assert not events
    unit, events = run(unit, view, 1)
    assert unit.gap_escape_active
    assert (kinds(events), events[0].other_id) == (["gap_escape_entered"], 2)
    assert not run(EmvUnit(1), view_at(lab), 200)[0].gap_escape_active, "nobody blocks"


def test_stop_timer_starts_again_after_moving(lab):
    unit, _ = run(EmvUnit(1, blocker_id=2), view_at(lab), 50)
    unit, _ = run(unit, view_at(lab, speed=0.51), 1)
    assert unit.stopped_s == 0.0
    unit, events = run(unit, view_at(lab), 59)
    assert not unit.gap_escape_active
    assert not events


def test_the_gap_escape_comes_before_the_corridor_and_begins_at_l3_alone(lab):
    """The EMV has stood behind a vehicle for three seconds as others begin to form a rescue lane."""
    cars = [lab.Car(1, 0, 100, 0, (0,), AMBULANCE), lab.Car(2, 0, 108, 0, (0,))]
    stands = {"leader_id": 2, "leader_gap_m": 2.4}
    for level, expected in (("L2", []), ("L3", ["gap_escape_entered", "corridor_entered"])):
        world = lab.world_of(lab.straight_road(1), getattr(lab, level))
        state, _, _ = steps(world, cars, 59, advice=stands)
        _, _, events = steps(world, cars, 1, state, 59, advice={**stands, "rescue_count": 1})
        assert kinds(events)[:2] == expected


def test_the_time_without_a_blocker_begins_again_with_each_blocker(lab):
    unit, _ = run(EmvUnit(1, gap_escape_active=True), view_at(lab), 39)
    unit, events = run(replace(unit, blocker_id=2), view_at(lab), 1)
    assert unit.blocker_free_s == 0.0
    unit, more = run(replace(unit, blocker_id=0), view_at(lab), 39)
    assert not events
    assert not more
    assert kinds(run(unit, view_at(lab), 1)[1]) == ["gap_escape_left"]


def test_preempts_a_forced_lane_change(lab):
    unit, events = run(EmvUnit(1, blocker_id=2, change_side=1, stopped_s=5.0), view_at(lab), 1)
    assert unit.gap_escape_active
    assert not unit.lane_change_forced
    assert kinds(events) == ["lane_change_cancelled", "gap_escape_entered"]


def test_without_a_corridor_only_a_lane_change_that_stands_still_leads_to_it(lab):
    """An EMV that stands too close behind a vehicle for a lane change would stand there for ever."""

    def after(unit, count):
        for _ in range(count):
            unit, _ = controller.lane_change_stuck(unit, view_at(lab).ego(0))
        return unit

    assert not after(EmvUnit(1, blocker_id=2), 200).gap_escape_active
    changing = EmvUnit(1, blocker_id=2, change_side=1)
    assert not after(changing, 59).gap_escape_active
    escaping = after(changing, 60)
    assert escaping.gap_escape_active
    assert not escaping.lane_change_forced
    assert not after(replace(escaping, blocker_id=0), 40).gap_escape_active
    assert after(replace(changing, change_side=0, stopped_s=2.0), 1).stopped_s == 0.0


@pytest.mark.parametrize(("gap", "speed", "blocks"), [(79.0, 0.0, True), (81.0, 0.0, False), (30.0, 8.0, False)])
def test_sumos_leader_blocks_within_the_query_range_unless_it_drives_away(lab, gap, speed, blocks):
    view = view_at(lab, others=[lab.Car(9, 0, 130, speed, (0,))], advice={"leader_id": 9, "leader_gap_m": gap})
    assert (controller.blocker_of(EmvUnit(1), view.ego(0)) == 9) is blocks


def in_both_lanes(lab, centre_m=108.0):
    return [lab.Car(2 + lane, lane, centre_m, 0, (0,)) for lane in (0, 1)]


def reference_of(view, lane):
    return path_on_lanes(view.world.network, (lane,), LaneEnd.HORIZON, 95.0, 60.0)


@pytest.mark.parametrize(("speed", "right_m", "blocks"), [(3.0, 2.3, False), (3.0, 1.5, True), (0.0, 2.3, True)])
def test_a_leader_that_an_emv_under_way_would_pass_beside_blocks_no_more(lab, speed, right_m, blocks):
    others = [lab.Car(2, 0, 110, 0.0, (0,), left=-right_m)]
    view = view_at(lab, speed, others, advice={"leader_id": 2, "leader_gap_m": 5.0})
    assert (controller.blocker_of(EmvUnit(1, gap_escape_active=True), view.ego(0)) == 2) is blocks


def test_waits_says_so_once_and_escapes_when_a_gap_opens(lab):
    never = lab.world_of(lab.straight_road(), lab.L3, preset=load_preset("paper").for_scenario(40.0, 0.0, 0.0))
    cars = [lab.Car(2 + lane, lane, 80, 0, (0,), desired=0) for lane in (0, 1)]
    cars.insert(0, lab.Car(1, 0, 60, 5, (0,), AMBULANCE))
    loop = lab.Loop(never, cars).run(200)
    assert len(loop.of("gap_escape_entered")) == len(loop.of("gap_escape_waiting")) == 1
    assert loop.body.forward_mps[0] < 0.05
    loop.cars[2].desired = 4.0
    loop.run(300)
    assert len(loop.of("gap_escape_left")) == 1
    assert loop.body.x_m[0] > 95.0
    fast = max(row[1][3] for row in loop.log if row[1][5] == 4)
    assert fast * 3.6 < 21.0
    assert not loop.touching()


def test_a_free_path_is_kept_and_a_blocked_one_replaced(lab):
    active = EmvUnit(1, gap_escape_active=True)
    behind = [lab.Car(2, 0, 114, 0, (0,))]
    view = view_at(lab, others=behind)
    first, events = controller.escape_path(active, view.ego(0))
    assert kinds(events) == ["gap_escape_replanned"]
    assert first.escape_offset_m > 1.9
    again = replace(first, escape_planned_step=-20)
    kept, events = controller.escape_path(again, view.ego(0))
    assert kept.navigator.path is first.navigator.path
    assert not events
    other, _ = controller.escape_path(again, view_at(lab, others=[*behind, lab.Car(3, 1, 126, 0, (0,))]).ego(0))
    assert other.navigator.path is not first.navigator.path


def test_waits_where_the_path_ends_and_no_other_is_found(lab):
    both = in_both_lanes(lab)
    view = view_at(lab, others=both)
    unit, events = controller.escape_path(EmvUnit(1, gap_escape_active=True), view.ego(0))
    assert unit.escape_offset_m is None
    assert kinds(events) == ["gap_escape_waiting"]
    assert controller.escape_speed_mps(unit, view) == 0.0
    _, events = controller.escape_path(unit, view_at(lab, others=both, step=20).ego(0))
    assert not events


@pytest.mark.parametrize(("clearance", "speed_mps"), [(0.3, 20.0 / 3.6), (0.15, 1.8), (0.08, 0.8)])
def test_tight_paths_are_driven_slowly(lab, clearance, speed_mps):
    unit = EmvUnit(1, gap_escape_active=True, escape_offset_m=0.0, escape_clearance_m=clearance)
    assert controller.escape_speed_mps(unit, view_at(lab)) == pytest.approx(speed_mps)


def driving_around(lab, step=0):
    """An EMV that has just found its way around a blocker, and its view."""
    view = view_at(lab, others=[lab.Car(2, 0, 114, 0, (0,))], step=step)
    return controller.escape_path(EmvUnit(1, gap_escape_active=True), view.ego(0))[0], view


def test_a_path_is_looked_at_again_after_half_a_second(lab):
    unit, _ = driving_around(lab)
    closed = [lab.Car(2, 0, 114, 0, (0,)), lab.Car(3, 1, 126, 0, (0,))]
    assert controller.escape_path(unit, view_at(lab, others=closed, step=9).ego(0)) == (unit, ())
    again, _ = controller.escape_path(unit, view_at(lab, others=closed, step=10).ego(0))
    assert again.escape_planned_step == 10
    assert again.navigator.path is not unit.navigator.path


@pytest.mark.parametrize(
    ("moved_m", "recorded"), [(0.0, False), (0.4, False), (-0.4, False), (0.6, True), (-0.6, True)]
)
def test_another_path_is_told_where_it_ends_half_a_metre_beside_the_last_one(lab, moved_m, recorded):
    unit, view = driving_around(lab, step=20)
    astray = replace(unit, escape_planned_step=0, escape_offset_m=unit.escape_offset_m + moved_m)
    astray = replace(astray, navigator=replace(unit.navigator, left_m=1.0))
    other, events = controller.escape_path(astray, view.ego(0))
    assert other.escape_offset_m == pytest.approx(unit.escape_offset_m)
    assert [event.detail["left_m"] for event in events] == ([pytest.approx(unit.escape_offset_m)] if recorded else [])


def test_a_path_to_the_other_side_is_told_although_it_ends_as_far_from_the_line(lab):
    unit, view = driving_around(lab, step=20)
    mirrored = replace(unit, escape_planned_step=0, escape_offset_m=-unit.escape_offset_m)
    mirrored = replace(mirrored, navigator=replace(unit.navigator, left_m=1.0))
    assert kinds(controller.escape_path(mirrored, view.ego(0))[1]) == ["gap_escape_replanned"]


@pytest.mark.parametrize(("centre_m", "goes_on"), [(108.5, True), (106.3, False)])
def test_without_another_path_the_present_one_is_driven_while_a_metre_of_it_is_free(lab, centre_m, goes_on):
    """The EMV's front is at 103.25 m, the rears of both others are 2.375 m behind their centres."""
    unit, _ = driving_around(lab)
    after, events = controller.escape_path(unit, view_at(lab, others=in_both_lanes(lab, centre_m), step=10).ego(0))
    assert (after.escape_offset_m == unit.escape_offset_m) is goes_on
    assert kinds(events) == ([] if goes_on else ["gap_escape_waiting"])


def test_no_escape_begins_while_drivers_ahead_move_aside(lab, monkeypatch):
    """When they stand, the stop counts from then on."""
    view, opens = view_at(lab, speed=0.0), [True]
    monkeypatch.setattr(controller, "way_opens", lambda *_: opens[0])
    waiting, _ = run(EmvUnit(1, blocker_id=2, corridor=True), view, 100)
    assert not waiting.gap_escape_active
    opens[0] = False
    assert not run(waiting, view, 59)[0].gap_escape_active
    assert run(waiting, view, 60)[0].gap_escape_active


def test_an_escape_that_begins_plans_at_once_and_starts_without_a_path(lab):
    """Whatever an escape before it has left behind."""
    before = EmvUnit(1, blocker_id=2, stopped_s=5.0, escape_planned_step=95, escape_offset_m=1.0)
    unit, _ = controller.gap_escape_mode(before, view_at(lab, step=100).ego(0))
    assert unit.gap_escape_active
    assert unit.escape_offset_m is None
    assert unit.escape_planned_step < 0
    planned, events = controller.escape_path(unit, view_at(lab, others=in_both_lanes(lab), step=100).ego(0))
    assert planned.escape_planned_step == 100
    assert kinds(events) == ["gap_escape_waiting"]


def test_an_escape_that_ends_leaves_neither_its_offset_nor_a_plan(lab):
    view = view_at(lab)
    active = EmvUnit(1, plan=RoutePlan((0,), LaneEnd.HORIZON, 0), gap_escape_active=True, blocker_free_s=5.0)
    active = replace(active, escape_offset_m=1.2, corridor_planned_step=7)
    unit, events = controller.gap_escape_mode(active, view.ego(0))
    assert kinds(events) == ["gap_escape_left"]
    assert not unit.gap_escape_active
    assert unit.escape_offset_m is None
    assert unit.plan is None
    assert unit.corridor_planned_step < 0


@pytest.mark.parametrize(("gap", "blocks"), [(14.9, True), (15.1, False)])
def test_while_escaping_the_vehicle_ahead_in_the_lane_blocks_within_15_m(lab, gap, blocks):
    centre = 100.0 + 0.5 * (lab.vehicles[ActorClass.AMBULANCE].length_m + lab.vehicles[ActorClass.SEDAN].length_m)
    view = view_at(lab, others=[lab.Car(5, 0, centre + gap, 0, (0,))])
    assert (controller.blocker_of(EmvUnit(1, gap_escape_active=True), view.ego(0)) == 5) is blocks
    assert controller.blocker_of(EmvUnit(1), view.ego(0)) == 0, "outside an escape the navigator sees it"


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("turned", [0.0, 0.4, -0.4])
def test_the_emv_would_meet_who_is_nearer_aside_than_both_bodies_and_a_margin(lab, side, turned):
    body, other = lab.vehicles[ActorClass.AMBULANCE], lab.vehicles[ActorClass.SEDAN]
    half = 0.5 * (body.width_m + other.width_m * np.cos(turned) + other.length_m * abs(np.sin(turned)))
    network = lab.straight_road(3)
    cars = [lab.Car(1, 1, 100, 3, (0,), ActorClass.AMBULANCE), lab.Car(2, 1, 112, 0, (0,))]
    for apart, meets in ((-0.05, True), (0.05, False)):
        poses = np.array([[100.0, 3.5, 0.0, 3.0], [112.0, 3.5 + side * (half + 0.1 + apart), turned, 0.0]])
        view = lab.view(network, lab.L3, cars, poses=poses)
        assert view.world.config.emv_driver.corridor.clearance_m == 0.1
        assert controller.in_the_way(view.ego(0), 1, 1) is meets


@pytest.mark.parametrize("speed", [0.0, 4.0])
def test_a_leader_of_sumo_that_nobody_knows_blocks_an_emv_under_way_too(lab, speed):
    view = view_at(lab, speed, advice={"leader_id": 99, "leader_gap_m": 20.0})
    assert controller.blocker_of(EmvUnit(1, gap_escape_active=True), view.ego(0)) == 99


@pytest.mark.parametrize(("away_m", "free"), [(75.0, False), (120.0, True)])
def test_nobody_may_come_towards_it_in_the_time_that_it_needs(lab, away_m, free):
    """Over 30 m at 20 km/h, and a second more, an oncoming vehicle at 10 m/s comes 65 m nearer."""
    cars = [lab.Car(2, 0, 112, 0, (0,)), lab.Car(3, 1, 300.0 - away_m, 10, (1,))]
    view = view_at(lab, others=cars, network=lab.two_way_road())
    path = controller.search_gap(reference_of(view, 0), view.ego(0))
    assert (path is not None) is free
