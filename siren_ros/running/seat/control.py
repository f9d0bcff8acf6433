"""Parts of a driver's control: target speeds, free gaps beside it, and pedals and steering.

Target speeds come from the limit, bends, the leader and red lines; indicators from the path.
"""

import math
from typing import Final

import numpy as np

from siren_ros.base.numerics.braking import safe_following_mps
from siren_ros.running.seat.sight import SPACING_M, Other, Sight
from siren_ros.simulation.world.actors import TURN_LIGHTS, Lights, indicator_to
from siren_ros.simulation.world.commands import AvControl

_GENTLE_MPS2: Final = 2.0
"""Gentle braking, and lateral acceleration in bends."""
_HEADWAY_S: Final = 1.4
_STANDSTILL_M: Final = 2.5
BESIDE_M: Final = 0.25
"""Lateral distance kept to the vehicle ahead; a driver stands beside somebody who is nearer."""
_LOOK_M: Final = (0.0, 4.0, 8.0, 14.0, 20.0)
"""Distances ahead at which bends are checked."""
_END_M: Final = 3.0
"""Distance kept to the end of the path."""
_PASSES_MPS: Final = 1.0
"""A driver is slower than a passing EMV by this."""
_PASSED_M: Final = 5.0
"""An EMV has passed if its rear is this far ahead."""
_NEXT_M: Final = 4.0
"""An EMV has also passed if its centre is this far to the side."""
_STUCK_MPS: Final = 0.3
_WAITS_M: Final = 15.0
_WAITS_MPS: Final = 2.0
"""Limits of speed and gap for an EMV that cannot pass."""
_LINE_M: Final = 1.0
"""Distance kept to a stop line."""
_SEEN_ROWS: Final = 80
"""Rows of the path that are checked for junctions."""
_SIGNALS_S: Final = 2.0
_MERGES_S: Final = 4.0
"""Time before a change of lanes in which a driver falls in behind those of the other lane."""
_TURNS_M: Final = 35.0
"""Way before a turn on which the indicator shows: 100 feet (California Vehicle Code, section 22108) and a step."""
_SLOW_MPS: Final = 5.0
"""A slower vehicle may come to a stop."""
_HEARD_M: Final = 50.0
"""Distance at which a driver in a closed car hears a siren (De Lorenzo and Eilers 1991)."""
_ACROSS_RAD: Final = math.pi / 6.0
"""An EMV whose heading differs by more than this comes from another road, or from ahead."""
_LATE_MPS2: Final = 5.0
"""A driver that would need harder braking before a red line drives on."""


def speed_to_limit(sight: Sight, factor: float = 1.0) -> float:
    """Speed limit, by a factor, reduced before bends and the end of the path, in m/s."""
    way, curve = sight.way, sight.way.curve
    at = [sight.s_m + ahead for ahead in _LOOK_M]
    headings = curve.heading_rad([min(s, curve.length_m) for s in at]).tolist()
    least = float(way.limit_mps[way.row(sight.s_m)]) * factor
    for k in range(len(at) - 1):
        bend_1pm = abs(math.remainder(headings[k + 1] - headings[k], 2.0 * math.pi)) / (at[k + 1] - at[k])
        if bend_1pm > 0.01:
            least = min(least, math.sqrt(_GENTLE_MPS2 / bend_1pm + 2.0 * _GENTLE_MPS2 * _LOOK_M[k]))
    rest_m = max(curve.length_m - sight.s_m - _END_M, 0.0)
    return min(least, math.sqrt(2.0 * _GENTLE_MPS2 * rest_m))


def _behind_mps(other: Other) -> float:
    """Safe speed behind somebody ahead."""
    free_m = max(other.gap_m - _STANDSTILL_M, 0.0)
    return safe_following_mps(max(other.speed_mps, 0.0), free_m, _GENTLE_MPS2, _HEADWAY_S)


def speed_to_leader(sight: Sight, offset_m: float) -> float:
    """Speed behind the leader at the given or the present offset, in m/s; infinite without one."""
    least = math.inf
    for other in sight.others:
        across = min(abs(other.left_m - offset_m), abs(other.left_m - sight.left_m))
        if other.gap_m > -1.5 and across < other.half_width_m + 0.5 * sight.width_m + BESIDE_M:
            least = min(least, _behind_mps(other))
    return least


