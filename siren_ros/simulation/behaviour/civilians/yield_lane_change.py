"""L2: the feasible-yield lane change out of the EMV's lane (paper, Algorithm 2, ``npc_behavior_lvl = 1``).

A driver who finds no gap makes one, by falling back or drawing ahead in the present lane. After every yield the
navigator leads the vehicle back to its lane before SUMO takes over, and onto a junction only as far as the driver may
go. Civilians who keep a rescue lane open go back to their offset in it. SUMO drives them there
(``traffic.sumo.rules``), whether an EMV comes or not: they have made way before they hear it, so that they go on as
before.
"""

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import Final

from siren_ros.base.numerics.arrays import changed
from siren_ros.base.numerics.braking import braking_distance_m
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.simulation.behaviour.driving.driver_states import (
    STANDING_MPS,
    EmvView,
    Refusal,
    YieldStep,
    YieldUnit,
    aligned_within_rad,
    lane_of,
    release_reason,
    standing,
    yield_event,
)
from siren_ros.simulation.behaviour.driving.lane_change import (
    LaneChangeQuery,
    LaneGaps,
    assess,
    entered_lane,
    gaps_in_lane,
    lane_change_path,
    offset_in_lane,
    reaches_beside,
    refusal_of_gaps,
    sweeps_somebody,
)
from siren_ros.simulation.behaviour.driving.lane_path import connection_of_internal, lanes_along, neighbour_lane
from siren_ros.simulation.behaviour.driving.navigator import FULL_BRAKE, NavigatorState
from siren_ros.simulation.behaviour.driving.speed_mechanisms import navigate
from siren_ros.simulation.behaviour.driving.step_view import Ego
from siren_ros.simulation.behaviour.driving.tracked_path import (
    LaneEnd,
    LanePath,
    blend_length_m,
    on_reference,
    path_onto,
)
from siren_ros.simulation.conflicts.yielding import Rank, rank_of
from siren_ros.simulation.roads.road_network import NO_LANE, Connection
from siren_ros.simulation.roads.routing import road_lane_of
from siren_ros.simulation.scenario.driver_parameters import YieldConfig
from siren_ros.simulation.world.actors import MIRRORS_M, NO_ACTOR, Event, EventKind, Mode, TrafficFlags

GAP_REFUSALS: Final = frozenset({Refusal.BESIDE, Refusal.GAP_FRONT, Refusal.GAP_REAR})
_LET_IN_AT: Final = GAP_REFUSALS - {Refusal.GAP_FRONT}


class Seek(IntEnum):
    """How a driver creates a gap."""

    FALL_BACK = -1
    NOT = 0
    DRAW_AHEAD = 1


_SEEK_AGAIN_S: Final = 1.5
"""Time after which the driver thinks again whether to draw ahead or to fall back."""
_SEEK_ROOM_M: Final = 20.0
"""No gap is sought with less road than this before the next junction."""


def seek_gap(unit: YieldUnit, ego: Ego, refusal: Refusal) -> YieldStep:
    """One step of a deferred vehicle in its lane, towards a gap in the lane on its unit's ``side``.

    The vehicle must still be able to stop and change lanes before the next junction; elsewhere SUMO keeps driving.
    """
    unit, config, speed = _with_path(unit, ego), ego.civilian_driver, ego.speed_mps
    stop = braking_distance_m(speed * speed, config.driving.comfort_brake_mps2)
    lane = lane_of(unit, ego)
    target = neighbour_lane(ego.network, lane, unit.side)
    if unit.navigator.remaining_m < max(stop, _SEEK_ROOM_M) or target == NO_LANE:
        return YieldStep(changed(unit, navigator=NavigatorState(), seek=Seek.NOT))
    gaps = gaps_in_lane(ego, target)
    limit = config.yielding.seek_pace * ego.network.lanes[lane].speed_limit_mps
    again = (ego.step - unit.deferred_step) % steps_from_s(_SEEK_AGAIN_S) == 0
    if unit.seek == Seek.NOT or again:
        seek = choose_seek(gaps, gaps_in_lane(ego, lane), refusal, config.yielding, limit)
        unit = changed(unit, seek=seek, deferred=refusal.value)
    return drive(unit, ego, seek_speed_mps(Seek(unit.seek), gaps, config.yielding, limit))


