"""The civilians' algorithm, transition by transition, without SUMO."""

from dataclasses import replace

import numpy as np
import pytest
from behaviour.civilians.civilian_steps import UNIT, steps
from behaviour.lab import kinds

from siren_ros.simulation.behaviour.civilians.yield_lane_change import (
    OFF_PATH_GRACE_S,
    yield_speed_mps,
)
from siren_ros.simulation.behaviour.civilians.yield_manager import (
    EmvRoad,
    YieldState,
    region_members,
    step_yield,
    way_from_emv_m,
)
from siren_ros.simulation.behaviour.driving.step_view import ActorTable
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.scenario.paper import PAPER_CONSTANTS
from siren_ros.simulation.scenario.presets import ComplianceShares, TruncatedNormal
from siren_ros.simulation.world.actors import ActorClass, Lights, Mode, Owner, TrafficFlags

AMBULANCE = ActorClass.AMBULANCE
GRACE = round(OFF_PATH_GRACE_S / 0.05)


def modes(commands):
    return dict(zip(commands.actor_id.tolist(), (Mode(mode) for mode in commands.mode.tolist()), strict=True))


def emv_at(lab, s=50.0, lane=0):
    return lab.Car(1, lane, s, 10, (0,), AMBULANCE)


@pytest.fixture
def world(lab):
    return lab.world_of(lab.straight_road(), lab.L2)


@pytest.mark.parametrize("level", ["L0", "L1"])
def test_nobody_yields_without_a_siren(lab, level):
    quiet = lab.world_of(lab.straight_road(), getattr(lab, level))
    _, commands, events = steps(quiet, [emv_at(lab), lab.Car(2, 0, 70, 5, (0,))], flags=lab.RESCUE)
    assert len(commands) == 0
    assert not events


def test_yields_at_once_with_the_papers_driver(lab, world):
    _, commands, events = steps(world, [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))])
    assert (kinds(events), events[0].other_id) == (["yield_requested", "yield_started"], 1)
    assert (modes(commands), commands.owner.tolist()) == ({2: Mode.YIELD_LANE_CHANGE}, [Owner.ROS])
    assert commands.source == "yield_manager"


@pytest.mark.parametrize(
    ("lane", "s"), [(1, 80.0), (0, 30.0), (0, 96.0)], ids=["other lane", "behind", "beyond the response distance"]
)
def test_only_vehicles_ahead_in_the_emvs_lane_within_the_response_distance(lab, world, lane, s):
    _, commands, events = steps(world, [emv_at(lab), lab.Car(2, lane, s, 5, (0,))])
    assert len(commands) == 0
    assert not events


@pytest.mark.parametrize(
    ("emv_mps", "mps", "s", "notices"),
    [(0.5, 0.2, 130.0, True), (0.6, 0.2, 130.0, False), (0.5, 0.3, 130.0, False), (0.5, 0.2, 137.0, False)],
    ids=["stands in the queue", "the EMV drives", "drives", "beyond the queue"],
)
def test_who_stands_in_a_queue_notices_an_emv_that_stands_in_it(lab, world, emv_mps, mps, s, notices):
    """The EMV's front is at 53.1 m, the rear of a sedan at 130 m is 74.5 m ahead of it."""
    emv = lab.Car(1, 0, 50.0, emv_mps, (0,), AMBULANCE)
    _, _, events = steps(world, [emv, lab.Car(2, 0, s, mps, (0,))])
    assert ("yield_requested" in kinds(events)) is notices


@pytest.mark.parametrize(("mps", "notices"), [(0.2, True), (0.3, False)])
def test_who_stands_ahead_of_drivers_who_stand_and_have_noticed_an_emv_notices_it_too(lab, world, mps, notices):
    """The EMV still drives; the driver in between is 19 m ahead of it."""
    cars = [emv_at(lab), lab.Car(2, 0, 75.0, mps, (0,)), lab.Car(3, 0, 130.0, 0.0, (0,))]
    state, _, events = steps(world, cars)
    assert [event.actor_id for event in events if event.kind.value == "yield_requested"] == [2]
    _, _, events = steps(world, cars, state=state, start=1)
    assert (3 in [event.actor_id for event in events if event.kind.value == "yield_requested"]) is notices


