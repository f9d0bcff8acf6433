"""All mechanisms that limit a driver's speed, in the order in which they act.

``navigate`` runs through the table ``MECHANISMS`` for each vehicle that SUMO does not drive. SUMO's own drivers follow
SUMO's car-following model; ``traffic`` limits them further (``traffic.sumo.rules.RULES`` has all that they are told):

1. ``roads.maps.map_compiler.with_speed_limit``: the map's speed limits, lowered to the template's.
2. ``traffic.demand.plan.DriverPopulation``: the wished speed, by each driver's factor on the limit.
3. ``traffic.sumo.driving_corrections.BendLimits``: bends ahead, by their lateral acceleration.
4. ``traffic.sumo.caution.CautiousDrivers``: vehicles that are driven from outside, where the ways meet, and people on
   crossings.
5. ``traffic.sumo.driving_corrections.SidewaysLimits``: the speed sideways, as a share of the speed.
6. ``traffic.sumo.filtering.FilteringRiders``: motorcyclists who follow an EMV through the rescue lane.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Rows, changed
from siren_ros.base.numerics.braking import braking_distance_m, safe_following_mps, speed_before_mps
from siren_ros.base.numerics.compiled import YAW, X, Y, compiled
from siren_ros.simulation.behaviour.driving.collision_watch import MOVING_MPS, ROLLING_MPS, CollisionWatch, stricter
from siren_ros.simulation.behaviour.driving.driver_states import ROUTE, EmvUnit, YieldUnit, present_lane
from siren_ros.simulation.behaviour.driving.lane_change import gaps_in_lane
from siren_ros.simulation.behaviour.driving.lane_path import neighbour_lane
from siren_ros.simulation.behaviour.driving.navigator import (
    ALONG_COSINE,
    LEADER_BRAKE_MPS2,
    NARROW_REACH_M,
    NARROW_STOP_SHORT_M,
    SPEED_GAIN_1PS,
    STILL_MPS,
    DriveCommand,
    FreeWay,
    NavigatorState,
    Obstacles,
    SpeedLimit,
    free_way_of,
    manoeuvring_limit,
    press_pedals,
    steer_along,
)
from siren_ros.simulation.behaviour.driving.step_view import SEEN_HALF_LENGTH, SEEN_HALF_WIDTH, SEEN_SPEED, Ego
from siren_ros.simulation.behaviour.driving.tracked_path import Curve, Navigation, TrackedPath, nearest_point
from siren_ros.simulation.conflicts.course import Course, Entry
from siren_ros.simulation.conflicts.junction_approach import (
    ID,
    PACE_MPS,
    Line,
    Passer,
    least_wait_for_people,
    must_give_way,
)
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.scenario.driver_parameters import AnticipationConfig
from siren_ros.simulation.world.actors import NO_ACTOR, Mode

UNLIMITED: Final = SpeedLimit()
_SIDEWAYS_MODES: Final = frozenset({Mode.YIELD_PULL_OVER, Mode.YIELD_HOLD, Mode.REJOIN})


@dataclass(frozen=True, eq=False)
class Drive:
    """Inputs of one driver on a path at one step."""

    unit: EmvUnit | YieldUnit
    ego: Ego
    path: TrackedPath
    progress_m: float
    target_mps: float
    """Target speed of the mode."""
    config: Navigation


ESCAPE_HORIZON_M: Final = 30.0
"""Distance that a gap escape looks ahead."""
_BESIDE_M: Final = 30.0
"""Vehicles are considered up to this distance beyond that horizon."""


def rows_around(ego: Ego) -> tuple[Rows, Flags]:
    """Rows of the vehicles around the EMV, and which have its direction."""
    rows = ego.near(ESCAPE_HORIZON_M + _BESIDE_M)
    return rows, np.cos(ego.seen.yaw_rad[rows] - ego.pose[2]) > ALONG_COSINE


_ESCAPE_WATCH_S: Final = 0.8
"""Time for which moving vehicles are extrapolated when the path of a gap escape is checked."""
_CROSSING_MPS: Final = 1.0
"""Faster vehicles that cross the EMV's path are left to the collision handling, if it is on."""