def speed_to_merge(sight: Sight) -> float:
    """Speed behind those in the lane to which the path changes soon, in m/s; infinite where nobody is there.

    One that is beside the driver, and not behind its middle, counts, too: the driver falls back behind it.
    """
    row = sight.way.row(sight.s_m)
    soon = sight.way.changes[row : row + 1 + int(_MERGES_S * max(sight.speed_mps, _SLOW_MPS))]
    side = float(soon[np.flatnonzero(soon)[0]]) if soon.any() else 0.0
    least, lane_m = math.inf, float(sight.way.lanes.width_m[row])
    for other in sight.others if side else ():
        there = 0.5 * sight.width_m < side * (other.left_m - sight.left_m) < 1.5 * lane_m
        if there and other.gap_m + other.length_m > -0.5 * sight.length_m:
            least = min(least, _behind_mps(other))
    return least


def speed_to_passing_emv(sight: Sight) -> float:
    """Speed that lets an EMV beside the own vehicle get ahead, in m/s; infinite if none passes.

    Beside one that squeezes through, or that is very close, it stands.
    """
    least = math.inf
    for siren in sight.sirens:
        if siren.along and siren.gap_m < 0.0 and siren.ahead_m < _PASSED_M and abs(siren.left_m) < _NEXT_M:
            apart_m = abs(siren.left_m) - 0.5 * (sight.width_m + sight.bodies[siren.actor_id].width_m)
            if apart_m < BESIDE_M or _STUCK_MPS < siren.speed_mps < _WAITS_MPS:
                return 0.0
            if siren.speed_mps > _STUCK_MPS:
                least = min(least, siren.speed_mps - _PASSES_MPS)
    return least


def emv_waits(sight: Sight) -> bool:
    """Whether an EMV cannot pass the own vehicle: it almost stands close behind, or beside it."""
    return any(siren.behind and siren.gap_m < _WAITS_M and siren.speed_mps < _WAITS_MPS for siren in sight.sirens)


def speed_to_red(sight: Sight) -> float:
    """Speed before the next red line, in m/s; infinite without one, or if it is too late to stop."""
    if sight.red_m == math.inf or sight.red_m < sight.speed_mps**2 / (2.0 * _LATE_MPS2) - 1.0:
        return math.inf
    return math.sqrt(2.0 * _GENTLE_MPS2 * max(sight.red_m - _LINE_M, 0.0))


def speed_to_junction(sight: Sight) -> float:
    """Speed before a junction that a slow vehicle makes impossible to leave, in m/s; infinite without one."""
    way, row = sight.way, sight.way.row(sight.s_m)
    ahead = way.in_junction[row : row + _SEEN_ROWS]
    if not ahead.any() or ahead[0]:
        return math.inf
    first = int(ahead.argmax())
    inside = ahead[first:]
    front_m = 0.5 * sight.length_m
    entry_m = first - front_m
    exit_m = first + (len(inside) if inside.all() else int((~inside).argmax())) - front_m
    if entry_m < sight.speed_mps**2 / (2.0 * _LATE_MPS2) - 1.0:
        return math.inf
    for other in sight.others:
        across = min(abs(other.left_m), abs(other.left_m - sight.left_m))
        in_the_way = across < other.half_width_m + 0.5 * sight.width_m
        if in_the_way and 0.0 < other.gap_m < exit_m + sight.length_m + _STANDSTILL_M and other.speed_mps < _SLOW_MPS:
            return math.sqrt(2.0 * _GENTLE_MPS2 * max(entry_m - _LINE_M, 0.0))
    return math.inf


def indicators(sight: Sight) -> int:
    """Indicators for a lane change that the path has soon, and for the turn at the next junction."""
    row = sight.way.row(sight.s_m)
    reach = row + 1 + int(max(sight.speed_mps, 1.0) * _SIGNALS_S)
    soon = sight.way.changes[row:reach]
    if sight.in_junction:
        return int(Lights.NONE)
    if not soon.any():
        turn = next((line for line in sight.way.lines if sight.s_m <= line.at_m <= sight.s_m + _TURNS_M), None)
        return int(TURN_LIGHTS.get(turn.connection.direction, Lights.NONE)) if turn else int(Lights.NONE)
    return indicator_to(float(soon[np.flatnonzero(soon)[0]]))


def stop_sign_ahead_m(sight: Sight) -> tuple[float, float]:
    """Arc length of the next line with a stop sign, and its distance from the own front; infinite without one."""
    front_m = sight.s_m + 0.5 * sight.length_m
    signs = (line.at_m for line in sight.way.lines if line.connection.must_stop and line.connection.signal_id is None)
    at_m = next((at_m for at_m in signs if at_m > front_m - _LINE_M), math.inf)
    return at_m, at_m - front_m