def test_who_noticed_an_emv_in_a_queue_stays_attentive_as_it_moves_on(lab, world):
    emv, head = lab.Car(1, 0, 50.0, 0.0, (0,), AMBULANCE), lab.Car(2, 0, 130.0, 0.0, (0,))
    state, _, _ = steps(world, [emv, head])
    assert state.units[2].driver.response_distance_m == pytest.approx(80.0 - 0.5 * (6.5 + 4.75))
    _, _, events = steps(world, [replace(emv, speed=3.0), head], state=state, start=1)
    assert "yield_cancelled" not in kinds(events)


def test_response_distance_reaches_beyond_the_interaction_region(lab, world):
    far = replace(world, preset=world.preset.for_scenario(60.0, 0.0, 1.0))
    beyond = lab.Car(2, 0, 50 + 0.5 * (6.5 + 4.75) + 59.9, 5, (0,))
    assert not steps(world, [emv_at(lab), beyond])[2]
    state, _, events = steps(far, [emv_at(lab), beyond])
    assert kinds(events) == ["yield_requested", "yield_started"]
    state, _, events = steps(far, [emv_at(lab, 40.2), beyond], 1, state, 1)
    assert not events
    _, _, events = steps(far, [emv_at(lab, 39.0), beyond], 1, state, 2)
    assert events[0].detail["reason"] == "emv_gone"


def test_response_distance_is_the_free_way(lab, world):
    near = replace(world, preset=replace(world.preset, response_distance_m=TruncatedNormal(20.0, 0.0, 20.0, 20.0)))
    half = 0.5 * (6.5 + 4.75)
    assert not steps(near, [emv_at(lab), lab.Car(2, 0, 50 + half + 20.1, 5, (0,))])[2]
    assert steps(near, [emv_at(lab), lab.Car(2, 0, 50 + half + 19.9, 5, (0,))])[2]


@pytest.mark.parametrize("first", [0, 300])
def test_the_delay_counts_from_the_step_at_which_the_driver_notices(lab, world, first):
    """Also late in an episode."""
    slow = replace(world, preset=world.preset.for_scenario(40.0, 1.0, 1.0))
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))]
    known = YieldState(actors=ActorTable.empty().updated(lab.traffic_of(world.network, cars)))
    state, _, events = steps(slow, cars, 1, known, first)
    assert kinds(events) == ["yield_requested"]
    assert state.units[2].react_step == first + 20
    state, commands, events = steps(slow, cars, 19, state, first + 1)
    assert not events
    assert (modes(commands), commands.owner.tolist()) == ({2: Mode.YIELD_REACTING}, [Owner.SUMO])
    _, _, events = steps(slow, cars, 1, state, first + 20)
    assert kinds(events) == ["yield_started"]


@pytest.mark.parametrize("level", ["L2", "L3"])
def test_the_av_under_test_and_other_emvs_are_asked_nothing(lab, straight, level):
    cars = [emv_at(lab), lab.Car(2, 0, 75, 5, (0,)), lab.Car(3, 0, 85, 5, (0,)), lab.Car(4, 0, 65, 5, (0,), AMBULANCE)]
    _, _, events = steps(lab.world_of(straight, getattr(lab, level), av_id=3), cars)
    assert {event.actor_id for event in events} == {2}


def test_request_latches_when_the_emv_falls_back(lab, world):
    slow = replace(world, preset=world.preset.for_scenario(40.0, 1.0, 1.0))
    car = lab.Car(2, 0, 95, 5, (0,))
    state, _, _ = steps(slow, [emv_at(lab), car])
    _, _, events = steps(slow, [emv_at(lab, 46.0), car], 20, state, 1)
    assert kinds(events) == ["yield_started"]


def test_drivers_that_never_comply_are_asked_once_and_stay_nominal(lab, world):
    refusing = replace(world, preset=replace(world.preset, compliance=ComplianceShares(0.0, 0.0, 1.0)))
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,)), lab.Car(3, 0, 5, 10, (0,), AMBULANCE)]
    state, commands, events = steps(refusing, cars, 50)
    assert (kinds(events), events[0].detail["compliance"]) == (["yield_requested"], "never")
    assert len(commands) == 0
    assert not steps(refusing, [*cars[:2], replace(cars[2], s=65)], 5, state, 50)[2], "nor by a nearer one"