def free_way(unit: EmvUnit, ego: Ego) -> FreeWay | None:
    """Distances of the EMV's footprint from others along its path; None without a path.

    In the corridor, vehicles ahead are expected to keep moving. During a gap escape they may stop at once. Those that
    come from behind, or pass the EMV, go on.
    """
    navigator, config = unit.navigator, ego.emv_driver.gap_escape
    if navigator.path is None:
        return None
    rows, along = rows_around(ego)
    speed = ego.seen.speed_mps[rows]
    counts = along | (speed < _CROSSING_MPS) | unit.gap_escape_active
    rows, along, speed = rows[counts], along[counts], speed[counts]
    against = np.cos(ego.seen.yaw_rad[rows] - ego.pose[2]) < -ALONG_COSINE
    time_s = np.where(against & unit.gap_escape_active, config.oncoming_watch_s, np.where(along, 0.0, _ESCAPE_WATCH_S))
    credit = np.where(along & (not unit.gap_escape_active), braking_distance_m(speed**2, LEADER_BRAKE_MPS2), 0.0)
    passing = along & _passes(ego, rows)
    time_s, credit = np.where(passing, config.oncoming_watch_s, time_s), np.where(passing, 0.0, credit)
    return free_way_of(navigator, ego, ESCAPE_HORIZON_M, Obstacles.swept(ego.seen, rows, time_s), credit)


def _passes(ego: Ego, rows: Rows) -> Flags:
    """Which vehicles are faster, and next to the EMV or soon there: they will pass it.

    Whoever is straight behind the EMV follows it.
    """
    seen, (cos, sin), (x, y) = ego.seen, ego.direction, ego.place
    ahead_m = cos * (seen.x_m[rows] - x) + sin * (seen.y_m[rows] - y)
    aside_m = np.abs(cos * (seen.y_m[rows] - y) - sin * (seen.x_m[rows] - x))
    behind = ahead_m < ego.half_length_m + seen.half_length_m[rows]
    faster_mps = seen.speed_mps[rows] - ego.speed_mps
    comes_up_m = ego.half_length_m + seen.half_length_m[rows] + ego.emv_driver.gap_escape.oncoming_watch_s * faster_mps
    past = (aside_m > ego.half_width_m + seen.half_width_m[rows]) & (faster_mps > 0.0) & (-ahead_m < comes_up_m)
    return np.asarray(behind & past, np.bool_)


ESCAPE_TOUCH_M: Final = 0.06
"""Margin below which the path counts as blocked; it is larger than the EMV's tracking error."""


def passage_limit(unit: EmvUnit, ego: Ego) -> SpeedLimit:
    """Speed limit between others in the corridor and during a gap escape.

    The collision handling would keep too much distance from vehicles that the EMV squeezes past, or is off. This limit
    follows from the footprint itself along the path.
    """
    way, config = free_way(unit, ego) if unit.between else None, ego.emv_driver
    if way is None:
        return UNLIMITED
    corridor, escape = config.corridor, config.gap_escape
    squeezes, stop_short_m, clearance_m = corridor.squeezes, corridor.stop_short_m, corridor.clearance_m
    if unit.gap_escape_active:
        squeezes, stop_short_m, clearance_m = escape.squeezes, escape.stop_short_m, ESCAPE_TOUCH_M
    return way.limit(ego.speed_mps, squeezes, stop_short_m, escape.brake_mps2, clearance_m)


SIDE_MARGIN_M: Final = 0.25
"""A vehicle with a smaller lateral distance is in the way."""


