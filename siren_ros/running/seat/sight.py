"""What a driver sees at a step, relative to its path."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.running.seat.way import Way
from siren_ros.simulation.world.actors import ActorDescription, ActorStates, Lights
from siren_ros.simulation.world.traffic_state import SignalState

_AHEAD_M: Final = 60.0
_BEHIND_M: Final = 30.0
_ASIDE_M: Final = 8.0
_RED: Final = frozenset("rRyY")


@dataclass(frozen=True)
class Siren:
    """An EMV with its siren on."""

    actor_id: int
    gap_m: float
    """Gap from the EMV's front to the own rear along the own heading; negative beside and ahead."""
    left_m: float
    """Lateral distance of its centre from the own centre, positive to the left."""
    speed_mps: float
    behind: bool
    """Whether it comes from behind on this road: it has not passed, and drives in the same direction."""
    ahead_m: float
    """Distance from the own front to its rear; negative beside and behind."""
    along: bool
    """Whether it drives on this road in the same direction."""


@dataclass(frozen=True)
class Other:
    """A vehicle or person on the path ahead or near the own position."""

    gap_m: float
    """Gap from the own front along the path; negative beside and behind."""
    left_m: float
    """Offset of its centre from the path, positive to the left."""
    half_width_m: float
    """Half width across the path."""
    speed_mps: float
    """Speed along the path."""


@dataclass(frozen=True)
class Sight:
    """What a driver sees at a step. Offsets are lateral, positive to the left."""

    step: int
    way: Way
    s_m: float
    """Arc length of the own centre on the path."""
    left_m: float
    turn_rad: float
    """Own heading relative to the path."""
    speed_mps: float
    length_m: float
    width_m: float
    sirens: tuple[Siren, ...]
    others: tuple[Other, ...]
    red_m: float
    """Distance from the own front to the next red line on the path; infinite without one."""
    in_junction: bool
    states: ActorStates
    """States of all actors."""
    bodies: Mapping[int, ActorDescription]
    """Descriptions of the actors by id."""
    row: int
    """Row of the own vehicle in ``states``."""

    @property
    def body(self) -> ActorDescription:
        """Description of the own vehicle."""
        return self.bodies[int(self.states.actor_id[self.row])]


def sight_of(
    states: ActorStates,
    signals: tuple[SignalState, ...],
    actors: Mapping[int, ActorDescription],
    actor_id: int,
    way: Way,
    near_m: float,
) -> Sight:
    """Make the sight of an actor's driver.

    Args:
        states: The world, on a map where traffic keeps right.
        signals: States of the signals.
        actors: Bodies of those in the world.
        actor_id: The own vehicle, which is in the world.
        way: Its way.
        near_m: Arc length on the way where it was a step before: a long way comes back to roads where it was before.
    """
    row = int(np.searchsorted(states.actor_id, actor_id))
    body = actors[actor_id]
    x, y, yaw = (float(column[row]) for column in (states.x_m, states.y_m, states.yaw_rad))
    speeds = np.hypot(states.vx_mps, states.vy_mps)
    dx, dy = states.x_m - x, states.y_m - y
    ahead = dx * np.cos(yaw) + dy * np.sin(yaw)
    aside = dy * np.cos(yaw) - dx * np.sin(yaw)
    near = (np.hypot(dx, dy) < 2.0 * _AHEAD_M) & (np.arange(len(states)) != row)
    sounds = (states.lights & Lights.SIREN) != 0
    sees = near & (ahead > -_BEHIND_M) & (ahead < _AHEAD_M)
    rows = [row, *np.flatnonzero(sees | (near & sounds)).tolist()]
    own, *places = _on_way(way, states, rows, near_m)
    sirens, others = [], []
    for k, place in zip(rows[1:], places, strict=True):
        other, speed = actors[int(states.actor_id[k])], float(speeds[k])
        if other.is_emv and sounds[k]:
            along = place.s_m - own.s_m, place.left_m - own.left_m, place.turn_rad
            straight = float(ahead[k]), float(aside[k]), float(states.yaw_rad[k]) - yaw
            sirens.append(_siren(other, speed, 0.5 * (body.length_m + other.length_m), along, straight))
        if sees[k]:
            others.append(_other(other, speed, place, place.s_m - own.s_m - 0.5 * body.length_m))
    return Sight(
        states.step,
        way,
        own.s_m,
        own.left_m,
        float(wrap_angle(own.turn_rad)),
        float(speeds[row]),
        body.length_m,
        body.width_m,
        tuple(sirens),
        tuple(others),
        _red_line_m(way, own.s_m, signals) - own.s_m - 0.5 * body.length_m,
        bool(way.in_junction[way.row(own.s_m)]),
        states,
        actors,
        row,
    )


@dataclass(frozen=True)
class _OnWay:
    """Position on the path: arc length, offset, and heading relative to the path."""

    s_m: float
    left_m: float
    turn_rad: float


def _on_way(way: Way, states: ActorStates, rows: list[int], near_m: float) -> list[_OnWay]:
    points = np.stack((states.x_m[rows], states.y_m[rows]), axis=-1)
    s_m, left_m = way.curve.project_near(points, near_m, 2.0 * _AHEAD_M)
    turns = states.yaw_rad[rows] - way.curve.heading_rad(s_m)
    return [_OnWay(*place) for place in zip(s_m.tolist(), left_m.tolist(), turns.tolist(), strict=True)]


def _other(body: ActorDescription, speed_mps: float, place: _OnWay, ahead_m: float) -> Other:
    """Make an ``Other`` for an actor near the path, at this distance along it from the own front."""
    turned = np.cos(place.turn_rad)
    cos, sin = abs(turned), abs(np.sin(place.turn_rad))
    gap = ahead_m - 0.5 * (body.length_m * cos + body.width_m * sin)
    half = 0.5 * (body.length_m * sin + body.width_m * cos)
    return Other(float(gap), place.left_m, float(half), float(speed_mps * turned))


def _siren(emv: ActorDescription, speed_mps: float, reach_m: float, *seen: tuple[float, float, float]) -> Siren:
    """Make a ``Siren`` for an EMV: relative to the own path if it drives along it, otherwise in a straight line.

    Args:
        emv: The EMV.
        speed_mps: Its speed.
        reach_m: Half of both lengths.
        seen: How far ahead and to the left of the own centre it is, and its heading from the own one: along the way,
            and straight.
    """
    here = (one for one in seen if abs(float(wrap_angle(one[2]))) < np.pi / 3.0 and abs(one[1]) < _ASIDE_M)
    found = next(here, None)
    ahead, aside, _ = found or seen[-1]
    behind = found is not None and ahead <= reach_m
    return Siren(emv.actor_id, -ahead - reach_m, aside, speed_mps, behind, ahead - reach_m, found is not None)


def _red_line_m(way: Way, from_m: float, signals: tuple[SignalState, ...]) -> float:
    """Arc length of the next red or yellow line beyond a place; infinite without one."""
    states = {signal.signal_id: signal.state for signal in signals}
    lines = (line for line in way.lines if line.at_m > from_m)
    red = (line for line in lines if line.connection.letter_in(states.get(line.connection.signal_id or "", "")) in _RED)
    return min((line.at_m for line in red), default=np.inf)