def test_infeasible_yield_is_deferred_once_and_reconsidered(lab, world):
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,)), lab.Car(3, 1, 81, 5, (0,))]
    world = replace(world, av_id=3)
    state, commands, events = steps(world, cars, 10)
    assert kinds(events) == ["yield_requested", "yield_deferred"]
    assert events[1].detail["reason"] == "vehicle_beside"
    assert (modes(commands), commands.owner.tolist()) == ({2: Mode.YIELD_DEFERRED}, [Owner.SUMO])
    cars[2] = lab.Car(3, 1, 120, 5, (0,))
    _, commands, events = steps(world, cars, 1, state, 10)
    assert kinds(events) == ["yield_started"]


@pytest.mark.parametrize(
    ("beside_s", "ahead_s", "kind", "lets_in"),
    [
        *[(79.0, 160.0, ActorClass.SEDAN, True), (82.0, 160.0, ActorClass.SEDAN, True)],
        *[(74.5, 160.0, ActorClass.SEDAN, True), (86.0, 160.0, ActorClass.SEDAN, False)],
        *[(79.0, 96.0, ActorClass.SEDAN, False), (79.0, 160.0, ActorClass.BICYCLE, False)],
    ],
    ids=["beside", "beside and ahead", "close behind", "ahead", "no space to draw ahead", "a cyclist"],
)
def test_who_is_beside_a_driver_that_has_to_clear_lets_it_in(lab, world, beside_s, ahead_s, kind, lets_in):
    """A sedan at 80 m waits for a gap in the other lane."""
    cars = [emv_at(lab), lab.Car(2, 0, 80, 8, (0,)), lab.Car(3, 1, beside_s, 8, (0,), kind)]
    state, commands, events = steps(world, [*cars, lab.Car(4, 0, ahead_s, 8, (0,))], 2)
    assert modes(commands)[2] == Mode.YIELD_DEFERRED
    assert modes(commands).get(3) == (Mode.YIELD_KEEP_LANE if lets_in else None)
    asked = [event for event in events if event.actor_id == 3]
    assert [(event.kind.value, event.detail["reason"]) for event in asked] == [("yield_requested", "lets_in")] * lets_in
    assert all(
        owner == Owner.SUMO for actor, owner in zip(commands.actor_id, commands.owner, strict=True) if actor == 3
    )
    assert steps(world, [cars[0], *cars[2:]], 2)[1].actor_id.tolist() == [], "nobody waits"
    assert "yield_cancelled" in kinds(steps(world, cars[1:], 1, state, 2)[2]), "the EMV has left"
    passed = [lab.Car(1, 0, 120, 10, (0,), AMBULANCE), lab.Car(2, 0, 160, 8, (0,)), cars[2]]
    assert 3 not in modes(steps(world, passed, 1, state, 2)[1]), "released"


def test_who_lets_another_one_in_reacts_after_the_delay_and_only_who_hears_the_siren(lab, world):
    cars = [emv_at(lab), lab.Car(2, 0, 80, 8, (0,)), lab.Car(3, 1, 79, 8, (0,))]
    slow = replace(world.preset, reaction_delay_s=TruncatedNormal(0.5, 0.0, 0.5, 0.5))
    late = replace(world, preset=slow)
    begins = {event.actor_id: event.step for event in steps(late, cars, 40)[2] if event.kind.value == "yield_requested"}
    assert (begins[2], begins[3]) == (0, 20), "half a second until the first one waits, and again until the second one"
    never = replace(world, preset=replace(world.preset, compliance=ComplianceShares(0.0, 0.0, 1.0)))
    state = steps(world, cars, 1)[0]
    kept = replace(state, drivers={2: state.drivers[2]}, units={2: state.units[2]})
    assert 3 not in modes(steps(never, cars, 2, kept, 1)[1])
    assert 3 not in modes(steps(replace(world, av_id=3), cars, 2)[1])
    bumpers_m = 0.5 * (lab.vehicles[AMBULANCE].length_m + lab.vehicles[ActorClass.SEDAN].length_m)
    far_m = 50.0 + bumpers_m + world.preset.response_distance_m.mean - 1.0
    for beside_m, hears in ((0.5, True), (1.5, False)):
        cars = [emv_at(lab), lab.Car(2, 0, far_m, 8, (0,)), lab.Car(3, 1, far_m + beside_m, 8, (0,))]
        assert (3 in modes(steps(world, cars, 2)[1])) is hears


