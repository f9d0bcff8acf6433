"""Input columns of the network: history of sample and neighbours; lane, stop lines, signals and traffic of paths.

Positions are in the sample's frame: origin at its centre, x forward.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.scoring.evaluation.prediction.baselines import RED_LETTERS
from siren_ros.scoring.evaluation.prediction.samples import SampleBatch
from siren_ros.scoring.evaluation.prediction.siren_model.paths import PathChoice, rank_within
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import Lights

NEIGHBOURS: Final = 12
_RANGE_M: Final = 80.0
POSITION_SCALE_M: Final = 20.0
SPEED_SCALE_MPS: Final = 10.0
_PAST: Final = (-6, -11, -16)
"""Points of a neighbour's history that are inputs: 1, 2 and 3 s ago."""
_SHOWN_LIGHTS: Final = {
    "brake": Lights.BRAKE,
    "indicates_left": Lights.INDICATOR_LEFT,
    "indicates_right": Lights.INDICATOR_RIGHT,
    "beacon": Lights.BEACON,
    "siren": Lights.SIREN,
}


@dataclass(frozen=True)
class NeighbourChoice:
    """Up to ``NEIGHBOURS`` other vehicles for each of N samples: emergency vehicles first, then by distance."""

    actor: Rows
    """Rows of ``SampleBatch.actors``, 0 for an empty place; shape ``(N, NEIGHBOURS)``."""
    there: Flags
    """Whether a place has a neighbour, shape ``(N, NEIGHBOURS)``."""


def choose_neighbours(batch: SampleBatch) -> NeighbourChoice:
    """Choose the neighbours of each sample within 80 m."""
    sample, other = batch.neighbours()
    xy, is_emv = batch.actors.xy_m[:, -1], batch.actors.is_emv
    distance = np.hypot(*(xy[other] - batch.xy_m[sample]).T)
    near = np.flatnonzero(distance <= _RANGE_M)
    sample, other, distance = sample[near], other[near], distance[near]
    order = np.lexsort((distance, ~is_emv[other], sample))
    sample, other = sample[order], other[order]
    place = rank_within(sample)
    few = place < NEIGHBOURS
    actor, there = np.zeros((len(batch), NEIGHBOURS), dtype=np.intp), np.zeros((len(batch), NEIGHBOURS), dtype=np.bool_)
    actor[sample[few], place[few]], there[sample[few], place[few]] = other[few], True
    return NeighbourChoice(actor, there)


def in_frame_of(batch: SampleBatch, vectors: Floats) -> Floats:
    """Rotate vectors from the frame ``map`` to each sample's frame; shape ``(N, …, 2)``."""
    shape = (len(batch), *(1,) * (vectors.ndim - 2))
    cos, sin = np.cos(batch.yaw_rad).reshape(shape), np.sin(batch.yaw_rad).reshape(shape)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack((cos * x + sin * y, cos * y - sin * x), axis=-1)


def target_columns(batch: SampleBatch) -> dict[str, Floats]:
    """Columns of the sample itself and of the nearest emergency vehicle; each of shape ``(N,)``."""
    actors, rows = batch.actors, batch.target
    past = in_frame_of(batch, actors.xy_m[rows] - batch.xy_m[:, None]) / POSITION_SCALE_M
    velocity = in_frame_of(batch, actors.velocity_mps[rows]) / SPEED_SCALE_MPS
    turned = np.asarray(wrap_angle(actors.yaw_rad[rows] - batch.yaw_rad[:, None]))
    points = past.shape[1]
    return {
        **{f"x{point - points}": past[:, point, 0] for point in range(points - 1)},
        **{f"y{point - points}": past[:, point, 1] for point in range(points - 1)},
        **{f"vx{point - points}": velocity[:, point, 0] for point in range(points)},
        **{f"vy{point - points}": velocity[:, point, 1] for point in range(points)},
        **{f"turned{point - points}": turned[:, point] for point in range(0, points - 1, 2)},
        # Changes of the velocity over the last 0.2, 0.6 and 1.4 s, per second.
        **{
            f"{axis}_gained_in{steps}": (velocity[:, -1, number] - velocity[:, -1 - steps, number]) / (0.2 * steps)
            for steps in (1, 3, 7)
            for number, axis in enumerate("xy")
        },
        **_body_columns(batch, rows),
    }


