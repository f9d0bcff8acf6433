"""States of drivers: draws of civilians, lanes that the EMV needs, and guards on roads that point anywhere."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.simulation.behaviour.driving.driver_states import (
    Compliance,
    Driver,
    EmvUnit,
    LateralRequest,
    Refusal,
    RoutePlan,
    YieldUnit,
    best_lane,
    civilian_guards,
    draw_driver,
    emv_fully_passed,
    emv_guards,
    plan_route,
    present_lane,
    strategic_side,
)
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState
from siren_ros.simulation.behaviour.driving.speed_mechanisms import ESCAPE_HORIZON_M
from siren_ros.simulation.behaviour.driving.tracked_path import LaneEnd
from siren_ros.simulation.behaviour.emv.controller import reference_line
from siren_ros.simulation.scenario.presets import ComplianceShares, TruncatedNormal, load_preset
from siren_ros.simulation.world.actors import ActorClass, Mode


def test_each_driver_is_a_draw_from_a_stream_of_its_own():
    """Where nothing else is drawn the stream's first number decides: half comply, a fifth late."""
    delay, late, far = (TruncatedNormal(value, 0.0, value, value) for value in (1.0, 3.0, 60.0))
    preset = replace(
        load_preset("paper"), reaction_delay_s=delay, late_delay_s=late, response_distance_m=far,
        compliance=ComplianceShares(0.5, 0.2, 0.3),
    )  # fmt: skip
    kinds = (
        Driver(Compliance.COMPLIES, 1.0, 60.0),
        Driver(Compliance.LATE, 4.0, 60.0),
        Driver(Compliance.NEVER, 1.0, 60.0),
    )
    for actor in range(1, 30):
        share = random_stream(7, "driver", actor).random()
        assert draw_driver(preset, 7, actor) == kinds[(share >= 0.5) + (share >= 0.7)]
    assert {draw_driver(load_preset("paper"), 3, actor) for actor in range(30)} == {
        Driver(Compliance.COMPLIES, 0.0, 40.0)
    }
    assert len({draw_driver(load_preset("realistic"), 3, actor).delay_s for actor in range(30)}) == 30


AMBULANCE = ActorClass.AMBULANCE


@pytest.mark.parametrize("turn", np.radians([30.0, 60.0, 140.0, -100.0]))
@pytest.mark.parametrize(
    ("ahead", "left", "yaw", "passed"),
    [
        *[(6.62, 3.3, 0.0, False), (6.63, 3.3, 0.0, True), (6.63, -3.3, 0.0, True)],
        *[(0.0, 8.0, 0.0, False), (-6.7, 0.0, 0.0, False), (1.0 + 2.375 + 1.04, 5.0, np.pi / 2.0, False)],
        *[(1.0 + 2.375 + 1.04, 5.0, -np.pi / 2.0, False), (1.0 + 2.375 + 1.06, 5.0, -np.pi / 2.0, True)],
    ],
)
def test_passing_on_a_road_that_points_elsewhere(lab, turn, ahead, left, yaw, passed):
    """On a road through the origin; the EMV is 6.5 m long and 2.1 m wide, the car 4.75 m long."""
    network, along, across = lab.turned_road(turn, length=300.0)
    place, emv = 100.0 * along, (100.0 + ahead) * along + left * across
    poses = np.array([[*emv, turn + yaw, 8.0], [*place, turn + 0.2, 2.0]])
    cars = [lab.Car(1, 0, 100, 8, (0,), AMBULANCE), lab.Car(2, 0, 100, 2, (0,))]
    assert emv_fully_passed(lab.view(network, lab.L2, cars, poses=poses).ego(1), 0) is passed


def route(*edges):
    return np.array(edges, dtype=np.int32)


def fork(lab):
    """Three lanes; the left one leads to edge 1, the middle and the right one to edge 2."""
    road = lab.RoadBuilder().edge([[0, 0], [100, 0]], 3, ("A", "B"))
    road.edge([[100, 6.6], [200, 60]], 1, ("B", "C"))
    road.edge([[100, 0], [200, 0]], 2, ("B", "D"))
    return road.connect(2, 3, direction="l").connect(0, 4).connect(1, 5).built()


@pytest.mark.parametrize(
    ("lane", "edges", "side"),
    [
        *[(0, (0, 1), 1), (1, (0, 1), 1), (2, (0, 1), 0), (2, (0, 2), -1)],
        *[(1, (0, 2), 0), (0, (0, 2), 0), (0, (1,), 0), (0, (), 0)],
    ],
)
def test_the_side_to_change_to(lab, lane, edges, side):
    assert strategic_side(fork(lab), lane, route(*edges)) == side


@pytest.mark.parametrize(
    ("lane", "edges", "best"),
    [(0, (0, 1), 2), (2, (0, 1), 2), (2, (0, 2), 1), (0, (0, 2), 0), (1, (1,), 1), (2, (), 2)],
)
def test_the_lane_that_serves_the_route_best_and_is_nearest(lab, lane, edges, best):
    assert best_lane(fork(lab), lane, route(*edges)) == best


