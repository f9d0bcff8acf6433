"""The lattice of a gap escape: offsets and directions beside a reference line, and how near the vehicle is there."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.behaviour.config import GapEscapeConfig
from siren_ros.behaviour.driving.free_space import Body, Obstacles, clearances_m, separations_m
from siren_ros.behaviour.paths.curve import Curve
from siren_ros.numerics.arrays import Floats

_STEEPEST: Final = 0.8
"""Largest slope of a path against the reference line."""
_NEAR_M: Final = 0.3
"""Vehicles nearer than this at the start count only at poses that are nearer still."""


@dataclass(frozen=True, eq=False)
class RoadSpace:
    """The road beside a reference line at stations ``s_m``; offsets left positive, each of shape ``(S,)``."""

    s_m: Floats
    right_m: Floats
    driving_right_m: Floats
    left_m: Floats
    opposite_left_m: Floats
    """Left edge of the opposite lane that may be used at a price."""
    middle_m: Floats
    """Line that is preferred where all else is equal."""


@dataclass(frozen=True)
class Start:
    """How the vehicle stands against the reference line, and what it can steer."""

    left_m: float
    """Of the rear axle, whose direction of motion is the vehicle's own."""
    slope: float
    body: Body
    centre_ahead_m: float
    """From the rear axle to the footprint's centre."""
    wheelbase_m: float
    sharpest_1pm: float


@dataclass(frozen=True, eq=False)
class Lattice:
    """Nodes are offsets ``left_m`` (D) times slopes (H), one layer per station (S)."""

    left_m: Floats
    slope: Floats
    start: tuple[int, tuple[int, ...]]
    """Offset, and the slopes on both sides of the vehicle's own."""
    present_m: Floats
    """Distance from each obstacle at the start, infinite from those that are not near, shape ``(M,)``."""
    clearance_m: Floats
    """Shape ``(S, D, H)``; −inf beyond the road."""
    between_m: Floats
    """The same half way from each station to the next one."""
    price: Floats
    """Per station and offset, shape ``(S, D)``."""
    turns: tuple[range, ...]
    """Changes of slope, in steps, that can be steered from each station to the next."""


def lattice_of(curve: Curve, road: RoadSpace, start: Start, obstacles: Obstacles, config: GapEscapeConfig) -> Lattice:
    """The lattice at the stations of a road, with the clearance of each node; arguments as for ``search_lattice``."""
    step = config.station_m
    grain = 0.5 * step * config.slope_step
    reach = start.body.half_width_m
    low = min(float(road.right_m.min()) + reach, start.left_m)
    high = max(float(road.opposite_left_m.max()) - reach, start.left_m)
    below, above = math.ceil((start.left_m - low) / grain), math.ceil((high - start.left_m) / grain)
    left = start.left_m + grain * np.arange(-below, above + 1)
    slopes = round(_STEEPEST / config.slope_step)
    slope = config.slope_step * np.arange(-slopes, slopes + 1)
    steps = min(max(start.slope / config.slope_step, -slopes), slopes) + slopes
    heading = curve.heading_at(road.s_m)
    bend = np.gradient(heading, road.s_m)
    turns = tuple(
        range(
            min(math.ceil((-start.sharpest_1pm - k) * step / config.slope_step), 0),
            max(math.floor((start.sharpest_1pm - k) * step / config.slope_step), 0) + 1,
        )
        for k in bend.tolist()
    )
    present = _present_m(curve, road, start, obstacles)
    clearance = _clearances(curve, _halved(road), (left, slope), start, obstacles, present, config.edge_overhang_m)
    return Lattice(
        left_m=left,
        slope=slope,
        start=(below, tuple(sorted({math.floor(steps), math.ceil(steps)}))),
        present_m=present,
        clearance_m=clearance[::2],
        between_m=clearance[1::2],
        price=_prices(road, left, start.body, config),
        turns=turns,
    )