def anticipated_limit(unit: EmvUnit, ego: Ego) -> SpeedLimit:
    """Speed limit towards vehicles ahead on the EMV's path, with early and gentle braking.

    In the corridor and during a gap escape the passage limit stands in its place.
    """
    path, config, seen = unit.navigator.path, ego.emv_driver.approach, ego.seen
    if path is None or unit.between:
        return UNLIMITED
    own = ego.row, unit.navigator.progress_m, ego.far_m(ego.world.constants.leader_query_m)
    alone, allowed = _anticipated(seen.bodies, path.curve, *own, *approach_limits(config))
    if alone:
        return UNLIMITED
    least = min(allowed, _needed_lane_mps(unit, ego))
    return _eased_off(least, ego.speed_mps, config.ease_off_mps2)


@compiled
def _anticipated(
    bodies: Floats,
    curve: Curve,
    row: int,
    progress_m: float,
    around_m: float,
    standstill_gap_m: float,
    brake_mps2: float,
    headway_s: float,
) -> tuple[bool, float]:
    """Whether no vehicle is near, and the smallest ``approach_speed_mps`` towards those ahead on a path."""
    alone, least = True, np.inf
    for other in range(bodies.shape[1]):
        dx, dy = bodies[X, other] - bodies[X, row], bodies[Y, other] - bodies[Y, row]
        if other == row or dx * dx + dy * dy >= around_m * around_m:
            continue
        alone = False
        s_m, left_m, nearest = nearest_point(curve, bodies[X, other], bodies[Y, other], 0, len(curve.points))
        turned = bodies[YAW, other] - curve.heading_rad[nearest]
        cos, sin, speed = np.cos(turned), np.sin(turned), bodies[SEEN_SPEED, other]
        gap = (
            s_m
            - (abs(cos) * bodies[SEEN_HALF_LENGTH, other] + abs(sin) * bodies[SEEN_HALF_WIDTH, other])
            - progress_m
            - bodies[SEEN_HALF_LENGTH, row]
        )
        inside = (
            abs(sin) * bodies[SEEN_HALF_LENGTH, other]
            + abs(cos) * bodies[SEEN_HALF_WIDTH, other]
            + bodies[SEEN_HALF_WIDTH, row]
            + SIDE_MARGIN_M
        )
        overlap = inside - abs(left_m)
        on_line = gap > 0.0 and s_m < curve.spacing_m * (len(curve.points) - 1)
        if cos > ALONG_COSINE and overlap > 0.0 and on_line:
            leaving = speed * sin * np.sign(left_m)
            limits = standstill_gap_m, brake_mps2, headway_s
            least = min(least, approach_speed_mps(gap, speed * cos, overlap, leaving, *limits))
    return alone, least


def _eased_off(limit_mps: float, speed_mps: float, ease_off_mps2: float) -> SpeedLimit:
    """A limit that is not lower than what gentle deceleration reaches."""
    return SpeedLimit(max(limit_mps, speed_mps - ease_off_mps2 / SPEED_GAIN_1PS))


def _needed_lane_mps(unit: EmvUnit, ego: Ego) -> float:
    """Speed towards the vehicle ahead in the lane that the route needs, while the change to it is not feasible."""
    side = unit.request.side if unit.request.reason == ROUTE else 0
    target = neighbour_lane(ego.network, present_lane(ego, unit.navigator), side) if side else NO_LANE
    gaps = gaps_in_lane(ego, target) if target != NO_LANE else None
    if gaps is None or not 0.0 < gaps.front_m < math.inf:
        return math.inf
    return approach_speed_mps(gaps.front_m, gaps.front_mps, 1.0, 0.0, *approach_limits(ego.emv_driver.approach))


_LEAVING_MIN_MPS: Final = 0.15
"""A vehicle with a larger lateral speed counts as leaving the path."""
LEAVING_MPS: Final = 0.6
"""Mean lateral speed of a lane change; the present value varies and says little about the end."""


def approach_limits(config: AnticipationConfig) -> tuple[float, float, float]:
    """The last arguments of ``approach_speed_mps``: compiled code knows no config classes."""
    return config.standstill_gap_m, config.brake_mps2, config.headway_s