def speed_to_stop_sign(sight: Sight, stood_m: float) -> float:
    """Speed before the next line with a stop sign, in m/s; infinite without one, or where it has stood at that line.

    A line is known to the spacing of the path's rows, and may be nearer by that.
    """
    at_m, ahead_m = stop_sign_ahead_m(sight)
    free_m = max(ahead_m - _LINE_M - SPACING_M, 0.0)
    return math.inf if at_m <= stood_m + _LINE_M else math.sqrt(2.0 * _GENTLE_MPS2 * free_m)


def speed_to_entry(sight: Sight) -> float:
    """Speed before the next junction, in m/s, to stop there; infinite without one, or if it is too late."""
    row = sight.way.row(sight.s_m)
    inside = sight.way.in_junction[row : row + _SEEN_ROWS]
    if not inside.any() or inside[0]:
        return math.inf
    entry_m = float(inside.argmax()) - 0.5 * sight.length_m
    if entry_m < sight.speed_mps**2 / (2.0 * _LATE_MPS2) - 1.0:
        return math.inf
    return math.sqrt(2.0 * _GENTLE_MPS2 * max(entry_m - _LINE_M, 0.0))


def speed_to_siren(sight: Sight) -> float:
    """Speed before the next junction while a siren comes across, in m/s; infinite without one, or if it is too late."""
    entry_mps, states = speed_to_entry(sight), sight.states
    for siren in sight.sirens if entry_mps < math.inf else ():
        if siren.along:
            continue
        k = int(np.searchsorted(states.actor_id, siren.actor_id))
        dx, dy = float(states.x_m[sight.row] - states.x_m[k]), float(states.y_m[sight.row] - states.y_m[k])
        yaw = float(states.yaw_rad[k])
        turned = abs(math.remainder(yaw - float(states.yaw_rad[sight.row]), 2.0 * math.pi))
        comes = dx * math.cos(yaw) + dy * math.sin(yaw) > 0.0 and math.hypot(dx, dy) < _HEARD_M
        if comes and turned > _ACROSS_RAD:
            return entry_mps
    return math.inf


_STARTS_MPS2: Final = 2.0
"""Acceleration with which a driver leaves a line."""
_TURNS_ON_M: Final = {Lights.INDICATOR_LEFT: 10.0, Lights.INDICATOR_RIGHT: -6.0}
"""Radius of the turn that an indicator announces, left positive."""
_PREDICTS_S: Final = 0.25
"""Time between the places at which somebody who comes across is predicted."""


def speed_to_crossing(sight: Sight) -> float:
    """Speed before the next line at which a driver gives way or stops, in m/s; infinite where nobody comes across.

    Others are predicted for the time until the driver has left the junction, with their speed and the turn that their
    indicators announce; those who stand do not come.
    """
    entry_mps, way, front_m = speed_to_entry(sight), sight.way, sight.s_m + 0.5 * sight.length_m
    line = next((one.connection for one in way.lines if one.at_m > front_m - _LINE_M), None)
    if entry_mps == math.inf or line is None or line.signal_id is not None or not (line.must_stop or line.gives_way):
        return math.inf
    inside = np.flatnonzero(way.in_junction[way.row(sight.s_m) :][:_SEEN_ROWS])
    inside = inside[: int(np.argmax(np.diff(inside, append=math.inf) > 1)) + 1]
    own = np.asarray(way.curve.at(sight.s_m + inside.astype(np.float64)))
    after_s = np.arange(0.0, math.sqrt(2.0 * (float(inside[-1]) + sight.length_m) / _STARTS_MPS2), _PREDICTS_S)
    states = sight.states
    own_yaw = float(states.yaw_rad[sight.row])
    near = np.hypot(states.x_m - own[0, 0], states.y_m - own[0, 1]) < _SEEN_ROWS
    for k in np.flatnonzero(near & (states.speed_mps > _STUCK_MPS)).tolist():
        yaw, speed_mps, body = float(states.yaw_rad[k]), float(states.speed_mps[k]), sight.bodies[states.actor_id[k]]
        if abs(math.remainder(yaw - own_yaw, 2.0 * math.pi)) < _ACROSS_RAD:
            continue
        radius_m = _TURNS_ON_M.get(Lights(int(states.lights[k])) & Lights.INDICATORS, math.inf)
        turned = yaw + np.clip(speed_mps / radius_m * after_s, -0.5 * math.pi, 0.5 * math.pi)
        way_m = np.cumsum(speed_mps * _PREDICTS_S * np.stack((np.cos(turned), np.sin(turned))), axis=1)
        x = states.x_m[k] + way_m[0] + 0.5 * body.length_m * np.cos(turned)
        y = states.y_m[k] + way_m[1] + 0.5 * body.length_m * np.sin(turned)
        apart_m = np.hypot(own[:, :1] - x, own[:, 1:] - y)
        if apart_m.min() < 0.5 * (sight.width_m + body.width_m) + FREE_BESIDE_M:
            return entry_mps
    return math.inf


