"""Manoeuvring at walking pace: the body's own outline along the path decides how far a driver goes."""

from typing import Final

import numpy as np

from siren_ros.behaviour.driving.free_space import Body, FreeWay, Obstacles, SpeedLimit
from siren_ros.behaviour.driving.navigator import NavigatorState
from siren_ros.behaviour.driving.situation import StepView

_REACH_M: Final = 8.0
"""How far ahead a driver at walking pace looks."""
_ALONG: Final = 0.7
"""Cosine above which a vehicle counts as one of the same direction."""
_STILL_MPS: Final = 0.3


def manoeuvring_limit(state: NavigatorState, view: StepView, row: int) -> SpeedLimit:
    """How fast a driver may go sideways between others so that the body touches nobody.

    The collision handling watches the strip ahead of the vehicle. Ends that swing out towards a vehicle at the side,
    and vehicles at the side that come on, are seen here.
    """
    path, config = state.path, view.world.config.manoeuvring
    if path is None:
        return SpeedLimit()
    seen = view.seen
    x, y, yaw = view.pose(row)
    body = Body.of(seen, row)
    rows = seen.near(x, y, _REACH_M + 2.0 * body.half_length_m + config.watch_m, but=row)
    if len(rows) == 0:
        return SpeedLimit()
    speed = seen.speed_mps[rows]
    cos, sin = float(seen.cos[row]), float(seen.sin[row])
    along = cos * seen.cos[rows] + sin * seen.sin[rows] > _ALONG
    ahead = cos * (seen.x_m[rows] - x) + sin * (seen.y_m[rows] - y) - seen.half_length_m[rows] > body.half_length_m
    leads = along & ahead
    obstacles = Obstacles.swept(seen, rows, np.where(leads | (speed < _STILL_MPS), 0.0, config.watch_s))
    credit = np.where(leads, speed**2 / (2.0 * config.leader_brake_mps2), 0.0)
    progress, left = path.curve.nearest_to(state.progress_m, x, y)
    rear = view.vehicle(row).centre_ahead_of_rear_axle_m
    way = FreeWay.along(path, (progress, left, yaw), rear, _REACH_M, body, obstacles, credit)
    own = float(seen.speed_mps[row])
    return way.limit(own, config.squeezes, config.stop_short_m, config.brake_mps2, config.clearance_m)
