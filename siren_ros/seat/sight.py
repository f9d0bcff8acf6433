"""What a driver in the seat sees at a step, relative to the way that it drives."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.numerics.geometry import wrap_angle
from siren_ros.seat.way import Way
from siren_ros.world.actors import ActorDescription, ActorStates, Lights
from siren_ros.world.traffic_state import SignalState

_AHEAD_M: Final = 60.0
_BEHIND_M: Final = 15.0
_ASIDE_M: Final = 8.0


@dataclass(frozen=True)
class Siren:
    """An EMV whose siren sounds."""

    actor_id: int
    gap_m: float
    """From its front to the own rear along the own heading; negative beside the own vehicle and ahead of it."""
    left_m: float
    """Of its centre from the own one."""
    speed_mps: float
    behind: bool
    """Whether it comes from behind on this road: it has not passed, and drives in the same direction."""
    ahead_m: float
    """From the own front to its rear; negative beside the own vehicle and behind it."""
    along: bool
    """Whether it drives on this road, in the same direction."""


@dataclass(frozen=True)
class Other:
    """A vehicle or a person near the own place on the way, or ahead."""

    gap_m: float
    """From the own front to it, along the way; negative beside the own vehicle and behind it."""
    left_m: float
    """Of its centre from the way."""
    half_width_m: float
    """Across the way."""
    speed_mps: float
    """Along the way."""


@dataclass(frozen=True)
class Sight:
    """A step from the seat. Offsets are across the way, left positive."""

    step: int
    way: Way
    s_m: float
    """Arc length of the own centre on the way."""
    left_m: float
    turn_rad: float
    """Own heading from the way's."""
    speed_mps: float
    length_m: float
    width_m: float
    sirens: tuple[Siren, ...]
    others: tuple[Other, ...]
    red_m: float
    """From the own front to the next line of the way that is red; infinite without one."""
    in_junction: bool


def sight_of(
    states: ActorStates,
    signals: tuple[SignalState, ...],
    actors: dict[int, ActorDescription],
    actor_id: int,
    way: Way,
    behind_m: float = _BEHIND_M,
) -> Sight:
    """What the driver of an actor sees.

    Args:
        states: The world, on a map where traffic keeps right.
        signals: States of the signals.
        actors: Bodies of those in the world.
        actor_id: The own vehicle, which is in the world.
        way: Its way.
        behind_m: How far behind the own centre others are seen.
    """
    row = int(np.searchsorted(states.actor_id, actor_id))
    body = actors[actor_id]
    x, y, yaw = (float(column[row]) for column in (states.x_m, states.y_m, states.yaw_rad))
    s, left = (float(value) for value in way.curve.project(np.array([x, y])))
    speeds = np.hypot(states.vx_mps, states.vy_mps)
    heading = float(way.curve.heading_rad(s))
    sirens, others = [], []
    dx, dy = states.x_m - x, states.y_m - y
    ahead = dx * np.cos(yaw) + dy * np.sin(yaw)
    aside = dy * np.cos(yaw) - dx * np.sin(yaw)
    near = np.flatnonzero((np.hypot(dx, dy) < 2.0 * _AHEAD_M) & (np.arange(len(states)) != row))
    for k in near.tolist():
        other = actors[int(states.actor_id[k])]
        if other.is_emv and states.lights[k] & Lights.SIREN:
            reach = 0.5 * (body.length_m + other.length_m)
            sirens.append(
                _siren(
                    other,
                    (float(states.x_m[k]), float(states.y_m[k]), float(states.yaw_rad[k])),
                    s,
                    left,
                    way,
                    reach,
                    (float(ahead[k]), float(aside[k]), float(states.yaw_rad[k]) - yaw),
                    float(speeds[k]),
                )
            )
        if -behind_m < ahead[k] < _AHEAD_M:
            at, off = (float(value) for value in way.curve.project(np.array([states.x_m[k], states.y_m[k]])))
            turned = float(states.yaw_rad[k]) - float(way.curve.heading_rad(at))
            cos, sin = abs(np.cos(turned)), abs(np.sin(turned))
            gap = at - s - 0.5 * body.length_m - 0.5 * (other.length_m * cos + other.width_m * sin)
            half = 0.5 * (other.length_m * sin + other.width_m * cos)
            others.append(Other(gap, off, float(half), float(speeds[k] * np.cos(turned))))
    states_of = {signal.signal_id: signal.state for signal in signals}
    red = [
        line.at_m - s - 0.5 * body.length_m
        for line in way.lines
        if line.at_m > s and _is_red(states_of.get(line.connection.signal_id or "", ""), line.connection.signal_link)
    ]
    return Sight(
        states.step,
        way,
        s,
        left,
        float(wrap_angle(yaw - heading)),
        float(speeds[row]),
        body.length_m,
        body.width_m,
        tuple(sirens),
        tuple(others),
        min(red, default=np.inf),
        bool(way.in_junction[way.row(s)]),
    )


def _siren(
    emv: ActorDescription,
    pose: tuple[float, float, float],
    s_m: float,
    left_m: float,
    way: Way,
    reach_m: float,
    seen: tuple[float, float, float],
    speed_mps: float,
) -> Siren:
    """An EMV, as it drives along the own way; where it does not, as it is seen from the own vehicle.

    Args:
        emv: The EMV.
        pose: x, y and yaw of its centre.
        s_m: Arc length of the own centre.
        left_m: Of the own centre from the way.
        way: The own way.
        reach_m: Half of both lengths.
        seen: How far ahead and to the left of the own centre it is, and its heading from the own one.
        speed_mps: Of the EMV.
    """
    at, off = (float(value) for value in way.curve.project(np.array(pose[:2])))
    on_way = (at - s_m, off - left_m, pose[2] - float(way.curve.heading_rad(at)))
    ahead, aside, along = next(
        (
            (ahead, aside, True)
            for ahead, aside, turn in (on_way, seen)
            if abs(float(wrap_angle(turn))) < np.pi / 3.0 and abs(aside) < _ASIDE_M
        ),
        (seen[0], seen[1], False),
    )
    return Siren(emv.actor_id, -ahead - reach_m, aside, speed_mps, along and ahead <= reach_m, ahead - reach_m, along)


def _is_red(state: str, link: int) -> bool:
    return len(state) > link >= 0 and state[link] in "rRyY"