def neighbour_columns(batch: SampleBatch, choice: NeighbourChoice) -> dict[str, Floats]:
    """Columns of the neighbours in the sample's frame, 0 for empty places; each of shape ``(N, NEIGHBOURS)``."""
    actors, rows = batch.actors, choice.actor
    points = actors.xy_m.shape[1]
    shown = np.array([points - 1, *(points + point for point in _PAST)])
    seen = actors.observed[rows][..., shown]
    place = in_frame_of(batch, actors.xy_m[rows][:, :, shown] - batch.xy_m[:, None, None]) / POSITION_SCALE_M
    moved = np.where(seen[..., None], place - place[:, :, :1], 0.0)
    velocity = in_frame_of(batch, actors.velocity_mps[rows][:, :, shown]) / SPEED_SCALE_MPS
    gained = np.where(seen[..., None], velocity[:, :, :1] - velocity, 0.0)
    turned = actors.yaw_rad[rows, -1] - batch.yaw_rad[:, None]
    columns = {
        "x": place[:, :, 0, 0],
        "y": place[:, :, 0, 1],
        "distance": np.hypot(place[:, :, 0, 0], place[:, :, 0, 1]),
        "cos": np.cos(turned),
        "sin": np.sin(turned),
        "vx": velocity[:, :, 0, 0],
        "vy": velocity[:, :, 0, 1],
        "closing_x": velocity[:, :, 0, 0] - batch.speed_mps[:, None] / SPEED_SCALE_MPS,
        **{f"moved_x{at}": moved[:, :, number, 0] for number, at in enumerate(_PAST, 1)},
        **{f"moved_y{at}": moved[:, :, number, 1] for number, at in enumerate(_PAST, 1)},
        **{f"gained_x{at}": gained[:, :, number, 0] for number, at in enumerate(_PAST, 1)},
        **{f"seen{at}": seen[:, :, number].astype(np.float64) for number, at in enumerate(_PAST, 1)},
        **_body_columns(batch, rows),
    }
    return {name: np.where(choice.there, values, 0.0) for name, values in columns.items()}


def _body_columns(batch: SampleBatch, rows: Rows) -> dict[str, Floats]:
    actors = batch.actors
    lights = actors.lights[rows]
    return {
        "length": actors.length_m[rows] / 10.0,
        "width": actors.width_m[rows] / 2.0,
        "is_emv": actors.is_emv[rows].astype(np.float64),
        **{name: ((lights & light) != 0).astype(np.float64) for name, light in _SHOWN_LIGHTS.items()},
    }


_CHUNK: Final = 4096
"""Number of path-vehicle pairs whose distances are in memory at once."""
_FAR_M: Final = 100.0
"""Distance that stands for "no vehicle"."""
_SIDE_MARGIN_M: Final = 0.3
"""A vehicle with a smaller lateral gap counts as in the way."""
_OVERLAP_M: Final = 5.0
"""Limit of negative gaps (vehicles that overlap lengthwise); smaller values are set to it."""
_LEADERS: Final = ("leader", "second")
_NAMES: Final = tuple(f"{prefix}_{what}" for prefix in _LEADERS for what in ("gap", "there", "speed", "is_emv"))