@pytest.mark.parametrize("level", ["L2", "L3"])
@pytest.mark.parametrize(("kind", "answers"), [(ActorClass.BICYCLE, False), (ActorClass.MOTORCYCLE, True)])
def test_cyclists_do_not_respond_and_motorcyclists_do(lab, straight, level, kind, answers):
    world = lab.world_of(straight, getattr(lab, level))
    assert bool(steps(world, [emv_at(lab), lab.Car(2, 0, 75, 5, (0,), kind)])[2]) is answers


def test_right_side_is_preferred(lab):
    world = lab.world_of(lab.straight_road(3), lab.L2)
    cars = [emv_at(lab, lane=1), lab.Car(2, 1, 80, 5, (0,))]
    assert steps(world, cars)[2][-1].detail["side"] == -1
    assert steps(world, [*cars, lab.Car(3, 0, 80, 5, (0,))])[2][-1].detail["side"] == 1
    cars[1] = replace(cars[1], flags=int(TrafficFlags.WANTS_LEFT))
    assert steps(world, cars)[2][-1].detail["side"] == 1, "SUMO's intent comes first"


@pytest.mark.parametrize(("limit", "target"), [(13.9, 10.0 / 3.6), (4.0, 2.0)])
def test_lane_change_is_driven_at_the_papers_speed_and_at_most_at_half_the_limit(lab, straight, limit, target):
    lanes = tuple(replace(lane, speed_limit_mps=limit) for lane in straight.lanes)
    world = lab.world_of(replace(straight, lanes=lanes), lab.L2)
    view = lab.view_of(world, lab.traffic_of(straight, [emv_at(lab)]))
    assert (yield_speed_mps(view, 0), yield_speed_mps(view, NO_LANE)) == pytest.approx((target, 10.0 / 3.6))


def test_side_that_leads_on_comes_before_sumos_intent_and_the_right_side(lab):
    road = lab.RoadBuilder().edge([[0, 0], [250, 0]], 3, ("A", "B"))
    road.edge([[270, 3.3], [400, 3.3]], 2, ("B", "C"))
    road.connect(1, 3, signal=True).connect(2, 4, signal=True)
    world = lab.world_of(road.built(), lab.L2)
    wish = int(TrafficFlags.WANTS_RIGHT)
    cars = [lab.Car(1, 1, 120, 10, (0, 1), AMBULANCE), lab.Car(2, 1, 150, 5, (0, 1), flags=wish)]
    assert steps(world, cars)[2][-1].detail["side"] == 1


@pytest.mark.parametrize(("where", "reason"), [(95.0, "emv_passed"), (20.0, "emv_gone")])
def test_yield_that_has_not_started_is_dropped(lab, world, where, reason):
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,)), lab.Car(3, 1, 81, 5, (0,))]
    state, _, _ = steps(world, cars)
    cars[0] = emv_at(lab, where)
    state, _, events = steps(world, cars, 1, state, 1)
    assert (kinds(events), events[0].detail["reason"]) == (["yield_cancelled"], reason)
    assert not state.units


def blocked_then(lab, world, *phases):
    """A civilian whose lane change is blocked, while the EMV drives in one lane after another, each for some steps."""
    cars = [lab.Car(2, 0, 80, 5, (0,)), lab.Car(3, 1, 81, 5, (0,))]
    state, _, _ = steps(world, [emv_at(lab), *cars])
    step, events = 1, []
    for lane, count in phases:
        state, _, happened = steps(world, [emv_at(lab, lane=lane), *cars], count, state, step)
        step += count
        events += [event for event in happened if event.actor_id == 2]
    return events


def test_yield_is_dropped_a_second_after_the_emv_left_the_lane(lab, world):
    assert not blocked_then(lab, world, (1, GRACE))
    events = blocked_then(lab, world, (1, GRACE + 1))
    assert (kinds(events), events[0].detail["reason"]) == (["yield_cancelled"], "off_path")
    assert not blocked_then(lab, world, (1, GRACE), (0, 1), (1, GRACE)), "the second begins again"