_SEEK_FREE_M: Final = 15.0
"""A driver draws ahead of a vehicle behind only with this free distance in the own lane."""
_SEEK_GAIN_MPS: Final = 1.5
"""A driver draws ahead only of vehicles slower than the limit by this, so that the search gains a car's length."""


def choose_seek(gaps: LaneGaps, present: LaneGaps, refusal: Refusal, config: YieldConfig, limit_mps: float) -> Seek:
    """Decide whether to fall back or to draw ahead.

    The driver draws ahead of a vehicle that is behind, or alongside and further back, if there is space in the present
    lane (``present``) and the speed limit lets the driver gain on that vehicle. Ahead of one that is alongside and
    further ahead the way is longer: the driver has to gain as much as by falling back. In all other cases the driver
    falls back and lets the others pass. ``gaps`` are those in the adjacent lane.
    """
    if refusal is Refusal.BESIDE and gaps.front_m <= 0.0:
        gains = limit_mps - gaps.front_mps >= config.seek_speed_mps
    else:
        gains = refusal is not Refusal.GAP_FRONT and limit_mps - gaps.rear_mps >= _SEEK_GAIN_MPS
    return Seek.DRAW_AHEAD if gains and present.front_m > _SEEK_FREE_M else Seek.FALL_BACK


def seek_speed_mps(seek: Seek, gaps: LaneGaps, config: YieldConfig, limit_mps: float) -> float:
    """Speed while seeking: different from that of the vehicle in the way, between the least speed and the limit."""
    other = gaps.front_mps if gaps.front_m < gaps.rear_m else gaps.rear_mps
    if seek is Seek.DRAW_AHEAD:
        return min(other + config.seek_speed_mps, limit_mps)
    return min(max(other - config.seek_speed_mps, config.seek_least_mps), limit_mps)


def soon_free(seek: Seek, gaps: LaneGaps, speed_mps: float, margin_m: float, soon_s: float) -> bool:
    """Whether at present speeds the driver will soon have passed the vehicle in the way, or let it pass.

    ``margin_m`` is the free way that is needed to that vehicle, which is in the adjacent lane.
    """
    if seek is Seek.FALL_BACK:
        gap, gain, others = gaps.front_m, gaps.front_mps - speed_mps, gaps.rear_m
    else:
        gap, gain, others = gaps.rear_m, speed_mps - gaps.rear_mps, gaps.front_m
    return seek is not Seek.NOT and gap < margin_m <= gap + soon_s * gain and others > 0.0


def who_lets_in(unit: YieldUnit, ego: Ego) -> int:
    """Id of the driver who has to let the unit's one in: beside, or else behind, in the lane on the unit's side.

    ``NO_ACTOR`` for a driver who does not wait for a gap, or has no space to draw ahead and therefore falls back.
    """
    lane = lane_of(unit, ego)
    if unit.phase is not Mode.YIELD_DEFERRED or unit.deferred not in _LET_IN_AT or lane == NO_LANE:
        return NO_ACTOR
    target = neighbour_lane(ego.network, lane, unit.side)
    if target == NO_LANE or gaps_in_lane(ego, lane).front_m <= _SEEK_FREE_M:
        return NO_ACTOR
    gaps = gaps_in_lane(ego, target)
    return gaps.front_id if gaps.front_m <= 0.0 else gaps.rear_id


_SEEK_AHEAD_M: Final = 80.0
"""Length of the path of a vehicle that seeks a gap."""