def traffic_columns(
    batch: SampleBatch, others: NeighbourChoice, choice: PathChoice, points_m: Floats
) -> dict[str, Floats]:
    """Columns of the first two vehicles that reach into the strip along each path; each of shape ``(N, PATHS)``.

    The points of the paths are in the samples' frames, shape ``(N, PATHS, PATH_POINTS, 2)``.
    """
    actors, target = batch.actors, batch.target
    row, path, slot = np.nonzero(choice.there[:, :, None] & others.there[:, None])
    other = others.actor[row, slot]
    place = in_frame_of(batch, actors.xy_m[others.actor, -1] - batch.xy_m[:, None])[row, slot]
    along, aside = _on_paths(points_m, choice.spacing_m, row, path, place)
    strip = 0.5 * (actors.width_m[target[row]] + actors.width_m[other]) + _SIDE_MARGIN_M
    ahead = np.flatnonzero((aside < strip) & (along > 0.0))
    row, path, other = row[ahead], path[ahead], other[ahead]
    gap = along[ahead] - 0.5 * (actors.length_m[target[row]] + actors.length_m[other])
    key = row * points_m.shape[1] + path
    order = np.lexsort((gap, key))
    row, path, other, gap, key = row[order], path[order], other[order], gap[order], key[order]
    place_in_line = rank_within(key)
    velocity = actors.velocity_mps[:, -1]
    speed = np.hypot(velocity[:, 0], velocity[:, 1]) / SPEED_SCALE_MPS
    columns = {name: np.zeros(points_m.shape[:2]) for name in _NAMES}
    for number, prefix in enumerate(_LEADERS):
        columns[f"{prefix}_gap"][:] = 1.0
        pairs = np.flatnonzero(place_in_line == number)
        at = row[pairs], path[pairs]
        columns[f"{prefix}_gap"][at] = np.clip(gap[pairs], -_OVERLAP_M, _FAR_M) / _FAR_M
        columns[f"{prefix}_there"][at] = 1.0
        columns[f"{prefix}_speed"][at] = speed[other[pairs]]
        columns[f"{prefix}_is_emv"][at] = actors.is_emv[other[pairs]]
    return columns


def _on_paths(points_m: Floats, spacing_m: Floats, row: Rows, path: Rows, place_m: Floats) -> tuple[Floats, Floats]:
    """Arc length along the path and distance from it, of one position per pair of sample and path.

    A place behind the path has a negative arc length.
    """
    along, aside = np.empty(len(row)), np.empty(len(row))
    for first in range(0, len(row), _CHUNK):
        part = slice(first, first + _CHUNK)
        x, y = points_m[row[part], path[part]].transpose(2, 0, 1)
        step_x, step_y = np.diff(x, axis=1), np.diff(y, axis=1)
        apart_x, apart_y = place_m[part, :1] - x[:, :-1], place_m[part, 1:] - y[:, :-1]
        square = np.maximum(step_x * step_x + step_y * step_y, 1e-9)
        fraction = (apart_x * step_x + apart_y * step_y) / square
        # The first segment extends backwards, so that positions behind the path get a negative arc length.
        low = np.where(np.arange(fraction.shape[1]) == 0, -np.inf, 0.0)
        fraction = np.clip(fraction, low, 1.0)
        miss_x, miss_y = apart_x - fraction * step_x, apart_y - fraction * step_y
        distance = miss_x * miss_x + miss_y * miss_y
        best = distance.argmin(axis=1)
        rows = np.arange(len(best))
        along[part] = (best + fraction[rows, best]) * spacing_m[row[part]]
        aside[part] = np.sqrt(distance[rows, best])
    return along, aside


_LETTERS: Final = {"red": RED_LETTERS, "yellow": "yY", "green": "gG", "priority": "G"}
"""SUMO's letters for each signal feature; no feature is set for a signal that is off."""
_LINE_BEHIND_M: Final = 1.0
"""A stop line counts as ahead until the front bumper is this far beyond it."""
_LINES: Final = 2
"""Number of stop lines per path that are inputs."""
_KINDS: Final = {LaneKind.DRIVING: "lane", LaneKind.SHOULDER: "shoulder", LaneKind.INTERNAL: "across"}


def lane_columns(network: RoadNetwork, choice: PathChoice) -> dict[str, Floats]:
    """Columns of the lane in which a path starts, and of the vehicle's position in it; each of shape ``(N, PATHS)``."""
    lane = np.full(choice.index.shape, NO_LANE, dtype=np.intp)
    turn = np.zeros(choice.index.shape)
    remaining = np.zeros(choice.index.shape)
    for path, row, column in choice.groups():
        lane[row, column], turn[row, column] = path.first_lane, path.turn_rad
        remaining[row, column] = path.curve.length_m
    table = _lane_table(network)[lane]
    columns = dict(zip(_LANE_NAMES, np.moveaxis(table, -1, 0), strict=True))
    return {
        "offset": choice.offset_m / 2.0,
        "sin_turned": np.sin(choice.turned_rad),
        "turn": turn,
        "ends": np.clip(remaining - choice.arc_m, 0.0, _FAR_M) / _FAR_M,
        "limit": columns["limit"] / 10.0,
        "half_width": 0.25 * columns["width"],
        "to_right_edge": (columns["right"] + choice.offset_m) / 5.0,
        "to_left_edge": (columns["left"] - choice.offset_m) / 5.0,
        **{name: columns[name] for name in ("shoulder_right", *_KINDS.values())},
    }