def view_at(lab, network, lane, s, edges, speed=8.0, left=0.0):
    return lab.view(network, lab.L1, [lab.Car(1, lane, s, speed, edges, AMBULANCE, left=left)], step=7)


def test_a_plan_knows_its_edges_its_end_and_its_step(lab, junction):
    plan, navigator = plan_route(view_at(lab, junction, 0, 60, (0, 2)).ego(0), 0, NavigatorState())
    assert (plan.edges, plan.end, plan.planned_step) == ((0, 2), LaneEnd.HORIZON, 7)
    assert navigator.left_m == pytest.approx(0.0, abs=1e-6)
    plan, navigator = plan_route(view_at(lab, junction, 1, 60, (0, 4)).ego(0), 1, NavigatorState())
    assert plan.end is LaneEnd.ASTRAY
    assert navigator.path.curve.points[-1, 0] == pytest.approx(150.0 - 3.25 - 1.0)
    assert navigator.path.speed_cap_mps(navigator.path.length_m) < 0.1


def test_the_path_stops_before_the_routes_end(lab):
    network = lab.straight_road(2, 120.0)
    plan, navigator = plan_route(view_at(lab, network, 0, 60, (0,)).ego(0), 0, NavigatorState())
    assert plan.end is LaneEnd.ROUTE
    assert navigator.path.curve.points[-1, 0] == pytest.approx(120.0 - 3.25 - 3.0)
    assert navigator.path.speed_cap_mps(navigator.path.length_m) < 0.1


@pytest.mark.parametrize(("left", "from_behind"), [(0.4, True), (-0.4, True), (0.6, False), (-0.6, False)])
def test_small_offsets_are_left_to_the_tracking_and_large_ones_get_a_path_of_their_own(lab, left, from_behind):
    """The line of the lane begins 10 m behind; a path back to it begins at the vehicle."""
    view = view_at(lab, lab.straight_road(1, 400.0), 0, 60, (0,), left=left)
    _, navigator = plan_route(view.ego(0), 0, NavigatorState())
    assert navigator.path.curve.points[0] == pytest.approx((50.0, 0.0) if from_behind else (60.0, left), abs=1e-6)


@pytest.mark.parametrize(
    ("edges", "ahead", "agrees"),
    [
        *[((4, 5), (4, 5, 6), True), ((4, 5, 6), (5, 6), True), ((4, 5), (3, 4, 5), True), ((4, 5), (4, 7), False)],
        *[((4, 5), (7, 8), False), ((4, 5), (8, 9), False), ((4, 5), (), False)],
        *[((4, 5), (5,), True), ((4, 5), (5, 9), True)],
    ],
)
def test_a_plan_agrees_with_a_route_as_far_as_both_reach(edges, ahead, agrees):
    assert RoutePlan(edges, LaneEnd.HORIZON, 0).agrees_with(route(*ahead)) is agrees


def test_the_present_lane_is_the_paths_while_it_is_on_the_route(lab, junction):
    view = view_at(lab, junction, 1, 60, (0, 2))
    _, navigator = plan_route(view.ego(0), 0, NavigatorState())
    assert (present_lane(view.ego(0), NavigatorState()), present_lane(view.ego(0), navigator)) == (1, 0)
    assert present_lane(view_at(lab, junction, 4, 10, (2,)).ego(0), navigator) == 4


def test_the_line_of_the_escape_search_begins_behind_the_rear_axle(lab):
    view = view_at(lab, lab.straight_road(2), 0, 100, (0,))
    line = reference_line(view.ego(0), 0)
    assert line.curve.points[0] == pytest.approx((95.0, 0.0), abs=1e-6)
    assert line.curve.length_m == pytest.approx(ESCAPE_HORIZON_M + 10.0)


@pytest.mark.parametrize(
    ("turned", "from_behind"), [(0.0, True), (0.29, True), (-0.29, True), (0.31, False), (-0.31, False), (np.pi, False)]
)
def test_an_emv_that_points_elsewhere_gets_a_path_from_its_own_pose(lab, straight, turned, from_behind):
    poses = np.array([[100.0, 0.0, turned, 5.0]])
    traffic = lab.traffic_of(straight, [lab.Car(1, 0, 100, 5, (0,), AMBULANCE)], poses=poses)
    _, navigator = plan_route(lab.view_of(lab.world_of(straight, lab.L1), traffic).ego(0), 0, NavigatorState())
    assert float(navigator.path.curve.points[0, 0]) == pytest.approx(90.0 if from_behind else 100.0, abs=0.01)


def test_lanes_that_only_an_emv_may_use_count_for_it(lab):
    """The turn to the right leads from the shoulder alone."""
    road = lab.RoadBuilder().edge([[0.0, 0.0], [150.0, 0.0]], 3, ("W", "J"), shoulder=True)
    road.edge([[160.0, -10.0], [160.0, -100.0]], 1, ("J", "S"))
    road.connect(0, 3, direction="r")
    network = road.built()
    assert [strategic_side(network, lane, route(0, 1)) for lane in (0, 1, 2)] == [0, -1, -1]
    assert [best_lane(network, lane, route(0, 1)) for lane in (0, 1, 2)] == [0, 0, 0]