@pytest.mark.parametrize(("emv_s", "reasons"), [(73.9, []), (78.9, []), (79.4, ["off_path"])])
def test_the_emv_is_on_the_path_until_its_front_is_ahead_of_the_civilians_front(lab, world, emv_s, reasons):
    """The civilian's front is at 82.375 m, the EMV's is 3.25 m ahead of its centre: ahead of it from 79.125 m on."""
    cars = [lab.Car(2, 0, 80, 5, (0,), left=-1.0), lab.Car(3, 1, 81, 5, (0,))]
    state, _, _ = steps(world, [emv_at(lab), *cars])
    _, _, events = steps(world, [emv_at(lab, emv_s), *cars], GRACE + 5, state, 1)
    assert [event.detail["reason"] for event in events if event.actor_id == 2] == reasons


@pytest.mark.parametrize(
    ("lane", "s_m", "route", "reasons"),
    [(3, 24.0, (0, 2), []), (4, 10.0, (2,), []), (7, 40.0, (4,), ["off_path"])],
    ids=["on the same junction", "behind it", "on the road to the right"],
)
def test_the_emv_on_a_junction_still_comes_up_to_those_ahead_there_and_behind_it(lab, lane, s_m, route, reasons):
    """The routes of both begin with the edge before the junction, which the EMV has left."""
    held = replace(UNIT, phase=Mode.YIELD_HOLD, side=1)
    cars = [lab.Car(1, 2, 2.0, 5, (0, 2), AMBULANCE), lab.Car(2, lane, s_m, 0, route)]
    world = lab.world_of(lab.junction_road(), lab.L3)
    state = replace(steps(world, cars)[0], units={2: held})
    _, _, events = steps(world, cars, GRACE + 2, state, 1)
    assert [event.detail["reason"] for event in events if event.kind.name == "YIELD_CANCELLED"] == reasons


def test_a_yield_with_a_free_lane_starts_although_the_emv_has_just_left_the_lane(lab, world):
    cars = [lab.Car(2, 0, 80, 5, (0,)), lab.Car(3, 1, 81, 5, (0,))]
    state, _, _ = steps(world, [emv_at(lab), *cars])
    _, _, events = steps(world, [emv_at(lab, lane=1), cars[0]], 1, state, 1)
    assert kinds(events) == ["yield_started"]


def test_the_next_turn_is_indicated_on_from_the_reaction_and_while_the_lane_is_kept(lab, world):
    slow = replace(world, preset=world.preset.for_scenario(40.0, 1.0, 1.0))
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))]
    turn = {2: int(Lights.INDICATOR_RIGHT | Lights.BRAKE)}
    _, commands, _ = steps(slow, cars, lights=turn)
    assert (modes(commands), commands.lights.tolist()) == ({2: Mode.YIELD_REACTING}, [Lights.INDICATOR_RIGHT])
    state, commands, _ = steps(world, cars, lights=turn)
    assert commands.lights.tolist() == [Lights.INDICATOR_LEFT], "towards the lane that it changes to"
    _, commands, _ = steps(world, [cars[0], lab.Car(2, 1, 90, 3, (0,))], 1, state, 1, lights=turn)
    assert (modes(commands), commands.lights.tolist()) == ({2: Mode.YIELD_KEEP_LANE}, [Lights.INDICATOR_RIGHT])


@pytest.fixture
def state(lab, world):
    return steps(world, [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))])[0]


def test_completed_in_the_target_lane_then_kept_until_released(lab, world, state):
    there = [emv_at(lab), lab.Car(2, 1, 90, 3, (0,))]
    state, commands, events = steps(world, there, 1, state, 1)
    assert kinds(events) == ["yield_completed"]
    assert (modes(commands), commands.owner.tolist()) == ({2: Mode.YIELD_KEEP_LANE}, [Owner.SUMO])
    state, commands, events = steps(world, there, 5, state, 2)
    assert modes(commands) == {2: Mode.YIELD_KEEP_LANE}
    assert not events
    state, commands, events = steps(world, [emv_at(lab, 98.0), there[1]], 1, state, 7)
    assert kinds(events) == ["yield_released"]
    assert len(commands) == 0
    assert not state.units


def test_yields_again_when_the_emv_follows_into_the_new_lane(lab, world, state):
    state, _, _ = steps(world, [emv_at(lab), lab.Car(2, 1, 90, 3, (0,))], 1, state, 1)
    _, _, events = steps(world, [emv_at(lab, 60.0, lane=1), lab.Car(2, 1, 90, 3, (0,))], 60, state, 2)
    assert kinds(events)[:3] == ["yield_requested", "yield_deferred", "yield_started"]
    assert [event.detail.get("reason") for event in events[:2]] == ["emv_followed", "cooldown"]
    assert events[2].step == world.cooldown_steps