def _with_path(unit: YieldUnit, ego: Ego) -> YieldUnit:
    if unit.navigator.path is not None or road_lane_of(ego.network, ego.lane) == NO_LANE:
        return unit
    reference = ego.line_along(ego.lane, _SEEK_AHEAD_M, 2.0, civilian=True, through_junctions=False)
    path = on_reference(reference, ego.navigator_config, stop_at_end=True, shorten_m=ego.half_length_m + 1.0)
    return changed(unit, navigator=NavigatorState().following(path, *ego.place))


def start_lane_change(unit: YieldUnit, ego: Ego) -> YieldStep:
    """Start the lane change if it is feasible, otherwise defer the yield.

    Of the feasible sides, one on which the vehicle can follow its route is preferred, then the side that SUMO's
    lane-change model wants (the paper's intent), then the right side. A deferred request is reconsidered at every
    step, once the cooldown since the vehicle's last forced lane change is over.
    """
    if ego.step - unit.change_step < ego.world.cooldown_steps:
        return defer(unit, ego, "cooldown")
    lane = lane_of(unit, ego)
    speed, intent = yield_speed_mps(ego, lane), intent_of(ego)
    queries = [LaneChangeQuery(ego, lane, side, speed, civilian=True) for side in (-1, 1)]
    verdicts = [(query, assess(query)) for query in queries]
    choices = [(query, verdict) for query, verdict in verdicts if isinstance(verdict, LanePath)]
    if not choices:
        return _wait_for_gap(unit, ego, [(query.side, r) for query, r in verdicts if isinstance(r, Refusal)])
    query, reference = min(choices, key=lambda choice: (choice[1].end is LaneEnd.ASTRAY, choice[0].side != intent))
    path = lane_change_path(query, reference, stop_at_end=True)
    navigator, side = NavigatorState().following(path, *ego.place), query.side
    phase = Mode.YIELD_LANE_CHANGE
    begun = {"change_step": ego.step, "deferred": "", "seek": 0, "stopped_steps": 0}
    unit = changed(unit, phase=phase, side=side, navigator=navigator, **begun)
    started = yield_event(unit, ego, EventKind.YIELD_STARTED, side=side, from_lane=lane, to_lane=query.target)
    return drive(unit, ego, speed).preceded_by(started)


def intent_of(ego: Ego) -> int:
    """Side to which SUMO's lane-change model wants to move a vehicle: +1 left, −1 right, 0 neither."""
    flags = int(ego.traffic.flags[ego.row])
    return bool(flags & TrafficFlags.WANTS_LEFT) - bool(flags & TrafficFlags.WANTS_RIGHT)


def yield_speed_mps(ego: Ego, lane: int) -> float:
    """Target speed of the lane change: the paper's, limited to the paper's share of the speed limit."""
    speeds = ego.world.speeds
    if lane == NO_LANE:
        return speeds.civilian_yield_lane_change_mps
    slowed = (1.0 - speeds.civilian_yield_speed_difference) * ego.network.lanes[lane].speed_limit_mps
    return min(speeds.civilian_yield_lane_change_mps, slowed)


def defer(unit: YieldUnit, ego: Ego, reason: str) -> YieldStep:
    """Defer the yield. An event is recorded when the deferral begins."""
    events: tuple[Event, ...] = ()
    if unit.phase is not Mode.YIELD_DEFERRED:
        events = (yield_event(unit, ego, EventKind.YIELD_DEFERRED, reason=reason),)
        unit = changed(unit, deferred_step=ego.step)
    waiting = changed(unit, phase=Mode.YIELD_DEFERRED, deferred=reason, navigator=NavigatorState(), seek=0)
    return YieldStep(waiting, None, events)


