"""What the simulation makes of SUMO's answers: on built-in maps, and at one step with a stand-in for SUMO."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import libsumo
import numpy as np
import pytest
from traffic_helpers import load_map, plan_s2, states_of

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import EpisodeError
from siren_ros.simulation.roads.maps.map_compiler import CompiledMap
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.roads.routing import path_centre, route_path
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic import simulation as simulation_module
from siren_ros.simulation.traffic.demand.plan import TrafficPlan
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.traffic.sumo.driving_corrections import LaneContinuity
from siren_ros.simulation.traffic.sumo.population import SumoPopulation
from siren_ros.simulation.traffic.sumo.readings import emv_advice
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    TRAFFIC_STATE_DTYPES,
    ActorStates,
    Event,
    EventKind,
    Lights,
    Mode,
    Owner,
    TrafficFlags,
    TrafficState,
    rows_of_ids,
)

Town = tuple[CompiledMap, RoadNetwork, TrafficPlan]
"""A map, the same parsed, and the plan of an episode of S2 on it."""
EMV_ID = 1
SUMO_JUMP_M = 0.3
"""SUMO's own motion is not continuous where lanes bend; the simulated vehicle smooths it."""


@pytest.fixture(scope="module")
def town() -> Town:
    compiled, network = load_map(None)
    return compiled, network, plan_s2(network)[0]


@pytest.fixture
def sumo(town: Town) -> Iterator[SumoSimulation]:
    with SumoSimulation(*town, EmergencyLevel.L2) as simulation:
        yield simulation


def pose(actor_id: int, place: Any, yaw: float, speed_mps: float) -> dict[str, float]:
    x, y = map(float, place)
    motion = {"vx_mps": speed_mps * np.cos(yaw), "vy_mps": speed_mps * np.sin(yaw)}
    return {"actor_id": actor_id, "x_m": x, "y_m": y, "yaw_rad": yaw, **motion}


class Follower:
    """Drives an actor along a curve at a speed, sideways by an offset: the simulated world in its simplest form."""

    def __init__(self, actor_id: int, path: Polyline, state: TrafficState) -> None:
        row = int(np.flatnonzero(state.actor_id == actor_id)[0])
        self.actor_id = actor_id
        self.path = path
        self.arc_m = float(path.project([state.sumo_x_m[row], state.sumo_y_m[row]])[0])
        self.speed_mps = float(state.sumo_speed_mps[row])
        self.left_m = float(path.project([state.sumo_x_m[row], state.sumo_y_m[row]])[1])

    def row(self, owner: Owner = Owner.ROS, mode: Mode = Mode.ROUTE_FOLLOW) -> dict[str, float]:
        place, yaw = self.path.offset_points(self.arc_m, self.left_m), float(self.path.heading_rad(self.arc_m))
        return {**pose(self.actor_id, place, yaw, self.speed_mps), "owner": int(owner), "mode": int(mode)}

    def advance(self, accel_mps2: float = 0.0, left_mps: float = 0.0, top_mps: float = 12.0) -> None:
        self.arc_m += self.speed_mps * STEP_S
        self.left_m += left_mps * STEP_S
        self.speed_mps = min(max(self.speed_mps + accel_mps2 * STEP_S, 0.0), top_mps)


