"""L3: civilians move up along the lane's edge if an EMV stands behind them, over the stop line if necessary."""

import math
from typing import Final

from siren_ros.behaviour.civilians.unit import YieldUnit
from siren_ros.behaviour.driving.lane_change import gaps_in_lane
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.numerics.units import steps_from_s

_BEHIND: Final = 0.5
"""Cosine between a vehicle's direction and the one from the EMV to it above which the EMV counts as behind."""


def emv_waits_behind(view: StepView, row: int, emv_row: int) -> bool:
    """Whether an EMV stands close behind a vehicle and points towards it."""
    seen = view.seen
    if emv_row < 0 or float(seen.speed_mps[emv_row]) > view.world.constants.gap_escape.blocked_speed_mps:
        return False
    dx, dy = float(seen.x_m[row] - seen.x_m[emv_row]), float(seen.y_m[row] - seen.y_m[emv_row])
    distance = math.hypot(dx, dy)
    if distance > view.world.config.pull_over.room_range_m:
        return False
    ahead = float(seen.cos[emv_row]) * dx + float(seen.sin[emv_row]) * dy
    along = float(seen.cos[row]) * dx + float(seen.sin[row]) * dy
    return min(ahead, along) > _BEHIND * distance


def makes_room(unit: YieldUnit, view: StepView) -> bool:
    """Whether the EMV has been waiting behind a driver for long enough."""
    return unit.emv_waits_steps >= steps_from_s(view.world.config.pull_over.room_after_s)


def may_go_on(unit: YieldUnit, view: StepView, row: int, lane: int) -> bool:
    """Whether a driver who holds has the space to finish the pull-over, or to make room."""
    config = view.world.config.pull_over
    to_finish = config.resume_gap_m if unit.partial else math.inf
    needed_m = min(to_finish, config.room_gap_m if makes_room(unit, view) else math.inf)
    return needed_m < math.inf and gaps_in_lane(view, row, lane).front_m > needed_m