def test_kept_lane_is_left_a_second_after_the_emv_took_another_road_without_interruption(lab):
    """The civilian is past the junction; the EMV before it will turn right, and then straight on again."""
    world = lab.world_of(lab.junction_road(), lab.L2)
    there = lab.Car(2, 5, 5, 3, (2,))
    ahead, away = ((lab.Car(1, 0, 140, 5, route, AMBULANCE), there) for route in ((0, 2), (0, 4)))
    first = [ahead[0], lab.Car(2, 4, 5, 3, (2,))]
    for interruption, reasons in ((ahead, []), (away, ["emv_gone"])):
        state, _, _ = steps(world, first)
        state, _, events = steps(world, ahead, 1, state, 1)
        assert kinds(events) == ["yield_completed"]
        state, _, events = steps(world, away, GRACE, state, 2)
        assert not events
        state, _, events = steps(world, interruption, 1, state, 2 + GRACE)
        more = steps(world, away, GRACE, state, 3 + GRACE)[2]
        assert [event.detail["reason"] for event in (*events, *more)] == reasons


def test_removed_civilian_is_forgotten(lab, world, state):
    gone = replace(
        lab.traffic_of(world.network, [emv_at(lab)], step=1, spawn=False), removed=np.array([2], dtype=np.uint32)
    )
    state, commands = step_yield(state, gone, world)
    assert not state.units
    assert len(commands) == 0


def test_a_civilian_off_all_lanes_is_not_on_the_emvs_road(lab, world, state):
    """It has changed lanes and then leaves the road; a second later it is released."""
    there = [emv_at(lab), lab.Car(2, 1, 90, 3, (0,))]
    state, _, _ = steps(world, there, 1, state, 1)
    reasons = []
    for step in range(2, 3 + GRACE):
        observed = lab.traffic_of(world.network, there, step=step, spawn=False)
        lane = np.where(observed.actor_id == 2, -1, observed.lane).astype(np.int32)
        state, commands = step_yield(state, replace(observed, lane=lane), world)
        reasons += [(step, event.detail["reason"]) for event in commands.events]
    assert reasons == [(2 + GRACE, "emv_gone")]


def test_with_two_emvs_everybody_yields_to_the_one_that_comes(lab, world):
    """One in each lane; a civilian ahead of each. What one does changes nothing for the other's civilian."""
    second = lab.Car(9, 1, 40, 10, (0,), ActorClass.FIRE_TRUCK)
    cars = [emv_at(lab), second, lab.Car(2, 0, 80, 5, (0,)), lab.Car(3, 1, 75, 5, (0,))]
    state, _, events = steps(world, cars)
    asked = {event.actor_id: event.other_id for event in events if event.kind.value == "yield_requested"}
    assert asked == {2: 1, 3: 9}
    state, _, events = steps(world, [emv_at(lab, 110.0), second, *cars[2:]], 1, state, 1)
    assert {event.actor_id for event in events if event.kind.value in {"yield_cancelled", "yield_released"}} == {2}
    assert list(state.units) == [3]


def second_at(lab, s, lane=0, speed=10.0):
    """Another EMV."""
    return lab.Car(9, lane, s, speed, (0,), AMBULANCE)


@pytest.mark.parametrize(("second_s", "stays"), [(20.0, True), (1.0, False)], ids=["within hearing", "beyond"])
def test_a_new_lane_is_kept_until_the_last_emv_within_hearing_has_passed(lab, world, state, second_s, stays):
    """The civilian's rear is at 87.6 m; drivers in a queue hear an EMV up to 80 m behind them."""
    there = lab.Car(2, 1, 90, 3, (0,))
    state, _, _ = steps(world, [emv_at(lab), there, second_at(lab, 1.0)], 1, state, 0)
    passed = [emv_at(lab, 98.0), there]
    state, _, events = steps(world, [*passed, second_at(lab, second_s)], 1, state, 2)
    assert (2 in state.units) is stays
    assert [event.other_id for event in events if event.kind.value == "yield_requested"] == [9] * stays
    if stays:
        state, _, events = steps(world, [*passed, second_at(lab, 70.0)], 1, state, 3)
        assert not events
        state, _, events = steps(world, [*passed, second_at(lab, 98.0, lane=1)], 1, state, 4)
        assert kinds(events) == ["yield_released"]