def test_sumo_s_vehicle_is_brought_back_to_a_simulated_one_that_cannot_follow(
    sumo: SumoSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    corrected, correct = list[set[str]](), LaneContinuity.correct
    monkeypatch.setattr(LaneContinuity, "correct", lambda *given: corrected.append(given[2]) or correct(*given))
    state = sumo.step(0, None)
    names = {seen.actor_id: seen.name for seen in state.spawned}
    for step in range(1, 40):
        state = sumo.step(step, following(state))
    on_lane = np.flatnonzero((state.lane != NO_LANE) & (state.lane_position_m > 15.0) & (state.sumo_speed_mps > 3.0))
    row = int(on_lane[-1])
    actor = int(state.actor_id[row])
    lagging = following(state, actor, 4.0)
    after = sumo.step(40, lagging)
    (event,) = [event for event in after.events if event.kind is EventKind.REALIGNED]
    assert event.actor_id == actor
    assert names[actor] in corrected[-1], "it is not corrected again"
    assert event.detail["residual_m"] == pytest.approx(4.0)
    assert not [event for event in after.events if event.kind is EventKind.TELEPORT]
    now, then = int(rows_of_ids(after.actor_id, np.array([actor], np.uint32))[0]), row
    assert after.owner[now] == Owner.SUMO
    # It is put where the simulated one is at this step, and SUMO drives the step from there.
    ahead_m = 2.0 * lagging.vx_mps[then] * STEP_S, 2.0 * lagging.vy_mps[then] * STEP_S
    assert after.sumo_x_m[now] == pytest.approx(lagging.x_m[then] + ahead_m[0], abs=0.15)
    assert after.sumo_y_m[now] == pytest.approx(lagging.y_m[then] + ahead_m[1], abs=0.15)
    for step in range(41, 60):
        after = sumo.step(step, following(after))
        assert not [event for event in after.events if event.kind in {EventKind.REALIGNED, EventKind.TELEPORT}]
    assert after.sumo_speed_mps[rows_of_ids(after.actor_id, np.array([actor], np.uint32))[0]] > 1.0, "SUMO drives on"


def following(state: TrafficState, lagging: int = 0, by_m: float = 0.0) -> ActorStates:
    """Simulated vehicles at SUMO's poses; one of them lags behind."""
    rows = []
    for row, actor in enumerate(state.actor_id.tolist()):
        yaw, speed = float(state.sumo_yaw_rad[row]), float(state.sumo_speed_mps[row])
        behind = by_m if actor == lagging else 0.0
        place = state.sumo_x_m[row] - behind * np.cos(yaw), state.sumo_y_m[row] - behind * np.sin(yaw)
        rows.append({**pose(actor, place, yaw, speed), "residual_m": behind, "owner": int(Owner.SUMO)})
    return states_of(state.step, rows)


def path_of_emv(network: RoadNetwork, plan: TrafficPlan) -> Polyline:
    emv = plan.emvs[0]
    edges = [network.edge_by_id[edge].index for edge in emv.route]
    return path_centre(network, route_path(network, edges, emv.spot.lane))


def test_standing_emv_is_held_while_it_creeps_by_millimetres(sumo: SumoSimulation, town: Town) -> None:
    _, network, plan = town
    state = sumo.step(0, None)
    follower = Follower(EMV_ID, path_of_emv(network, plan), state)
    follower.speed_mps = 0.0
    lane = state.lane[0]
    places = set()
    for step in range(1, 60):
        row = follower.row()
        state = sumo.step(step, states_of(step - 1, [row]))
        places.add((float(state.sumo_x_m[0]), float(state.sumo_y_m[0])))
        assert state.lane[0] == lane
        follower.arc_m -= 0.0001
    assert len(places) == 1


def test_release_goes_on_from_the_pose_at_the_speed(sumo: SumoSimulation, town: Town) -> None:
    _, network, plan = town
    state = sumo.step(0, None)
    row = next(i for i, actor in enumerate(state.spawned) if actor.name == "platoon1")
    actor = state.spawned[row]
    follower = Follower(actor.actor_id, path_of_emv(network, plan), state)
    for step in range(1, 41):
        follower.advance(accel_mps2=-1.0, left_mps=-0.6)
        state = sumo.step(step, states_of(step - 1, [follower.row()]))
    here = rows_of_ids(state.actor_id, np.array([actor.actor_id], dtype=np.uint32))[0]
    x, y = state.sumo_x_m[here], state.sumo_y_m[here]
    for step in range(41, 80):
        follower_row = follower.row(owner=Owner.SUMO, mode=Mode.NOMINAL)
        state = sumo.step(step, states_of(step - 1, [follower_row]))
        here = rows_of_ids(state.actor_id, np.array([actor.actor_id], dtype=np.uint32))[0]
        moved = float(np.hypot(state.sumo_x_m[here] - x, state.sumo_y_m[here] - y))
        if step == 41:
            assert moved == pytest.approx(follower.speed_mps * STEP_S, abs=0.05)
            assert state.sumo_speed_mps[here] == pytest.approx(follower.speed_mps, abs=0.3)
            assert state.owner[here] == Owner.SUMO
        assert moved <= state.sumo_speed_mps[here] * STEP_S + 0.05
        x, y = state.sumo_x_m[here], state.sumo_y_m[here]


def run(town: Town, level: EmergencyLevel, steps: int) -> list[TrafficState]:
    with SumoSimulation(*town, level) as simulation:
        return [simulation.step(step, None if step == 0 else ActorStates.empty(step - 1)) for step in range(steps)]


def test_two_runs_are_identical(town: Town) -> None:
    for first, second in zip(run(town, EmergencyLevel.L3, 60), run(town, EmergencyLevel.L3, 60), strict=True):
        for name in TRAFFIC_STATE_DTYPES:
            assert np.array_equal(getattr(first, name), getattr(second, name)), name
        others = ("spawned", "emvs", "signals", "events")
        assert all(getattr(first, name) == getattr(second, name) for name in others)


def test_traffic_keeps_its_volume_and_moves_without_jumps_for_20_seconds(town: Town) -> None:
    """Nor does SUMO push anybody aside: who makes way, and how, is the yield manager's."""
    plan = town[2]
    states = run(town, EmergencyLevel.L3, 400)
    kinds = {event.kind for state in states for event in state.events}
    assert EventKind.TELEPORT not in kinds
    for last, state in pairwise(states):
        assert state.actor_id.tolist() == sorted(state.actor_id.tolist())
        assert plan.civilians - 3 <= np.count_nonzero(state.actor_id != EMV_ID) <= plan.civilians
        rows = rows_of_ids(last.actor_id, state.actor_id)
        stayed = rows >= 0
        moved = np.hypot(state.sumo_x_m - last.sumo_x_m[rows], state.sumo_y_m - last.sumo_y_m[rows])[stayed]
        assert np.all(moved <= state.sumo_speed_mps[stayed] * STEP_S + SUMO_JUMP_M)
    assert np.mean([float(state.sumo_speed_mps.mean()) for state in states]) > 2.0
    heard = states[160]
    assert heard.emvs[0].rescue_count > 0
    reacting = (heard.flags & TrafficFlags.RESCUE_LANE) != 0
    assert np.median(np.abs(heard.lateral_offset_m[reacting])) < 0.3


def test_first_state_has_emv_platoon_and_siren(town: Town) -> None:
    plan = town[2]
    state = run(town, EmergencyLevel.L2, 1)[0]
    assert state.spawned[0].is_emv
    assert state.spawned[0].actor_id == EMV_ID
    assert len(state.spawned) == plan.civilians + 1
    assert state.lane[0] == plan.emvs[0].spot.lane
    assert state.lane_position_m[0] == pytest.approx(plan.emvs[0].spot.front_m, abs=1.0)
    assert state.sumo_speed_mps[0] == pytest.approx(plan.emvs[0].spot.speed_mps, abs=0.5)
    both = Lights.SIREN | Lights.BEACON
    assert np.flatnonzero(state.lights & both).tolist() == [0]
    assert state.lights[0] & both == both
    reacting = state.actor_id[(state.flags & TrafficFlags.RESCUE_LANE) != 0]
    names = {actor.actor_id: actor.name for actor in state.spawned}
    assert "platoon0" in {names[int(actor_id)] for actor_id in reacting}
    assert state.emvs[0].rescue_count == len(reacting)
    assert names[state.emvs[0].leader_id] == "platoon0"
    assert state.emvs[0].leader_gap_m == pytest.approx(22.0, abs=1.0)


@pytest.mark.parametrize("level", [EmergencyLevel.L0, EmergencyLevel.L1])
def test_without_siren_nobody_reacts(town: Town, level: EmergencyLevel) -> None:
    states = run(town, level, 10)
    assert all(not np.any(state.flags & TrafficFlags.RESCUE_LANE) for state in states)
    assert all(not state.lights[0] & (Lights.SIREN | Lights.BEACON) for state in states)


def test_after_a_failed_start_another_simulation_can_start_and_steps_come_in_order_in_one_at_a_time(town: Town) -> None:
    compiled, network, plan = town
    astray = replace(plan, background=(replace(plan.background[0], route=("no_such_edge",)), *plan.background[1:]))
    with pytest.raises(EpisodeError, match="no_such_edge"):
        SumoSimulation(compiled, network, astray, EmergencyLevel.L2)
    with SumoSimulation(compiled, network, plan, EmergencyLevel.L2) as simulation:
        assert len(simulation.step(0, None).actor_id) > 0
        with pytest.raises(EpisodeError, match="step 3"):
            simulation.step(3, None)
        with pytest.raises(EpisodeError, match="already running"):
            SumoSimulation(*town, EmergencyLevel.L2)


def test_mirrored_emv_stays_where_it_is_put_for_25_seconds(sumo: SumoSimulation, town: Town) -> None:
    """Its pose is the simulated one; the others' are SUMO's. Its route ahead begins on the lane that it was put on."""
    _, network, plan = town
    state = sumo.step(0, None)
    follower = Follower(EMV_ID, path_of_emv(network, plan), state)
    events, speeds_mps, off_m = list[Event](), list[float](), list[float]()
    for step in range(1, 500):
        row = follower.row()
        state = sumo.step(step, states_of(step - 1, [row]))
        off_x_m = state.sumo_x_m[0] - row["x_m"] - row["vx_mps"] * STEP_S
        off_y_m = state.sumo_y_m[0] - row["y_m"] - row["vy_mps"] * STEP_S
        off_m.append(float(np.hypot(off_x_m, off_y_m)))
        speeds_mps.append(float(state.speed_mps[0]))
        assert (state.x_m[0], state.yaw_rad[0]) == (row["x_m"], row["yaw_rad"])
        assert speeds_mps[-1] == pytest.approx(follower.speed_mps)
        assert (state.x_m[1], state.yaw_rad[1]) == (state.sumo_x_m[1], state.sumo_yaw_rad[1])
        assert state.owner.tolist() == [Owner.ROS] + [Owner.SUMO] * (len(state.owner) - 1)
        assert state.lane[0] != NO_LANE
        assert abs(state.lateral_offset_m[0]) < network.lanes[state.lane[0]].width_m / 2.0 + 0.2
        for here in (0, 1):
            edge = network.edges[network.lanes[state.lane[here]].edge]
            assert edge.internal or state.route_of_row(here)[0] == edge.index
        events += [event for event in state.events if event.actor_id == EMV_ID]
        follower.advance(accel_mps2=1.0)
    assert max(off_m) < 0.6
    assert np.mean(np.array(off_m) > 1e-6) < 0.03, "only where two pieces of a road are joined"
    crossed = next(event for event in events if event.kind is EventKind.STOP_LINE_CROSSED)
    assert crossed.detail["signal_state"] in set("rygGuso")
    assert crossed.detail["speed_mps"] == speeds_mps[crossed.step - 1]
    assert any(event.kind is EventKind.JUNCTION_LEFT for event in events)


def test_a_stop_line_that_is_passed_off_the_road_is_crossed_and_the_route_is_kept(
    sumo: SumoSimulation, town: Town
) -> None:
    """From the approach over the verge onto the path across; who comes back before has crossed nothing."""
    _, network, plan = town
    state = sumo.step(0, None)
    assert plan.signal is not None
    link = plan.signal.signal_id, plan.signal.link
    way = next(way for way in network.connections if (way.signal_id, way.signal_link) == link)
    follower, events = Follower(EMV_ID, path_of_emv(network, plan), state), []
    line_m = float(follower.path.project(network.lanes[way.from_lane].centre.points[-1])[0])
    places = (-9.0, 0.0), (-8.0, 30.0), (-7.0, 0.0), (-4.0, 30.0), (4.0, 30.0), (6.0, 0.0)
    for step, (follower.arc_m, follower.left_m) in enumerate(((line_m + m, left_m) for m, left_m in places), start=1):
        state = sumo.step(step, states_of(step - 1, [follower.row()]))
        assert (state.lane[0] == NO_LANE) == (follower.left_m > 0.0)
        assert state.route_of_row(0)[0] == network.lanes[way.from_lane].edge
        events += [(step, event.kind) for event in state.events if event.actor_id == EMV_ID]
    assert events == [(6, EventKind.STOP_LINE_CROSSED)]


def test_a_vehicle_of_sumos_crosses_a_line_with_sumos_speed_and_keeps_its_place_on_its_planned_route(
    sumo: SumoSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where SUMO has given it another route, the number counts along that one."""
    state, crossed = sumo.step(0, None), list[float]()
    ahead = {actor_id: state.route_of_row(row).tolist() for row, actor_id in enumerate(state.actor_id.tolist())}
    monkeypatch.setattr(libsumo.vehicle, "getRouteID", lambda _: "another")
    for step in range(1, 120):
        slow = following(state)
        state = sumo.step(step, replace(slow, vx_mps=0.5 * slow.vx_mps, vy_mps=0.5 * slow.vy_mps))
        for row, actor_id in enumerate(state.actor_id.tolist()):
            assert state.route_of_row(row).tolist() == ahead.setdefault(actor_id, state.route_of_row(row).tolist())
        for event in state.events:
            row = state.actor_id.tolist().index(event.actor_id)
            if event.kind is EventKind.STOP_LINE_CROSSED and state.sumo_speed_mps[row] > 1.0:
                assert event.detail["speed_mps"] == state.sumo_speed_mps[row] != state.speed_mps[row]
                crossed.append(event.step)
    assert crossed


def test_who_makes_way_is_a_civilian_that_ros_drives_or_that_waits_for_a_gap_and_is_there(
    town: Town, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither the EMV nor the AV under test counts, which ROS drives for other reasons."""
    compiled, network, plan = town
    refills, ids, yields = list[Any](), {}, list[set[str]]()
    monkeypatch.setattr(simulation_module, "emv_advice", lambda *given: yields.append(given[2]) or emv_advice(*given))
    monkeypatch.setattr(SumoPopulation, "refill", lambda _, *given: refills.append(given))
    lacking = replace(plan, av="platoon0", civilians=plan.civilians + 1)
    with SumoSimulation(compiled, network, lacking, EmergencyLevel.L2) as simulation:
        refills.clear()
        state = simulation.step(0, None)
        ids |= {actor.name: actor.actor_id for actor in state.spawned}
        assert (ids["emv0"], ids["platoon0"]) == (1, 2)
        assert refills == []
        rows = {name: following(state).select(state.actor_id == number) for name, number in ids.items()}
        driven = [rows[name] for name in ("emv0", "platoon0", "platoon1")]

        def yielding(step: int, owner: Owner, mode: Mode) -> tuple[TrafficState, set[str]]:
            shown = [{name: getattr(row, name)[0] for name in ACTOR_STATE_DTYPES} for row in driven]
            for row in shown:
                row |= {"owner": owner, "mode": mode}
            state = simulation.step(step, states_of(step - 1, shown))
            return state, yields[-1]

        assert yielding(1, Owner.ROS, Mode.ROUTE_FOLLOW)[1] == {"platoon1"}
        points = [(float(rows["emv0"].x_m[0]), float(rows["emv0"].y_m[0]))]
        assert refills == [(points, plan.civilians + 1)], "replacements keep away from the EMVs alone"
        assert yielding(2, Owner.SUMO, Mode.YIELD_DEFERRED)[1] == {"platoon1"}
        libsumo.vehicle.unsubscribe("platoon1")
        libsumo.vehicle.remove("platoon1")
        monkeypatch.setattr(libsumo.simulation, "getArrivedIDList", lambda: ("platoon1", "never seen"))
        monkeypatch.setattr(libsumo.simulation, "getStartingTeleportIDList", lambda: ("platoon2", "never seen"))
        driven.pop()
        state, those = yielding(3, Owner.ROS, Mode.ROUTE_FOLLOW)
        assert (state.removed.tolist(), those) == ([ids["platoon1"]], set())
        assert ids["platoon1"] not in state.actor_id
        (event,) = [event for event in state.events if event.kind is EventKind.TELEPORT]
        assert (event.actor_id, event.detail) == (ids["platoon2"], {"reason": "sumo"})


def test_who_has_noticed_the_siren_changes_lanes_at_the_usual_pace_and_others_at_their_own(town: Town) -> None:
    compiled, network, plan = town
    slow = tuple(replace(car, lane_change_s=9.0) for car in plan.groups)
    with SumoSimulation(compiled, network, replace(plan, groups=slow), EmergencyLevel.L2) as simulation:
        state = simulation.step(0, None)
        ids = {actor.name: actor.actor_id for actor in state.spawned}
        shown = []
        for name, mode in (("platoon0", Mode.YIELD_REACTING), ("platoon1", Mode.NOMINAL), ("platoon2", Mode.REJOIN)):
            row = following(state).select(following(state).actor_id == ids[name])
            shown.append({field: getattr(row, field)[0] for field in ACTOR_STATE_DTYPES} | {"mode": mode})
        simulation.step(1, states_of(0, shown))
        usual_mps, own_mps = slow[0].driver.max_lateral_speed_mps, slow[0].sideways[0]
        limits_mps = [libsumo.vehicle.getMaxSpeedLat(name) for name in ("platoon0", "platoon1", "platoon2")]
        assert limits_mps == [usual_mps, pytest.approx(own_mps), pytest.approx(own_mps)]
        simulation.step(2, states_of(1, [{**row, "mode": Mode.NOMINAL} for row in shown]))
        assert libsumo.vehicle.getMaxSpeedLat("platoon0") == pytest.approx(own_mps), "the yield is over"
