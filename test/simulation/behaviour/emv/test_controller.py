"""The guards of the EMV's algorithm, one by one, without SUMO."""

from dataclasses import replace

import numpy as np
import pytest
from behaviour.lab import kinds, stepper

from siren_ros.simulation.behaviour.driving.emv_unit import EmvUnit, RoutePlan
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState
from siren_ros.simulation.behaviour.driving.speed_mechanisms import navigate
from siren_ros.simulation.behaviour.emv import controller
from siren_ros.simulation.behaviour.emv.controller import OFF_PATH_M, EmvState, mode_of, step_emv, target_speed_mps
from siren_ros.simulation.behaviour.emv.forced_lane_change import forced_lane_change
from siren_ros.simulation.behaviour.paths.curve import Curve
from siren_ros.simulation.behaviour.paths.lane_path import LaneEnd
from siren_ros.simulation.behaviour.paths.tracked_path import TrackedPath
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


def test_intent_starts_a_forced_lane_change(lab, emv):
    slow = lab.Car(2, 0, 80, 2, (0,))
    world = lab.world_of(lab.straight_road(), lab.L1)
    state, commands, events = steps(world, [emv, slow], 2, advice={"lane_change_intent": 1})
    assert kinds(events) == ["lane_change_requested", "lane_change_started"]
    assert commands.mode.tolist() == [Mode.FORCED_LANE_CHANGE]
    assert commands.lights[0] & Lights.INDICATOR_LEFT
    assert state.units[1].navigator.path.curve.points[-1, 1] == pytest.approx(3.3, abs=1e-6)


@pytest.mark.parametrize("level", ["L1", "L2"])
def test_a_feasible_intent_is_executed_whatever_it_gains_and_whoever_is_ahead(lab, emv, level):
    world = lab.world_of(lab.straight_road(), getattr(lab, level))
    for cars in ([emv], [emv, lab.Car(2, 0, 80, 2, (0,))]):
        _, _, events = steps(world, cars, 2, advice={"lane_change_intent": 1}, flags=lab.RESCUE)
        assert kinds(events) == ["lane_change_requested", "lane_change_started"]


@pytest.mark.parametrize(
    ("level", "others", "asked"),
    [
        *[("L1", [(2, 1, 90.0, 0.0)], True), ("L2", [(2, 1, 90.0, 2.0)], True)],
        *[("L1", [(2, 1, 90.0, 6.0)], False), ("L1", [(2, 1, 130.0, 0.0)], False)],
        ("L1", [(2, 1, 90.0, 0.0), (3, 0, 95.0, 0.0)], False),
    ],
    ids=["queue", "slow traffic", "moving traffic", "far away", "shoulder in use"],
)
def test_uses_a_free_shoulder_where_slow_traffic_holds_it_up(lab, level, others, asked):
    world = lab.world_of(lab.straight_road(2, shoulder=True), getattr(lab, level))
    cars = [lab.Car(1, 1, 50, 8, (0,), AMBULANCE), *(lab.Car(*other, (0,)) for other in others)]
    _, _, events = steps(world, cars, 2)
    expected = [("lane_change_requested", "shoulder"), ("lane_change_started", "shoulder")] if asked else []
    assert [(event.kind.value, event.detail["reason"]) for event in events] == expected


def test_infeasible_intent_is_reconsidered_and_dropped_after_a_while(lab, emv):
    cars = [emv, lab.Car(2, 0, 80, 2, (0,)), lab.Car(3, 1, 52, 10, (0,))]
    world = lab.world_of(lab.straight_road(), lab.L1)
    state, _, events = steps(world, cars, 3, advice={"lane_change_intent": 1})
    assert kinds(events) == ["lane_change_requested", "lane_change_deferred"]
    freed, _, started = steps(world, cars[:2], 1, state, 3, advice={"lane_change_intent": 1})
    assert kinds(started) == ["lane_change_started"]
    assert freed.units[1].lane_change_forced
    assert kinds(steps(world, cars, 30, state, 3)[2]) == ["lane_change_cancelled"]


def test_the_pause_after_which_an_intent_is_dropped_begins_again_with_each_intent(lab, emv):
    cars = [emv, lab.Car(2, 0, 80, 2, (0,)), lab.Car(3, 1, 52, 10, (0,))]
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
    cars += [lab.Car(2 + side, lane, 52, 10, (0,)) for side, lane in ((1, 0), (2, 2))]
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


def test_route_need_comes_before_sumos_intent(lab):
    world = lab.world_of(lab.junction_road(), lab.L1)
    _, _, events = steps(world, [lab.Car(1, 1, 40, 10, (0, 4), AMBULANCE)], 3, advice={"lane_change_intent": 1})
    assert kinds(events) == ["lane_change_requested", "lane_change_started"]
    assert events[0].detail == {"side": -1, "reason": "route"}


@pytest.mark.parametrize("speed", [0.0, 8.0])
def test_a_lane_change_that_the_route_needs_may_end_on_the_junction(lab, speed):
    """Otherwise the EMV would stand for ever at the end of a lane that is too short for the change."""
    world = lab.world_of(lab.junction_road(), lab.L1)
    state, _, events = steps(world, [lab.Car(1, 1, 145, speed, (0, 4), AMBULANCE)], 3)
    assert kinds(events) == ["lane_change_requested", "lane_change_started"]
    assert state.units[1].plan.edges[-1] == 4
    assert state.units[1].navigator.path.curve.points[-1, 1] < -10.0