@pytest.mark.parametrize("level", ["L2", "L3"])
@pytest.mark.parametrize(("first_s", "second_s", "asked"), [(50.0, 60.0, 9), (60.0, 50.0, 1)])
def test_of_two_emvs_that_come_drivers_answer_the_nearer_one(lab, straight, level, first_s, second_s, asked):
    world = lab.world_of(straight, getattr(lab, level))
    cars = [emv_at(lab, first_s), lab.Car(2, 0, 85, 5, (0,)), second_at(lab, second_s)]
    state, _, _ = steps(world, cars)
    assert state.units[2].emv_id == asked


def holding(lab, network, *cars):
    """The second civilian has pulled over for the first EMV and holds; all cars are known."""
    return YieldState({2: UNIT}, actors=ActorTable.empty().updated(lab.traffic_of(network, cars)))


@pytest.mark.parametrize("second_s", [50.0, 9.0])
def test_who_answers_another_emv_hears_at_least_as_far_as_before_and_counts_anew(lab, straight, second_s):
    there, passed, second = lab.Car(2, 0, 80, 0, (0,), left=-0.7), emv_at(lab, 120.0), second_at(lab, second_s)
    state = holding(lab, straight, passed, there, second)
    state = replace(state, units={2: replace(UNIT, off_path_steps=7)})
    state, _, _ = steps(lab.world_of(straight, lab.L3), [passed, there, second], 1, state, 1)
    unit = state.units[2]
    assert (unit.emv_id, unit.off_path_steps) == (9, 0)
    assert unit.driver.response_distance_m == pytest.approx(max(40.0, 80.0 - second_s - 0.5 * (6.5 + 4.75)))


def test_who_has_pulled_over_holds_until_the_last_emv_within_hearing_has_passed(lab, straight):
    """The first EMV has passed. The civilian's rear is at 77.6 m, the second EMV's front 65 m behind it."""
    world = lab.world_of(straight, lab.L3)
    there, passed = lab.Car(2, 0, 80, 0, (0,), left=-0.7), emv_at(lab, 120.0)
    state = holding(lab, straight, passed, there, second_at(lab, 9.0))
    state, commands, events = steps(world, [passed, there, second_at(lab, 9.0)], 1, state, 1)
    assert (modes(commands), state.units[2].emv_id) == ({2: Mode.YIELD_HOLD}, 9)
    assert [event.detail["reason"] for event in events] == ["another_emv"]
    state, commands, events = steps(world, [passed, there, second_at(lab, 60.0)], 20, state, 2)
    assert modes(commands) == {2: Mode.YIELD_HOLD}
    assert not events
    state, commands, _ = steps(world, [passed, there, second_at(lab, 120.0)], 1, state, 22)
    assert modes(commands) == {2: Mode.REJOIN}


def test_who_is_on_the_way_back_and_hears_the_next_emv_pulls_over_again_from_there(lab, straight):
    world = lab.world_of(straight, lab.L3)
    passed, far = emv_at(lab, 200.0), second_at(lab, 5.0)
    there, moved = lab.Car(2, 0, 100, 0, (0,), left=-0.7), lab.Car(2, 0, 105, 2, (0,), left=-0.5)
    state = holding(lab, straight, passed, there, far)
    state, commands, _ = steps(world, [passed, there, far], 1, state, 1)
    assert modes(commands) == {2: Mode.REJOIN}
    state, commands, events = steps(world, [passed, moved, second_at(lab, 60.0)], 1, state, 2)
    assert (modes(commands), commands.owner.tolist()) == ({2: Mode.YIELD_PULL_OVER}, [Owner.ROS])
    assert kinds(events) == ["yield_requested", "yield_started"]
    unit = state.units[2]
    assert (unit.emv_id, unit.side) == (9, -1)
    assert unit.navigator.path.curve.points[0] == pytest.approx([105.0, -0.5]), "it begins where the vehicle is"