def stop_line_columns(batch: SampleBatch, choice: PathChoice) -> dict[str, Floats]:
    """Columns of the next stop lines along each path and their rules; each of shape ``(N, PATHS)``."""
    frame, half_length = batch.actors.frame[batch.target], 0.5 * batch.actors.length_m[batch.target]
    table = np.zeros((*choice.index.shape, _LINES, len(_LINE_NAMES)))
    table[..., 0] = 1.0
    for path, row, column in choice.groups():
        if not path.stop_lines:
            continue
        arcs = np.array([line.arc_m for line in path.stop_lines])
        to_line = arcs - choice.arc_m[row, column, None] - half_length[row, None]
        first = (to_line < -_LINE_BEHIND_M).sum(axis=1)
        values = np.stack([_rule(batch, line.movement, frame[row]) for line in path.stop_lines], axis=1)
        for number in range(_LINES):
            has = np.flatnonzero(first + number < len(arcs))
            at = (row[has], column[has], number)
            table[at] = values[has, first[has] + number]
            table[(*at, 0)] = np.clip(to_line[has, first[has] + number], 0.0, _FAR_M) / _FAR_M
    return {
        f"line{number}_{name}": table[..., number, position]
        for number in range(_LINES)
        for position, name in enumerate(_LINE_NAMES)
    }


_FIXED_RULES: Final = ("must_stop", "gives_way", "straight", "left", "right")
_LINE_NAMES: Final = ("distance", "there", "signal", *_LETTERS, *_FIXED_RULES)


def _rule(batch: SampleBatch, movement: Connection, frame: Rows) -> Floats:
    """Values of ``_LINE_NAMES`` at some frames, with distance 0, shape ``(len(frame), …)``."""
    states, codes = batch.signals.get(movement.signal_id or ""), np.zeros(len(frame), dtype=np.uint8)
    if states is not None and 0 <= movement.signal_link < states.shape[1]:
        codes = states[frame, movement.signal_link]
    directions = [movement.direction.lower() == letter for letter in "slr"]
    fixed = [float(value) for value in (movement.must_stop, movement.gives_way, *directions)]
    shown = [np.isin(codes, [ord(letter) for letter in letters]).astype(np.float64) for letters in _LETTERS.values()]
    same = np.ones(len(frame))
    return np.stack((0.0 * same, same, (codes > 0) * same, *shown, *(value * same for value in fixed)), axis=-1)


_LANE_NAMES: Final = ("limit", "width", "right", "left", "shoulder_right", *_KINDS.values())


def _lane_table(network: RoadNetwork) -> Floats:
    """Values of ``_LANE_NAMES`` of each lane, with a last row of zeros for NO_LANE (−1).

    ``right`` and ``left`` are the distances from the centre line to the edges of the carriageway.
    """
    table = np.zeros((len(network.lanes) + 1, len(_LANE_NAMES)))
    for edge in network.edges:
        lanes = [network.lanes[index] for index in edge.lanes]
        driven = [lane for lane in lanes if lane.kind in (LaneKind.DRIVING, LaneKind.INTERNAL)]
        for lane in lanes:
            right = sum(other.width_m for other in driven if other.position < lane.position)
            left = sum(other.width_m for other in driven if other.position > lane.position)
            shoulder = any(other.kind is LaneKind.SHOULDER and other.position < lane.position for other in lanes)
            half = 0.5 * lane.width_m
            kinds = [float(lane.kind is kind) for kind in _KINDS]
            table[lane.index] = (lane.speed_limit_mps, lane.width_m, right + half, left + half, shoulder, *kinds)
    return table