COMES_S: Final = 2.5
"""Time for which approaching vehicles are predicted."""
FREE_BESIDE_M: Final = 0.5
"""Lateral distance kept to other vehicles."""
_FREE_BEHIND_M: Final = 0.5
"""Distance kept to vehicles behind."""
_FREE_AHEAD_M: Final = 1.0
"""Distance kept to vehicles ahead at the same speed."""


def is_free(wanted_m: float, sight: Sight, comes_s: float = COMES_S, apart_m: float = FREE_BESIDE_M) -> bool:
    """Whether no other vehicle is beside the own one on a move to the side, or will come there.

    Args:
        wanted_m: Where the move ends across the way, left positive.
        sight: The step.
        comes_s: How far ahead in time others are looked for.
        apart_m: Lateral distance to keep to them.
    """
    least, greatest = sorted((sight.left_m, wanted_m))
    for other in sight.others:
        comes_m = comes_s * (other.speed_mps - sight.speed_mps)
        behind_m = -other.gap_m - other.length_m - sight.length_m
        beside = behind_m < _FREE_BEHIND_M + max(comes_m, 0.0) and other.gap_m < _FREE_AHEAD_M - min(comes_m, 0.0)
        away_m = abs(min(max(other.left_m, least), greatest) - other.left_m)
        nearer = away_m < abs(sight.left_m - other.left_m) - 0.02
        if beside and nearer and away_m < other.half_width_m + 0.5 * sight.width_m + apart_m:
            return False
    return True


def change_ahead_m(sight: Sight) -> float:
    """How far the path changes to the side on the way that the steering looks ahead, left positive."""
    way, row = sight.way, sight.way.row(sight.s_m)
    rows, width_m = slice(row, way.row(sight.s_m + _reach_m(sight))), float(way.lanes.width_m[row])
    moves_m = -np.diff(way.lane_left_m[row : rows.stop + 1])
    moves_m -= width_m * np.round(moves_m / width_m)  # beyond the line it is measured from the next lane
    return float(moves_m[way.changes[rows] != 0.0].sum())


_WHEELBASE_M: Final = 2.7
_FULL_BRAKE_MPS2: Final = 9.0
_LARGEST_STEER_RAD: Final = 0.6
_LEAST_REACH_M: Final = 6.0
_PUSHES_PER_S: Final = 1.2
"""Acceleration per m/s of missing speed."""
_BRAKES_PER_S: Final = 3.0
"""Deceleration per m/s of excess speed; it is higher, so that drivers do not cross a line."""


def steered(
    sight: Sight,
    wanted_mps: float,
    offset_m: float,
    lights: int = int(Lights.NONE),
    hardest_mps2: float = 3.5,
) -> AvControl:
    """Control for a step: proportional speed control, and steering by pure pursuit of the path.

    Args:
        sight: The step.
        wanted_mps: Speed to come to.
        offset_m: Place across the way to come to, left positive.
        lights: Indicators.
        hardest_mps2: Limit of braking.
    """
    missing_mps = wanted_mps - sight.speed_mps
    push = (_BRAKES_PER_S if missing_mps < 0.0 else _PUSHES_PER_S) * missing_mps
    brake = min(max(-push, 0.0), hardest_mps2) / _FULL_BRAKE_MPS2
    if wanted_mps < 0.05 and sight.speed_mps < 0.3:
        brake = 0.3
    throttle = 0.0 if brake else min(max(0.3 * push, 0.0), 0.7)
    curve = sight.way.curve
    target = curve.offset_points(sight.s_m + _reach_m(sight), offset_m)
    here = curve.offset_points(sight.s_m, sight.left_m)
    yaw = float(curve.heading_rad(sight.s_m)) + sight.turn_rad
    dx, dy = float(target[0] - here[0]), float(target[1] - here[1])
    side = math.cos(yaw) * dy - math.sin(yaw) * dx
    steer = math.atan(2.0 * _WHEELBASE_M * side / max(dx * dx + dy * dy, 1.0))
    return AvControl(sight.step, throttle, brake, min(max(steer, -_LARGEST_STEER_RAD), _LARGEST_STEER_RAD), lights)


def _reach_m(sight: Sight) -> float:
    return max(_LEAST_REACH_M, sight.speed_mps)