@compiled
def approach_speed_mps(
    gap_m: float,
    lead_mps: float,
    overlap_m: float,
    leaving_mps: float,
    standstill_gap_m: float,
    brake_mps2: float,
    headway_s: float,
) -> float:
    """Speed towards a vehicle ahead; the last three arguments come from ``approach_limits``.

    The speed is Krauss's safe speed with a gentle deceleration. A vehicle that leaves the path sideways, with
    ``leaving_mps``, may be approached faster: with the mean speed that brings the EMV to the standstill gap behind it
    at the moment at which it has left. ``overlap_m`` is by how much it still overlaps the way of the EMV, ``gap_m`` the
    way from bumper to bumper.
    """
    free = max(gap_m - standstill_gap_m, 0.0)
    safe = safe_following_mps(lead_mps, free, brake_mps2, headway_s)
    if leaving_mps <= _LEAVING_MIN_MPS:
        return max(safe, 0.0)
    return max(safe, lead_mps + free / max(overlap_m / LEAVING_MPS, headway_s))


def entry_limit(unit: EmvUnit, ego: Ego) -> SpeedLimit:
    """Speed limit towards lines ahead at which others have the right of way; no limit if there is none.

    The EMV comes to its speed there by gentle braking in good time. Where the light turns red late it slows down as
    far as gentle braking gets it. Before a junction that it could not leave it stops, unless it drives between others.
    """
    outlook, lines = ego.seen.outlook, ego.world.lines
    if outlook is None:
        return UNLIMITED
    front, length = outlook.front_m(ego.row), 2.0 * ego.half_length_m
    limit, stop = math.inf, math.inf
    course = outlook.course(ego.row)
    for entry in course.entries:
        ahead = entry.start_m - front
        if ahead > 0.0 and must_give_way(entry.connection, outlook.signals):
            limit = min(limit, lines.approach_mps(ego.actor_id, length, entry.connection, ahead))
        if ahead > 0.0 and not unit.between and math.isinf(stop):
            stop = _stop_before_full_exit_mps(ego, course, entry, ahead)
    ease_off = ego.emv_driver.lines.ease_off_mps2
    return SpeedLimit(min(_eased_off(limit, ego.speed_mps, ease_off).speed_mps, stop))


def _stop_before_full_exit_mps(ego: Ego, course: Course, entry: Entry, ahead_m: float) -> float:
    """Speed from which the EMV stops before a junction that it could not leave; infinite where it can, or is too near.

    It needs its length and the gap that it keeps between the junction and whoever stands beyond. Where nobody comes
    from elsewhere, as between two pieces of a road, it blocks nobody.
    """
    config, speed = ego.emv_driver, ego.speed_mps
    if math.isinf(ego.world.junction_room.beyond_line_m(entry.connection, {}, frozenset())):
        return math.inf
    if room_behind_junction_m(ego, course, entry) >= 2.0 * ego.half_length_m + config.approach.standstill_gap_m:
        return math.inf
    if braking_distance_m(speed * speed, config.lines.stop_mps2) > ahead_m:
        return math.inf
    return speed_before_mps(0.0, config.driving.path_brake_mps2, max(ahead_m - config.lines.standoff_m, 0.0))


def room_behind_junction_m(ego: Ego, course: Course, entry: Entry) -> float:
    """Free way of a course from the end of a junction to the rear of the first vehicle that stands there or inside.

    Those who still move ahead of the vehicle will need their lengths and gaps of it. Infinite where nobody stands.
    """
    network, traffic = ego.network, ego.traffic
    via, gap_m = entry.connection.via, ego.civilian_driver.driving.standstill_gap_m
    beyond = course.lanes[math.ceil(entry.start_m / course.spacing_m) :].tolist()
    way_m = -network.length_m(via)
    for lane in dict.fromkeys((*via, entry.connection.to_lane, *beyond)):
        rows = np.flatnonzero(traffic.lane == lane)
        for row in rows[np.argsort(traffic.lane_position_m[rows], kind="stable")].tolist():
            length_m = 2.0 * float(ego.seen.half_length_m[row])
            if ego.seen.speed_mps[row] < MOVING_MPS:
                return way_m + float(traffic.lane_position_m[row]) - length_m
            way_m -= length_m + gap_m
        way_m += network.lanes[lane].length_m
    return math.inf