def _halved(road: RoadSpace) -> RoadSpace:
    """The road at twice as many stations."""
    half = np.arange(2 * len(road.s_m) - 1) / 2.0
    lines = (road.s_m, road.right_m, road.driving_right_m, road.left_m, road.opposite_left_m, road.middle_m)
    return RoadSpace(*(np.interp(half, np.arange(len(line)), line) for line in lines))


def _present_m(curve: Curve, road: RoadSpace, start: Start, obstacles: Obstacles) -> Floats:
    ahead, yaw = start.centre_ahead_m, float(curve.heading_at(road.s_m[:1])[0]) + math.atan(start.slope)
    x, y = curve.offset_at(road.s_m[:1], np.array([start.left_m]))[0]
    centre = np.array([x + ahead * math.cos(yaw)]), np.array([y + ahead * math.sin(yaw)])
    present = separations_m(*centre, np.array([yaw]), start.body, obstacles)[0]
    return np.where(present < _NEAR_M, present, np.inf)


def _clearances(
    curve: Curve,
    road: RoadSpace,
    nodes: tuple[Floats, Floats],
    start: Start,
    obstacles: Obstacles,
    present: Floats,
    edge_overhang_m: float,
) -> Floats:
    """Distance from the nearest obstacle at every node, offsets times slopes."""
    left, slope = nodes
    body, turned = start.body, np.arctan(slope)
    heading, place = curve.heading_at(road.s_m), curve.at(road.s_m)
    ahead = start.centre_ahead_m
    near = math.hypot(body.half_length_m, body.half_width_m) + ahead + 1.0
    reach_right, reach_left = _wheels_m(start, turned)
    own_right, own_left = _wheels_m(start, np.arctan(np.array([start.slope])))
    over_right = max(float(road.right_m[0] - start.left_m + own_right[0]), edge_overhang_m)
    over_left = max(float(start.left_m + own_left[0] - road.opposite_left_m[0]), edge_overhang_m)
    clearance = np.empty((len(road.s_m), len(left), len(slope)))
    extent = np.hypot(obstacles.half_length_m, obstacles.half_width_m)
    for k, angle in enumerate(heading.tolist()):
        cos, sin = math.cos(angle), math.sin(angle)
        along = cos * (obstacles.x_m - place[k, 0]) + sin * (obstacles.y_m - place[k, 1])
        picked = np.abs(along) < near + extent
        yaw = angle + turned
        x = (place[k, 0] - sin * left)[:, None] + ahead * np.cos(yaw)
        y = (place[k, 1] + cos * left)[:, None] + ahead * np.sin(yaw)
        clearance[k] = clearances_m(x, y, yaw, body, obstacles.take(picked), present[picked])
        off = left[:, None] - reach_right < road.right_m[k] - over_right
        off |= left[:, None] + reach_left > road.opposite_left_m[k] + over_left
        clearance[k][off] = -np.inf
    return clearance


def _wheels_m(start: Start, turned_rad: Floats) -> tuple[Floats, Floats]:
    """How far wheels lie to the right and to the left of the rear axle's middle, at angles to the road."""
    half = start.body.half_width_m * np.cos(turned_rad)
    front = start.wheelbase_m * np.sin(turned_rad)
    return half + np.maximum(-front, 0.0), half + np.maximum(front, 0.0)


def _prices(road: RoadSpace, left: Floats, body: Body, config: GapEscapeConfig) -> Floats:
    """Price of a station at every offset, in metres of way."""
    half = body.half_width_m
    on_shoulder = left - half < road.driving_right_m[:, None] - 1e-6
    beyond = np.clip(left + half - road.left_m[:, None], 0.0, 1.0)
    opposite = np.where(beyond > 0.0, np.maximum(beyond, 0.2), 0.0)
    share = config.station_m / config.horizon_m
    aside = config.offset_cost * np.minimum(np.abs(left - road.middle_m[:, None]), 4.0)
    return np.asarray(share * (config.shoulder_cost_m * on_shoulder + config.opposite_cost_m * opposite) + aside)