ASKED = LateralRequest(-1, "slow_traffic", 99)
ONLY_THEN, NO_CORRIDOR = "at this level only from a lane change that stands still", "this level has no rescue corridor"
NOBODY, BETWEEN = "nobody ahead forms a rescue lane or brakes for the EMV", "not between other vehicles"
STANDS, TO_RIGHT = "stands for 1.3 s, enters after 3 s", "asked for to the right (slow traffic)"
IN_CORRIDOR = {"corridor": True, "corridor_seen_step": 90, "blocker_free_s": 0.4}
OF_EMV = [
    ("L2", {}, [], [ONLY_THEN, NO_CORRIDOR, "neither route nor traffic ask for one", "route"]),
    ("L2", {"stopped_s": 1.3, "change_side": -1}, [2], [STANDS, NO_CORRIDOR, "to the right", "route"]),
    ("L2", {"request": ASKED}, [], [ONLY_THEN, NO_CORRIDOR, TO_RIGHT, "route"]),
    ("L2", {"request": ASKED, "change_step": 80}, [],
     [ONLY_THEN, NO_CORRIDOR, TO_RIGHT + ", not before 1.0 s", "route"]),
    ("L3", {"stopped_s": 1.3, "request": replace(ASKED, side=1, deferred=Refusal.GAP_REAR)}, [],
     [STANDS, NOBODY, "asked for to the left (slow traffic), deferred: gap rear", "route"]),
    ("L3", IN_CORRIDOR, [1], ["nobody blocks the way", "none has made way for 0.5 s", BETWEEN, "rescue corridor"]),
    ("L3", {**IN_CORRIDOR, "gap_escape_active": True, "corridor_seen_step": 100}, [0, 1],
     ["no free path yet", "vehicles ahead make way", BETWEEN, "gap escape"]),
    ("L3", {"gap_escape_active": True, "escape_offset_m": 0.0, "blocker_free_s": 0.4}, [0],
     ["drives past the blocker; 0.4 of 2 s free", NOBODY, BETWEEN, "gap escape"]),
]  # fmt: skip


@pytest.mark.parametrize(("level", "unit", "acts", "why"), OF_EMV)
def test_what_is_said_of_an_emvs_guards(lab, level, unit, acts, why):
    guards = emv_guards(EmvUnit(1, **unit), 100, lab.world_of(lab.straight_road(), getattr(lab, level)))
    names = ["gap escape", "rescue corridor", "forced lane change", "waypoints"]
    texts = [*why[:3], f"the path comes from the {why[3]}"]
    assert [(guard.name, guard.why) for guard in guards] == list(zip(names, texts, strict=True))
    assert [guard.name for guard in guards if guard.acts] == [*(names[at] for at in acts), "waypoints"]


AGO, NOT_BEGUN, UNTIL = "late, 0.5 s ago", "not begun", "until the EMV has passed"
REFUSES = Driver(Compliance.NEVER, 1.0, 60.0)
OF_CIVILIAN = [
    ("L2", {"react_step": 120}, [], ["late, in 1.0 s", NOT_BEGUN, NOT_BEGUN]),
    ("L2", {"deferred": "gap_rear"}, [1], [AGO, "deferred: gap rear", NOT_BEGUN]),
    ("L2", {"react_step": 100, "phase": Mode.YIELD_LANE_CHANGE, "side": 1}, [1, 2],
     ["late, 0.0 s ago", "to the left", "the lane change is not finished"]),
    ("L3", {"phase": Mode.YIELD_PULL_OVER, "side": -1}, [1, 2], [AGO, "to the right", "the pull-over is not finished"]),
    ("L3", {"phase": Mode.YIELD_HOLD}, [1, 3], [AGO, "done", UNTIL]),
    ("L2", {"phase": Mode.REJOIN}, [1, 4], [AGO, "done", UNTIL]),
    ("L3", {"emv_id": 0, "driver": REFUSES}, [], ["this driver does not comply", NOT_BEGUN, NOT_BEGUN]),
]  # fmt: skip


@pytest.mark.parametrize(("level", "unit", "acts", "why"), OF_CIVILIAN)
def test_what_is_said_of_a_civilians_guards(lab, level, unit, acts, why):
    driver = replace(YieldUnit(2, 1, Driver(Compliance.LATE, 4.0, 60.0), 90), **unit)
    guards = civilian_guards(driver, 100, lab.world_of(lab.straight_road(), getattr(lab, level)))
    heard = "heard the EMV within 60 m" + ": EMV 1" * (driver.emv_id == 1)
    made = ["pulls over", "holds"] if level == "L3" else ["changes lane", "keeps its lane"]
    names = ["notices", "reacts", *made, "rejoins"]
    texts = [heard, *why, "once the EMV has passed, or is gone"]
    assert [(guard.name, guard.why) for guard in guards] == list(zip(names, texts, strict=True))
    assert [guard.name for guard in guards if guard.acts] == ["notices", *(names[at] for at in acts)]