@dataclass(frozen=True)
class Mechanism:
    """One mechanism: its limit for a driver, and the reason in one line."""

    name: str
    limit: Callable[[Drive], SpeedLimit]
    purpose: str


def _path(drive: Drive) -> SpeedLimit:
    places_m = drive.progress_m, drive.progress_m + drive.ego.speed_mps * drive.config.reaction_s
    return SpeedLimit(min(drive.path.speed_cap_mps(place_m) for place_m in places_m))


def _collision(drive: Drive) -> SpeedLimit:
    unit, ego = drive.unit, drive.ego
    if isinstance(unit, EmvUnit) and unit.gap_escape_active:
        return UNLIMITED
    watch = CollisionWatch(drive.path, drive.progress_m, ego.row, drive.target_mps, ego.seen, drive.config)
    leaders = not (isinstance(unit, EmvUnit) and unit.corridor)
    return stricter(watch.leaders() if leaders else None, watch.meetings(leaders=leaders)) or UNLIMITED


def _emv_limit(limit: Callable[[EmvUnit, Ego], SpeedLimit]) -> Callable[[Drive], SpeedLimit]:
    """A limit that applies only to EMVs."""
    return lambda drive: limit(drive.unit, drive.ego) if isinstance(drive.unit, EmvUnit) else UNLIMITED


_PAST_KERB_MPS: Final = 30.0 / 3.6
"""Largest speed of an EMV past people who stand at a crossing near its path; other drivers pass at walking pace."""


def _people(drive: Drive) -> SpeedLimit:
    ego, curve, people = drive.ego, drive.path.curve, drive.ego.seen.people
    if not people.shape[1]:
        return UNLIMITED
    way = Line(curve.points, 0, len(curve.points), curve.spacing_m)
    beside_mps = _PAST_KERB_MPS if ego.is_emv else PACE_MPS
    own = Passer(drive.progress_m, 0.0, ego.half_length_m, ego.half_width_m, ego.speed_mps, beside_mps)
    worst, speed, brake, free = least_wait_for_people(way, own, people, ego.world.crossings)
    if worst < 0:
        return UNLIMITED
    must_brake = brake if brake > drive.config.comfort_brake_mps2 else 0.0
    return SpeedLimit(speed, must_brake, int(people[ID, worst]), free)


_STRAYS: Final = 0.5
"""Share of its distance from the path by which the EMV may deviate further before it returns."""


def riders_limit(unit: EmvUnit, ego: Ego) -> SpeedLimit:
    """Speed limit for an EMV off its path that passes standing riders, so that the body touches none.

    The collision handling expects it on its path. In the corridor and in a gap escape the passage limit stands here.
    """
    riders, config = ego.seen.riders, ego.civilian_driver.manoeuvring
    if not len(riders) or unit.between or unit.navigator.path is None:
        return UNLIMITED
    reach_m = ego.far_m(NARROW_REACH_M)
    apart = np.hypot(ego.seen.x_m[riders] - ego.place[0], ego.seen.y_m[riders] - ego.place[1])
    riders = riders[(apart < reach_m + 2.0 * ego.half_length_m) & (ego.seen.speed_mps[riders] < STILL_MPS)]
    if not len(riders):
        return UNLIMITED
    still = np.zeros(len(riders))
    way = free_way_of(unit.navigator, ego, reach_m, Obstacles.swept(ego.seen, riders, still), still)
    clearance_m = max(config.clearance_m, _STRAYS * abs(unit.navigator.left_m))
    return way.limit(ego.speed_mps, config.squeezes, NARROW_STOP_SHORT_M, config.brake_mps2, clearance_m)


