"""How likely a recorded scene is under simulated ones: the terms of the Waymo Open Sim Agents Challenge of 2025.

Each term is the likelihood of the recorded values under a histogram of the simulated ones, of each agent over all
rollouts and steps, as a geometric mean over agents and steps; the score is their weighted sum. Sources: N. Montali and
others, The Waymo Open Sim Agents Challenge, NeurIPS 2023, section 4; histograms, weights and smoothing of the
challenge's public configuration of 2025. Distances are those of footprints in the plane.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.base.numerics.geometry import footprint_corners, separation_m, wrap_angle
from siren_ros.errors import InputError

STEP_S: Final = 0.1
"""Time between two steps of agents."""


@dataclass(frozen=True)
class AgentTracks:
    """Poses of A agents over T steps of 0.1 s in a right-handed frame: arrays of shape ``(A, T)``."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    length_m: Floats
    width_m: Floats
    present: Flags
    """Whether an agent is there at a step; where it is not, the other values do not count."""
    red_crossed: Flags | None = None
    """Whether it crosses a stop line at red at a step; None where nobody does."""

    def __post_init__(self) -> None:
        """Refuse arrays of unequal shapes."""
        shapes = {name: np.shape(value) for name, value in vars(self).items() if value is not None}
        if len(set(shapes.values())) != 1 or len(np.shape(self.x_m)) != 2:
            raise InputError("agent tracks", str(shapes), "arrays of one shape (agents, steps)")


@dataclass(frozen=True)
class Histogram:
    """Bins of a term, and its weight in the score."""

    low: float
    high: float
    bins: int
    weight: float
    smoothing: float = 0.1
    """Count added to each bin, so that a value that no simulation has does not make the likelihood 0."""


def _yes_or_no(weight: float) -> Histogram:
    return Histogram(-0.5, 1.5, 2, weight, 0.001)


TERMS: Final[Mapping[str, Histogram]] = {
    "linear_speed": Histogram(0.0, 25.0, 10, 0.05),
    "linear_acceleration": Histogram(-12.0, 12.0, 11, 0.05),
    "angular_speed": Histogram(-0.628, 0.628, 11, 0.05),
    "angular_acceleration": Histogram(-3.14, 3.14, 11, 0.05),
    "distance_to_nearest_object": Histogram(-5.0, 40.0, 10, 0.1),
    "collision_indication": _yes_or_no(0.25),
    "time_to_collision": Histogram(0.0, 5.0, 10, 0.1),
    "distance_to_road_edge": Histogram(-20.0, 40.0, 10, 0.05),
    "offroad_indication": _yes_or_no(0.25),
    "traffic_light_violation": _yes_or_no(0.05),
}
"""The terms of the challenge's configuration of 2025."""
GROUPS: Final[Mapping[str, tuple[str, ...]]] = {
    "kinematic": ("linear_speed", "linear_acceleration", "angular_speed", "angular_acceleration"),
    "interactive": ("distance_to_nearest_object", "collision_indication", "time_to_collision"),
    "map_based": ("distance_to_road_edge", "offroad_indication", "traffic_light_violation"),
}
_FAR_M: Final = 1e10
_LONGEST_TTC_S: Final = 5.0
_TURNED_RAD: Final = np.radians(75.0)
_ALIGNED_RAD: Final = np.radians(10.0)
_OVERLAP_M: Final = 0.5
"""Bodies that overlap less across the way follow each other only if they are aligned."""


def score_sim_agents(
    logged: AgentTracks,
    rollouts: Sequence[AgentTracks],
    scored: Flags,
    road: "shapely.MultiPolygon | shapely.Polygon",
) -> dict[str, float]:
    """Score rollouts of a scene against what was recorded.

    It gives the likelihood of each of the ``TERMS``, the weighted mean of each of the ``GROUPS``, ``score`` (the
    weighted sum of all terms, the challenge's *realism meta-metric*) and ``min_ade_m``, the mean displacement of the
    nearest rollout.

    Args:
        logged: The recorded agents.
        rollouts: The same agents, simulated; the challenge takes 32.
        scored: Whether each agent is scored, shape ``(A,)``; the others can be hit.
        road: The surface for vehicles.

    Raises:
        InputError: No rollout, no agent to score, or rollouts of another shape.
    """
    if not rollouts or any(one.x_m.shape != logged.x_m.shape for one in rollouts):
        raise InputError("rollouts", len(rollouts), f"one or more of shape {logged.x_m.shape}")
    present = logged.present[scored]
    if not present.any():
        raise InputError("scored", int(np.sum(scored)), "at least one agent that is there")
    real = features_of(logged, scored, road)
    simulated: list[dict[str, Floats]] = []
    for before, one in zip((None, *rollouts), rollouts, strict=False):
        simulated.append(simulated[-1] if before is not None and _same(before, one) else features_of(one, scored, road))
    known = _known(present)
    terms = {}
    for name, histogram in TERMS.items():
        values, samples = real[name], np.stack([one[name] for one in simulated])
        if values.ndim == 2:
            terms[name] = _likelihood(histogram, values, samples, known.get(name, present))
        else:
            terms[name] = _likelihood(histogram, values[:, None], samples[..., None], np.ones((len(values), 1), bool))
    apart = [np.hypot(one.x_m - logged.x_m, one.y_m - logged.y_m)[scored] for one in rollouts]
    return {
        "score": sum(TERMS[name].weight * value for name, value in terms.items()),
        **{group: _weighted(terms, names) for group, names in GROUPS.items()},
        **terms,
        "min_ade_m": min(float(one[present].mean()) for one in apart),
    }