@pytest.mark.parametrize(("speed", "mode"), [(0.0, Mode.YIELD_HOLD), (1.0, Mode.REJOIN)])
def test_who_cannot_pull_over_again_stays_where_it_stands_and_goes_on_where_it_moves(lab, straight, speed, mode):
    """A vehicle stands right ahead."""
    world = lab.world_of(straight, lab.L3)
    passed, far, ahead = emv_at(lab, 200.0), second_at(lab, 5.0), lab.Car(3, 0, 105.0, 0, (0,))
    there = lab.Car(2, 0, 100, 0, (0,), left=-0.7)
    state = holding(lab, straight, passed, there, ahead, far)
    state, commands, _ = steps(world, [passed, there, ahead, far], 1, state, 1)
    assert modes(commands)[2] is Mode.REJOIN
    cars = [passed, replace(there, speed=speed), ahead, second_at(lab, 60.0)]
    state, commands, _ = steps(world, cars, 1, state, 2)
    assert (modes(commands)[2], state.units[2].partial) == (mode, mode is Mode.YIELD_HOLD)


def view_of(lab, cars, network=None):
    network = network or lab.straight_road()
    return lab.view(network, lab.L2, cars)


def test_way_is_along_the_emvs_path(lab, junction):
    cars = [
        *[lab.Car(1, 0, 100, 8, (0, 4), AMBULANCE), lab.Car(2, 7, 20, 5, (0, 4))],
        *[lab.Car(3, 1, 130, 5, (0, 2)), lab.Car(4, 4, 20, 5, (2,))],
    ]
    view = view_of(lab, cars, junction)
    road = EmvRoad.ahead_of(view.ego(0), None)
    way = way_from_emv_m(view, 0, road.lane_start_m)
    assert way[1] == pytest.approx(50.0 + junction.lanes[6].length_m + 20.0 - 4.75 / 2.0 - 6.5 / 2.0, abs=0.05)
    assert np.isinf(way[2:]).all()
    beside = way_from_emv_m(view, 0, road.road_start_m)
    assert beside[2] == pytest.approx(30.0 - 4.75 / 2.0 - 6.5 / 2.0, abs=0.01)
    assert np.isinf(beside[3])
    assert road.on_road[[0, 4]].all()
    assert not road.on_road[2]


def test_road_is_kept_while_lane_and_route_stay(lab):
    view = view_of(lab, [lab.Car(1, 0, 100, 8, (0,), AMBULANCE)])
    road = EmvRoad.ahead_of(view.ego(0), None)
    assert EmvRoad.ahead_of(view.ego(0), road) is road
    assert EmvRoad.ahead_of(view_of(lab, [lab.Car(1, 1, 100, 8, (0,), AMBULANCE)]).ego(0), road) is not road


def test_between_both_distances_the_members_alone_belong_to_the_region(lab):
    """Actors 2, 5 and 7 are 45 m away on every side, 3 and the EMV's fellow 4 are near, 8 is just beyond 50 m."""
    cars = [lab.Car(1, 0, 150, 8, (0,), AMBULANCE), lab.Car(4, 1, 140, 8, (0,), AMBULANCE)]
    cars += [
        lab.Car(actor, 0, place, 2, (0,)) for actor, place in ((2, 190.1), (3, 189.9), (5, 100), (7, 195.5), (8, 200.1))
    ]
    view = view_of(lab, cars)

    def members(*before):
        return region_members(view.seen, 0, np.array(before, dtype=np.uint32), PAPER_CONSTANTS).tolist()

    assert (members(), members(2), members(5, 6)) == ([3], [2, 3], [3, 5])
    assert (members(1, 4, 7, 9), members(6, 8), members(0, 0, 0, 2)) == ([3, 7], [3], [2, 3])


def test_the_edge_of_the_emv_and_the_two_before_it_are_still_its_road(lab):
    road = lab.RoadBuilder()
    for place in range(5):
        road.edge([[100.0 * place, 0.0], [100.0 * place + 100.0, 0.0]], 1, (f"N{place}", f"N{place + 1}"))
    for place in range(4):
        road.connect(place, place + 1)
    network = road.built()
    before = None
    for edge in range(5):
        car = lab.Car(1, edge, 10.0, 8, tuple(range(edge, 5)), AMBULANCE)
        before = EmvRoad.ahead_of(view_of(lab, [car], network).ego(0), before)
        assert before.left_edges == tuple(range(edge, max(edge - 3, -1), -1))
        behind = [place for place in range(edge) if before.on_road[place]]
        assert behind == [place for place in (edge - 2, edge - 1) if place >= 0]