def _wait_for_gap(unit: YieldUnit, ego: Ego, refusals: list[tuple[int, Refusal]]) -> YieldStep:
    """Defer the yield. After a while the driver creates a gap, if only other vehicles are in the way.

    The driver tries for some seconds, and longer while the gap is nearly there. Then the driver goes on under SUMO at
    the pace of the road, and tries again later.
    """
    in_the_way = [(side, refusal) for side, refusal in refusals if refusal in GAP_REFUSALS]
    if not in_the_way:
        telling = (refusal for _, refusal in refusals if refusal is not Refusal.NO_LANE)
        return defer(unit, ego, next(telling, Refusal.NO_LANE).value)
    side, refusal = next(((s, r) for s, r in in_the_way if s == unit.side), in_the_way[0])
    if unit.phase is not Mode.YIELD_DEFERRED:
        return defer(changed(unit, side=side), ego, refusal.value)
    config = ego.civilian_driver.yielding
    waited = ego.step - unit.deferred_step - steps_from_s(config.seek_after_s)
    seeks, pauses = steps_from_s(config.seek_for_s), steps_from_s(config.seek_pause_s)
    if waited < 0 or (waited % (seeks + pauses) >= seeks and not _has_it_soon(unit, ego, side)):
        return YieldStep(changed(unit, side=side, deferred=refusal.value, navigator=NavigatorState(), seek=0))
    return seek_gap(changed(unit, side=side), ego, refusal)


_SEEK_SOON_S: Final = 2.0
"""A driver who will have the gap within this time continues to seek it."""


def _has_it_soon(unit: YieldUnit, ego: Ego, side: int) -> bool:
    target = neighbour_lane(ego.network, lane_of(unit, ego), side)
    if unit.seek == Seek.NOT or target == NO_LANE:
        return False
    gaps, change = gaps_in_lane(ego, target), ego.civilian_driver.lane_change
    margin = change.front_gap_m if unit.seek == Seek.FALL_BACK else change.rear_gap_m
    return soon_free(Seek(unit.seek), gaps, ego.speed_mps, margin, _SEEK_SOON_S)


def drive(unit: YieldUnit, ego: Ego, target_mps: float) -> YieldStep:
    """One step along the planner's path."""
    navigator, command, _ = navigate(unit, ego, target_mps, ego.world.civilian_navigator)
    return YieldStep(changed(unit, navigator=navigator), command)


def change_lane(unit: YieldUnit, ego: Ego, emv: EmvView) -> YieldStep:
    """Drive the lane change until the vehicle is completely in its new lane, or is released.

    A driver who stands on the way as long as a gap is sought goes back to the lane, and tries again.
    """
    lane = lane_of(unit, ego)
    if entered_lane(ego, lane):
        done = yield_event(unit, ego, EventKind.YIELD_COMPLETED, lane=lane)
        kept = changed(unit, phase=Mode.YIELD_KEEP_LANE, navigator=NavigatorState(), off_path_steps=0)
        return YieldStep(kept, None, (done,))
    unit = changed(unit, stopped_steps=unit.stopped_steps + 1 if standing(ego) else 0)
    ended = unit.navigator.done and unit.stopped_steps > 0
    blocked = unit.stopped_steps >= steps_from_s(ego.civilian_driver.yielding.seek_for_s)
    if release_reason(emv) or ended or blocked:
        reason = release_reason(emv) or ("lane_ended" if ended else "blocked")
        cancelled = yield_event(unit, ego, EventKind.YIELD_CANCELLED, reason=reason)
        navigator = NavigatorState() if reason == "blocked" else unit.navigator
        back = changed(unit, phase=Mode.REJOIN, navigator=navigator, stopped_steps=0)
        return rejoin(back, ego).preceded_by(cancelled)
    return drive(unit, ego, 0.0 if _others_come(ego, lane) else yield_speed_mps(ego, lane))


_GOES_ON_MPS: Final = 1.0
"""Faster drivers continue a lane change, because a stop half-way would block both lanes."""


def _others_come(ego: Ego, lane: int) -> bool:
    """Whether a driver who stopped on the way into a lane lets vehicles in it pass first."""
    speed = ego.speed_mps
    if speed > _GOES_ON_MPS or ego.lane == lane:
        return False
    refusal = refusal_of_gaps(gaps_in_lane(ego, lane), speed, speed, ego.civilian_driver.lane_change)
    return refusal in {Refusal.GAP_REAR, Refusal.BESIDE}