def _weighted(terms: Mapping[str, float], names: Sequence[str]) -> float:
    return sum(TERMS[name].weight * terms[name] for name in names) / sum(TERMS[name].weight for name in names)


def _same(first: AgentTracks, second: AgentTracks) -> bool:
    """Whether two rollouts have the same poses, as those of a model without chance."""
    return all(np.array_equal(getattr(first, name), getattr(second, name)) for name in ("x_m", "y_m", "yaw_rad"))


def features_of(
    tracks: AgentTracks, scored: Flags, road: "shapely.MultiPolygon | shapely.Polygon"
) -> dict[str, Floats]:
    """Values of all terms: of shape ``(S, T)``, and ``(S,)`` for those of whole agents."""
    speed, acceleration, turn, turn_rate = _kinematics(tracks)
    nearest = _nearest_m(tracks, scored)
    edge = _road_edge_m(tracks, scored, road)
    present = tracks.present[scored]
    crossed = np.zeros(present.shape, bool) if tracks.red_crossed is None else tracks.red_crossed[scored]
    return {
        "linear_speed": speed[scored],
        "linear_acceleration": acceleration[scored],
        "angular_speed": turn[scored],
        "angular_acceleration": turn_rate[scored],
        "distance_to_nearest_object": nearest,
        "collision_indication": ((nearest < 0.0) & present).any(axis=1).astype(np.float64),
        "time_to_collision": _time_to_collision_s(tracks, speed, scored),
        "distance_to_road_edge": edge,
        "offroad_indication": ((edge > 0.0) & present).any(axis=1).astype(np.float64),
        "traffic_light_violation": (crossed & present).any(axis=1).astype(np.float64),
    }


def _central(values: Floats) -> Floats:
    """Half the difference of the values after and before each step; NaN at both ends."""
    out = np.full(values.shape, np.nan)
    out[..., 1:-1] = 0.5 * (values[..., 2:] - values[..., :-2])
    return out


def _kinematics(tracks: AgentTracks) -> tuple[Floats, Floats, Floats, Floats]:
    speed = np.hypot(_central(tracks.x_m), _central(tracks.y_m)) / STEP_S
    turn = _half_turn(_central(tracks.yaw_rad))
    return speed, _central(speed) / STEP_S, turn / STEP_S, _half_turn(_central(turn)) / STEP_S**2


def _half_turn(values: Floats) -> Floats:
    """The smaller of the two possible turns, where a central difference has half of one."""
    return np.asarray(wrap_angle(2.0 * values)) / 2.0


def _known(present: Flags) -> dict[str, Flags]:
    """Where central differences have both sides."""
    once = np.zeros_like(present)
    once[:, 1:-1] = present[:, 2:] & present[:, :-2]
    twice = np.zeros_like(present)
    twice[:, 1:-1] = once[:, 2:] & once[:, :-2]
    return {
        "linear_speed": once,
        "angular_speed": once,
        "linear_acceleration": twice,
        "angular_acceleration": twice,
    }


def _likelihood(histogram: Histogram, values: Floats, samples: Floats, counted: Flags) -> float:
    """Geometric mean of the likelihoods of values ``(S, T)`` under samples ``(R, S, T)`` of the same agent."""
    edges = np.linspace(histogram.low, histogram.high, histogram.bins + 1)
    total, number = 0.0, 0
    for agent in range(len(values)):
        own = samples[:, agent].ravel()
        bins = np.bincount(_bins(own[~np.isnan(own)], edges), minlength=histogram.bins) + histogram.smoothing
        mine = counted[agent] & ~np.isnan(values[agent])
        total += float(np.sum(np.log((bins / bins.sum())[_bins(values[agent][mine], edges)])))
        number += int(mine.sum())
    return float(np.exp(total / number)) if number else 0.0


def _bins(values: Floats, edges: Floats) -> npt.NDArray[np.intp]:
    clipped = np.clip(values, edges[0], edges[-1])
    return np.minimum(np.searchsorted(edges, clipped, side="right") - 1, len(edges) - 2)