@pytest.mark.parametrize(("radius", "kind"), [(25.0, "lane_change_deferred"), (200.0, "lane_change_started")])
def test_no_lane_change_starts_while_the_emv_still_turns_onto_its_road(lab, straight, radius, kind):
    view = lab.view(straight, lab.L1, [lab.Car(1, 0, 50, 6, (0,), AMBULANCE)], advice={"lane_change_intent": 1})
    angle = np.linspace(-20.0 / radius, 40.0 / radius, 60)
    arc = np.stack((50.0 + radius * np.sin(angle), radius * (1.0 - np.cos(angle))), axis=-1)
    path = TrackedPath.of(Curve.through(arc), view.ego(0).navigator_config, np.zeros(len(arc), np.int32))
    plan = RoutePlan((0,), LaneEnd.HORIZON, 0)
    unit = EmvUnit(1, navigator=NavigatorState().following(path, 50.0, 0.0), plan=plan)
    assert kinds(forced_lane_change(unit, view.ego(0))[1]) == ["lane_change_requested", kind]


def test_the_emv_leaves_the_presets_time_behind_those_who_cross(lab):
    world = lab.world_of(lab.junction_road(), lab.L1)
    for name, least_s, most_s in (("paper", 1.0, 2.0), ("realistic", 1.0, 2.0), ("reckless", 0.0, 0.9)):
        conflicts = replace(world, preset=load_preset(name)).emv_navigator.conflicts
        assert least_s < conflicts.after_s < most_s


def test_the_emv_looks_out_as_far_ahead_as_the_preset_says(lab, monkeypatch):
    world = lab.world_of(lab.junction_road(), lab.L1)
    short = replace(world, preset=replace(world.preset, attention=Attention(emv_horizon_s=1.0)))
    used = []

    def noted(unit, ego, target_mps, config):
        used.append(config.conflicts.horizon_s)
        return navigate(unit, ego, target_mps, config)

    monkeypatch.setattr(controller, "navigate", noted)
    for seen in (world, short):
        steps(seen, [lab.Car(1, 0, 60, 10, (0, 2), AMBULANCE)], 1)
    assert used == [8.0, 1.0]


def test_path_reaches_through_the_junction_and_stays_the_same_while_it_serves(lab):
    world = lab.world_of(lab.junction_road(), lab.L1)
    emv = lab.Car(1, 0, 60, 10, (0, 2), AMBULANCE)
    state, _, _ = steps(world, [emv])
    path = state.units[1].navigator.path
    assert path.curve.points[-1, 0] > 150.0
    assert steps(world, [emv], 10, state, 1)[0].units[1].navigator.path is path


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


def test_same_inputs_give_the_same_commands(lab, emv):
    def run():
        loop = lab.Loop(lab.world_of(lab.straight_road(), lab.L2), [emv, lab.Car(2, 0, 90, 5, (0,))]).run(60)
        return [tuple(row[1]) for row in loop.log], loop.events

    assert run() == run()


def test_plans_anew_when_the_route_changes(lab):
    world = lab.world_of(lab.junction_road(), lab.L1)
    state, _, _ = steps(world, [lab.Car(1, 0, 60, 10, (0, 2), AMBULANCE)], 30)
    before = state.units[1].navigator.path
    state, _, _ = steps(world, [lab.Car(1, 0, 60, 10, (0, 4), AMBULANCE)], 1, state, 30)
    after = state.units[1].navigator.path
    assert after is not before
    assert after.curve.points[-1, 1] < -10.0


@pytest.mark.parametrize(
    ("level", "first"),
    [("L1", ["lane_change_stuck"]), ("L2", ["lane_change_stuck"]), ("L3", ["gap_escape_mode", "corridor_mode"])],
)
def test_guards_are_evaluated_in_the_papers_order(lab, monkeypatch, level, first):
    """The gap escape has the highest priority; without a corridor it only ends lane changes that stand still."""
    asked = []
    always = ["forced_lane_change", "waypoints", "complete_lane_change"]

    def noted(name, guard):
        return lambda unit, ego: asked.append(name) or guard(unit, ego)

    for name in ("gap_escape_mode", "corridor_mode", "lane_change_stuck", *always):
        monkeypatch.setattr(controller, name, noted(name, getattr(controller, name)))
    steps(lab.world_of(lab.straight_road(), getattr(lab, level)), [lab.Car(1, 0, 50, 8, (0,), AMBULANCE)], 2)
    assert asked == 2 * [*first, *always]


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("more_m", "anew"), [(-0.05, False), (0.05, True)])
def test_plans_anew_where_it_has_come_off_its_path_to_either_side(lab, emv, side, more_m, anew):
    world = lab.world_of(lab.straight_road(), lab.L1)
    unit = steps(world, [emv], 1)[0].units[1]
    off = replace(unit, navigator=replace(unit.navigator, left_m=side * (OFF_PATH_M + more_m)))
    for step, planned in ((19, False), (20, anew)):
        after, _ = controller.follow_route(off, lab.view_in(world, [emv], step=step).ego(0))
        assert (after.navigator.path is not unit.navigator.path) is planned