OFF_PATH_GRACE_S: Final = 1.0
"""Time off the EMV's path after which a yield that has not started is dropped."""
_FOLLOWED_S: Final = 1.0
"""Time for which the EMV must be in the new lane before the driver yields again."""


def keep_lane(unit: YieldUnit, ego: Ego, emv: EmvView) -> YieldStep:
    """Stay in the new lane under SUMO until released. Yield again if the EMV follows into that lane."""
    grace = steps_from_s(OFF_PATH_GRACE_S)
    strayed = not emv.on_road and unit.off_path_steps >= grace
    if release_reason(emv) or strayed:
        reason = release_reason(emv) or "emv_gone"
        return YieldStep(None, None, (yield_event(unit, ego, EventKind.YIELD_RELEASED, reason=reason),))
    followed = unit.in_lane_steps + 1 if emv.on_path else 0
    unit = changed(unit, in_lane_steps=followed, off_path_steps=0 if emv.on_road else unit.off_path_steps + 1)
    if followed < steps_from_s(_FOLLOWED_S):
        return YieldStep(unit)
    asked = yield_event(unit, ego, EventKind.YIELD_REQUESTED, reason="emv_followed")
    again = changed(unit, phase=Mode.YIELD_REACTING, react_step=ego.step, in_lane_steps=0, off_path_steps=0)
    return YieldStep(again, None, (asked,))


_REJOIN_OFFSET_M: Final = 0.3
"""A vehicle within this distance of the lane's centre line is back in its lane."""
_REJOIN_LENGTHS: Final = 1.5
"""Least length of the return in vehicle lengths: a long vehicle that turns in sharply comes too near to others that
return next to it."""
_REJOIN_AHEAD_M: Final = 60.0
"""Length of the path of a returning vehicle."""
LEAST_SIDEWAYS_M: Final = 6.0
"""Least length of a lateral move in the lane."""


def start_rejoin(unit: YieldUnit, ego: Ego) -> YieldStep:
    """Give the vehicle back to SUMO if it is in its lane, otherwise give it a path to the lane's centre.

    Where a rescue lane is open, the vehicle keeps to the side.
    A driver who is over the stop line of a red light waits for green first.
    """
    if is_over_red_line(ego):
        unit = changed(unit, phase=Mode.REJOIN, navigator=NavigatorState(), stopped_steps=0)
        return YieldStep(unit, FULL_BRAKE if standing(ego) else navigate(unit, ego, 0.0, ego.world.hold_navigator)[1])
    lane = lane_of(unit, ego)
    if lane == NO_LANE or _is_back(ego, lane):
        return _hand_back(unit, ego)
    config, half_length, navigator_config = ego.civilian_driver, ego.half_length_m, ego.navigator_config
    reference = ego.line_along(lane, _REJOIN_AHEAD_M, 2.0, civilian=True, through_junctions=False)
    _, left = reference.curve.project_one(*ego.place)
    speed = 0.5 * (ego.speed_mps + config.yielding.rejoin_speed_mps)
    merge = blend_length_m(
        left,
        speed,
        config.pull_over.duration_s,
        LEAST_SIDEWAYS_M,
        navigator_config,
    )
    merge = max(merge, _REJOIN_LENGTHS * 2.0 * half_length)
    room = reference.curve.length_m - 2.0 - half_length - 1.0
    # So near to the stop line the vehicle cannot become straight at the lane's middle, so it keeps its offset.
    kept_m = kept_offset_m(ego, lane)
    offset = kept_m if merge + half_length <= room else left
    length, shorten = min(merge, max(room, 2.0)), half_length + 1.0
    path = path_onto(reference, ego.pose, length, navigator_config, offset_m=offset, shorten_m=shorten)
    navigator = NavigatorState().following(path, *ego.place)
    side = 1 if left < kept_m else -1
    return rejoin(changed(unit, phase=Mode.REJOIN, navigator=navigator, stopped_steps=0, side=side), ego)