def _corners(tracks: AgentTracks, rows: npt.NDArray[np.intp], steps: npt.NDArray[np.intp]) -> Floats:
    columns = (tracks.x_m, tracks.y_m, tracks.yaw_rad, tracks.length_m, tracks.width_m)
    return footprint_corners(*(column[rows, steps] for column in columns))


def _nearest_m(tracks: AgentTracks, scored: Flags) -> Floats:
    """Signed distance to the nearest other body, negative where they overlap; shape ``(S, T)``.

    Only pairs are compared whose bodies can be nearest, by the distance of their centres and their half diagonals and
    widths. Beyond the histogram's end a bound stands for the distance.
    """
    mine = np.flatnonzero(scored)
    apart = np.hypot(tracks.x_m[None] - tracks.x_m[mine][:, None], tracks.y_m[None] - tracks.y_m[mine][:, None])
    outer_m, inner_m = 0.5 * np.hypot(tracks.length_m, tracks.width_m), 0.5 * tracks.width_m
    least, most = (apart - half[mine][:, None] - half[None] for half in (outer_m, inner_m))
    counts = tracks.present[None] & tracks.present[mine][:, None]
    counts[np.arange(len(mine)), mine] = False
    least, most = (np.where(counts, bound, _FAR_M) for bound in (least, most))
    out = least.min(axis=1)
    able = counts & (least <= most.min(axis=1, keepdims=True)) & (least < TERMS["distance_to_nearest_object"].high)
    place, other, step = np.nonzero(able)
    exact = np.full(able.shape, _FAR_M)
    exact[place, other, step] = _distance_m(_corners(tracks, mine[place], step), _corners(tracks, other, step))
    found = able.any(axis=1)
    out[found] = exact.min(axis=1)[found]
    return out


def _distance_m(first: Floats, second: Floats) -> Floats:
    """Distance of two boxes, shape ``(N, 4, 2)`` each; where they overlap minus the depth along the best axis."""
    depth = np.asarray(separation_m(first, second), dtype=np.float64)
    apart = np.asarray(shapely.distance(shapely.polygons(first), shapely.polygons(second)), dtype=np.float64)
    return np.where(depth < 0.0, depth, apart)


def _road_edge_m(tracks: AgentTracks, scored: Flags, road: "shapely.MultiPolygon | shapely.Polygon") -> Floats:
    """Largest signed distance of a body's corners to the road's edge, positive off the road; shape ``(S, T)``."""
    shapely.prepare(road)
    mine, steps = np.flatnonzero(scored), np.arange(tracks.x_m.shape[1])
    points = shapely.points(_corners(tracks, np.repeat(mine, len(steps)), np.tile(steps, len(mine))))
    away = shapely.distance(road.boundary, points)
    signed = np.where(shapely.contains(road, points), -away, away).max(axis=-1)
    return np.asarray(signed).reshape(len(mine), len(steps))


def _time_to_collision_s(tracks: AgentTracks, speed_mps: Floats, scored: Flags) -> Floats:
    """Time until an agent reaches the body that it follows if both keep their speeds; 5 s where there is none."""
    mine = np.flatnonzero(scored)
    turn = np.abs(tracks.yaw_rad[None] - tracks.yaw_rad[mine][:, None])
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    half_m, wide_m = 0.5 * tracks.length_m, 0.5 * tracks.width_m
    right = tracks.x_m[None] - tracks.x_m[mine][:, None]
    up = tracks.y_m[None] - tracks.y_m[mine][:, None]
    yaw = tracks.yaw_rad[mine][:, None]
    ahead_m = right * np.cos(yaw) + up * np.sin(yaw) - half_m[mine][:, None] - (half_m * cos + wide_m * sin)
    aside_m = np.abs(up * np.cos(yaw) - right * np.sin(yaw)) - wide_m[mine][:, None] - (half_m * sin + wide_m * cos)
    follows = tracks.present[None] & (ahead_m > 0.0) & (turn <= _TURNED_RAD) & (aside_m < 0.0)
    follows &= (aside_m < -_OVERLAP_M) | (turn <= _ALIGNED_RAD)
    gap_m = np.where(follows, ahead_m, _FAR_M)
    nearest = np.argmin(gap_m, axis=1)
    gap_m = np.take_along_axis(gap_m, nearest[:, None], axis=1)[:, 0]
    closing = speed_mps[mine] - np.take_along_axis(speed_mps, nearest, axis=0)
    out = np.full(gap_m.shape, _LONGEST_TTC_S)
    comes = closing > 0.0  # NaN at the ends is no motion
    out[comes] = np.minimum(gap_m[comes] / closing[comes], _LONGEST_TTC_S)
    return out