def _manoeuvring(drive: Drive) -> SpeedLimit:
    unit = drive.unit
    emv = isinstance(unit, EmvUnit)
    sideways = unit.lane_change_forced if isinstance(unit, EmvUnit) else unit.phase in _SIDEWAYS_MODES
    return manoeuvring_limit(unit.navigator, drive.ego, emvs_only=emv) if sideways else UNLIMITED


MECHANISMS: Final = (
    Mechanism(
        "target",
        lambda drive: _eased_off(drive.target_mps, drive.ego.speed_mps, drive.config.ease_off_mps2),
        "the mode's speed (paper, table of target speeds), come to by easing off",
    ),
    Mechanism("path", _path, "bends ahead, what the steering can follow, and a stop at the path's end"),
    Mechanism("collision", _collision, "vehicles ahead on the path, and those whose way meets it; off in a gap escape"),
    Mechanism(
        "passage", _emv_limit(passage_limit), "EMV in the corridor and in a gap escape: space beside its footprint"
    ),
    Mechanism(
        "anticipation", _emv_limit(anticipated_limit), "EMV elsewhere: vehicles ahead, with gentle braking in good time"
    ),
    Mechanism(
        "junction entry",
        _emv_limit(entry_limit),
        "EMV: lines ahead at which others have the right of way, and junctions that it could not leave",
    ),
    Mechanism("people", _people, "people on crossings: walking pace past them, a stop before those in the way"),
    Mechanism("riders", _emv_limit(riders_limit), "EMV off its path elsewhere: cyclists and motorcyclists who stand"),
    Mechanism(
        "manoeuvring",
        _manoeuvring,
        "civilians who pull over, hold or come back, EMVs that change lanes beside EMVs: space around the whole body",
    ),
)
"""Every mechanism that limits the speed of a vehicle that SUMO does not drive, in the order in which they act."""


def navigate(
    unit: EmvUnit | YieldUnit,
    ego: Ego,
    target_mps: float,
    config: Navigation,
    mechanisms: Sequence[Mechanism] = MECHANISMS,
) -> tuple[NavigatorState, DriveCommand, int]:
    """One step along the path of a unit: steering, pedals, and the blocking actor (``NO_ACTOR`` without one).

    The lowest speed and the hardest braking of all mechanisms hold, and the blocker of the first one that has one.
    Without a path the vehicle brakes to a standstill and keeps its wheels straight.
    """
    state, speed = unit.navigator, ego.speed_mps
    if state.path is None:
        pedals = press_pedals(speed, 0.0, 0.0, 0.0, ego.vehicle, config)
        return changed(state, integral_mps2=0.0), DriveCommand(0.0, pedals.brake, 0.0, False), NO_ACTOR
    progress, left = state.path.curve.nearest_to(state.progress_m, *ego.place)
    drive = Drive(unit, ego, state.path, progress, target_mps, config)
    limits = tuple([mechanism.limit(drive) for mechanism in mechanisms])
    must_brake = max(limit.brake_mps2 for limit in limits) if speed > ROLLING_MPS else 0.0
    lowest = min(limit.speed_mps for limit in limits)
    steer = steer_along(state.path, progress, left, ego.pose[2], speed, ego.vehicle)
    bend_1pm = math.tan(steer) / ego.vehicle.wheelbase_m
    pedals = press_pedals(speed, lowest, must_brake, state.integral_mps2, ego.vehicle, config, steer)
    return (
        NavigatorState(state.path, progress, left, pedals.integral_mps2, target_mps, limits, bend_1pm),
        DriveCommand(pedals.throttle, pedals.brake, steer, False),
        next((limit.blocker_id for limit in limits if limit.blocker_id != NO_ACTOR), NO_ACTOR),
    )