def rejoin(unit: YieldUnit, ego: Ego) -> YieldStep:
    """One step of the return. SUMO takes over in the lane, at the path's end, or if the path stays blocked."""
    if unit.navigator.path is None:
        return start_rejoin(unit, ego)
    config = ego.civilian_driver.yielding
    stopped = unit.stopped_steps + 1 if standing(ego) else 0
    lane = lane_of(unit, ego)
    if lane == NO_LANE or _is_back(ego, lane):
        return _hand_back(unit, ego)
    blocked = stopped >= steps_from_s(config.rejoin_blocked_s) and _straight(ego, lane)
    shift_m = kept_offset_m(ego, lane) - offset_in_lane(ego, lane)[0]
    # SUMO does not look for somebody ahead on the way into the lane.
    if (blocked or unit.navigator.done) and not sweeps_somebody(ego, shift_m, LEAST_SIDEWAYS_M):
        return _hand_back(unit, ego)
    navigator, command, _ = navigate(unit, ego, config.rejoin_speed_mps, ego.world.civilian_navigator)
    return YieldStep(changed(unit, navigator=navigator, stopped_steps=stopped), command)


def _is_back(ego: Ego, lane: int) -> bool:
    """Whether a vehicle is back in its lane, and SUMO would not brake at once for somebody who reaches into it.

    SUMO takes a body for a leader where the mirrors would meet: one of each of the two.
    """
    brakes = not standing(ego) and reaches_beside(ego, lane, LEAST_SIDEWAYS_M, MIRRORS_M)
    return _straight(ego, lane, _REJOIN_OFFSET_M) and not brakes


def is_over_red_line(ego: Ego) -> bool:
    """Whether a vehicle is beyond the stop line of a red light without blocking others.

    SUMO would let it go on.
    """
    outlook = ego.seen.outlook
    if outlook is None:
        return False
    front = outlook.front_m(ego.row)
    entry = outlook.course(ego.row).entry_at(front)
    if entry is None or rank_of(entry.connection, outlook.signals) is not Rank.RED:
        return False
    return not may_cross(ego, entry.connection, front - entry.start_m + way_inside_m(ego, entry.connection, ego.lane))


def _straight(ego: Ego, lane: int, off_m: float = math.inf) -> bool:
    """Whether SUMO can take over without a jump, with at most ``off_m`` lateral distance to its place in the lane.

    SUMO's standing vehicles always point along their lanes.
    """
    offset, turned = offset_in_lane(ego, lane)
    return abs(offset - kept_offset_m(ego, lane)) <= off_m and abs(turned) <= aligned_within_rad(ego)


def _hand_back(unit: YieldUnit, ego: Ego) -> YieldStep:
    return YieldStep(None, None, (yield_event(unit, ego, EventKind.YIELD_RELEASED),))


def rescue_side(ego: Ego, lane: int) -> int:
    """Side to which drivers of a lane keep in slow traffic: +1 left, −1 right, 0 if none has to."""
    world = ego.world
    return int(world.rescue_sides[lane]) if world.duty and lane != NO_LANE else 0


def kept_offset_m(ego: Ego, lane: int) -> float:
    """Offset from the lane's centre line of a slow vehicle that keeps to the side; 0 if it keeps to the middle."""
    config = ego.civilian_driver.pull_over
    if ego.speed_mps >= config.flows_mps:
        return 0.0
    room_m = 0.5 * ego.network.lanes[lane].width_m - ego.half_width_m - config.mirror_m
    return rescue_side(ego, lane) * max(room_m, 0.0)


_KEPT_WITHIN_M: Final = 0.25
"""A driver within this distance of the place at the edge has already made way."""


def needs_no_siren(ego: Ego) -> bool:
    """Whether a driver on a road with a rescue lane need not respond to an EMV: it keeps to the side, or traffic flows.

    In flowing traffic nobody stops on such a road.
    """
    lane, config = ego.lane, ego.civilian_driver.pull_over
    side = rescue_side(ego, lane)
    if side == 0 or ego.speed_mps >= config.flows_mps:
        return side != 0
    offset, turned = offset_in_lane(ego, lane)
    short_m = side * (kept_offset_m(ego, lane) - offset)
    return short_m <= _KEPT_WITHIN_M and abs(turned) <= aligned_within_rad(ego)


