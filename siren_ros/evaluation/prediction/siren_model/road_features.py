"""What each path of a sample is like: lane, stop lines, signals, and the vehicle that is ahead on it."""

from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.protocol.samples import SampleBatch
from siren_ros.evaluation.prediction.siren_model.path_choice import PathChoice
from siren_ros.numerics.arrays import Codes, Floats, Rows
from siren_ros.roads.road_network import NO_LANE, Connection, LaneKind, RoadNetwork

_LETTERS: Final = {"red": "ru", "yellow": "yY", "green": "gG", "priority": "G"}
"""Features of SUMO's signal letters; none holds for a signal that is off."""
_LINE_BEHIND_M: Final = 1.0
"""A stop line counts as ahead until the front bumper is this far past it."""
_FAR_M: Final = 100.0
"""Distance that stands for "none"."""
_LINES: Final = 2
"""Stop lines of a path that are described."""
_KINDS: Final = {
    LaneKind.DRIVING: "lane",
    LaneKind.SHOULDER: "shoulder",
    LaneKind.INTERNAL: "across",
}


def lane_columns(network: RoadNetwork, choice: PathChoice) -> dict[str, Floats]:
    """The lane that a path starts in, and how the vehicle stands in it; each of shape ``(N, PATHS)``."""
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
    """The next stop lines along each path and what binds there; each of shape ``(N, PATHS)``."""
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


_LINE_NAMES: Final = (
    "distance",
    "there",
    "signal",
    *_LETTERS,
    "must_stop",
    "gives_way",
    "straight",
    "left",
    "right",
)


def _rule(batch: SampleBatch, movement: Connection, frame: Rows) -> Floats:
    """Values of ``_LINE_NAMES`` (the distance 0) at some frames, shape ``(len(frame), …)``."""
    codes = _link_codes(batch, movement)[frame]
    fixed = [
        float(movement.must_stop),
        float(movement.gives_way),
        *(float(movement.direction.lower() == letter) for letter in "slr"),
    ]
    shown = [np.isin(codes, [ord(letter) for letter in letters]).astype(np.float64) for letters in _LETTERS.values()]
    same = np.ones(len(frame))
    return np.stack((0.0 * same, same, (codes > 0) * same, *shown, *(value * same for value in fixed)), axis=-1)


def _link_codes(batch: SampleBatch, movement: Connection) -> Codes:
    known = batch.signals.get(movement.signal_id or "")
    if known is None or not 0 <= movement.signal_link < known.shape[1]:
        return np.zeros(len(batch.step), dtype=np.uint8)
    return known[:, movement.signal_link]


_LANE_NAMES: Final = ("limit", "width", "right", "left", "shoulder_right", *_KINDS.values())


def _lane_table(network: RoadNetwork) -> Floats:
    """Values of ``_LANE_NAMES`` of each lane, and a last row of zeros, which NO_LANE (−1) takes.

    ``right`` and ``left`` are the distances from the centre line to the edges of the carriageway.
    """
    table = np.zeros((len(network.lanes) + 1, len(_LANE_NAMES)))
    for edge in network.edges:
        lanes = [network.lanes[index] for index in edge.lanes]
        driven = [lane for lane in lanes if lane.kind in (LaneKind.DRIVING, LaneKind.INTERNAL)]
        for lane in lanes:
            right = sum(each.width_m for each in driven if each.position < lane.position)
            left = sum(each.width_m for each in driven if each.position > lane.position)
            shoulder = any(each.kind is LaneKind.SHOULDER and each.position < lane.position for each in lanes)
            half = 0.5 * lane.width_m
            kinds = [float(lane.kind is kind) for kind in _KINDS]
            table[lane.index] = (lane.speed_limit_mps, lane.width_m, right + half, left + half, shoulder, *kinds)
    return table