def on_junction(ego: Ego, lane: int) -> bool:
    """Whether a lane crosses a junction."""
    return lane != NO_LANE and road_lane_of(ego.network, lane) == NO_LANE


def approach_lane_of(ego: Ego, lane: int) -> int:
    """The road lane that a lane belongs to; on a junction the lane before it, ``NO_LANE`` if unknown."""
    road = road_lane_of(ego.network, lane)
    if road != NO_LANE or lane == NO_LANE:
        return road
    movement = connection_of_internal(ego.network, lane, ego.route)
    return NO_LANE if movement is None else movement.from_lane


def movement_from(ego: Ego, lane: int) -> Connection | None:
    """Movement of a driver at the end of a lane."""
    onward = lanes_along(ego.network, lane, 0.0, ego.route, ego.network.lanes[lane].length_m + 0.1, civilian=True)[0]
    ways = ego.network.connections_from.get(lane, ())
    return next((way for way in ways if (*way.via, way.to_lane) == onward[1:]), None)


def room_beyond_line_m(ego: Ego, movement: Connection, *, urgent: bool = False, side: int = 0) -> float:
    """Distance beyond the stop line that a driver's front may reach without blocking others, at a ``side`` of its lane.

    Where an EMV has waited long enough (``urgent``), others who stand or can stop gently before their lines let the
    driver go.
    """
    lane_of, quiet = ego.traffic.lane, frozenset[int]()
    if urgent:
        brake_mps2 = ego.civilian_driver.conflicts.brake_mps2
        way_m = ego.world.lane_length_m[lane_of] - ego.traffic.lane_position_m
        comes = (ego.seen.speed_mps > STANDING_MPS) & (braking_distance_m(ego.seen.speed_mps**2, brake_mps2) > way_m)
        quiet = frozenset(range(len(ego.network.lanes))).difference(lane_of[comes].tolist())
    return ego.world.junction_room.beyond_line_m(movement, _signals(ego), frozenset(lane_of.tolist()), quiet, side)


def may_enter(ego: Ego, movement: Connection, front_m: float, *, urgent: bool) -> bool:
    """Whether a driver may cross the junction, as ``may_cross``.

    Where it is urgent it also may while nobody comes, if it could not reach over the line far enough without blocking
    others.
    """
    if may_cross(ego, movement, front_m):
        return True
    short = room_beyond_line_m(ego, movement) < ego.civilian_driver.pull_over.room_over_line_m
    return urgent and short and math.isinf(room_beyond_line_m(ego, movement, urgent=True))


_IN_THE_WAY_M: Final = 2.0
"""A vehicle that blocks others by more than this crosses the junction even at red."""


def may_cross(ego: Ego, movement: Connection, front_m: float) -> bool:
    """Whether a driver may cross the junction: the light allows it, or the front already blocks others.

    ``front_m`` is the front's way beyond the stop line.
    """
    return not is_held(ego, movement) or front_m > room_beyond_line_m(ego, movement) + _IN_THE_WAY_M


def is_held(ego: Ego, movement: Connection | None) -> bool:
    """Whether a light that is red, or about to be, stops a movement."""
    return movement is not None and rank_of(movement, _signals(ego)) in {Rank.RED, Rank.CLEARING}


def _signals(ego: Ego) -> Mapping[str, str]:
    return {} if ego.seen.outlook is None else ego.seen.outlook.signals


def junction_m(ego: Ego, movement: Connection) -> float:
    """Length of a movement's path across its junction."""
    return ego.network.length_m(movement.via)


def way_inside_m(ego: Ego, movement: Connection, lane: int) -> float:
    """Distance from the stop line to the start of a movement's lane; 0 if the lane does not belong to the movement."""
    before = movement.via[: movement.via.index(lane)] if lane in movement.via else ()
    return ego.network.length_m(before)
