"""The Sim Agents Challenge's terms against a second implementation, which goes one agent and one step at a time.

It is written from the challenge's definitions with other algorithms: signed distances of bodies by the Minkowski
difference, the road by rays and segments, histograms by division.
"""

import math
from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely

from siren_ros.scoring.evaluation.realism.sim_agents import AgentTracks, score_sim_agents

RING = [(-60.0, -9.0), (0.0, -12.0), (60.0, -9.0), (60.0, 8.0), (10.0, 6.0), (0.0, 9.0), (-60.0, 8.0), (-60.0, -9.0)]
BINS = {  # low, high, number, count added to each, weight
    "linear_speed": (0.0, 25.0, 10, 0.1, 0.05),
    "linear_acceleration": (-12.0, 12.0, 11, 0.1, 0.05),
    "angular_speed": (-0.628, 0.628, 11, 0.1, 0.05),
    "angular_acceleration": (-3.14, 3.14, 11, 0.1, 0.05),
    "distance_to_nearest_object": (-5.0, 40.0, 10, 0.1, 0.1),
    "collision_indication": (-0.5, 1.5, 2, 0.001, 0.25),
    "time_to_collision": (0.0, 5.0, 10, 0.1, 0.1),
    "distance_to_road_edge": (-20.0, 40.0, 10, 0.1, 0.05),
    "offroad_indication": (-0.5, 1.5, 2, 0.001, 0.25),
    "traffic_light_violation": (-0.5, 1.5, 2, 0.001, 0.05),
}


def scene(rng: np.random.Generator, spread: float) -> AgentTracks:
    """Five agents that drive, turn and brake, two of them gone for a while."""
    time = 0.1 * np.arange(30)
    start = np.array([[-20.0, -3.0, 0.0], [-5.0, -2.0, 0.1], [3.0, 1.0, 3.0], [25.0, 4.0, 3.1], [0.0, -8.0, -1.6]])
    start += spread * rng.normal(size=start.shape) * [2.0, 1.0, 0.2]
    turn = rng.normal(size=(5, 1)) * 0.4 * spread
    speed = np.array([[9.0], [4.0], [6.0], [0.0], [3.0]]) * (
        1.0 + spread * rng.normal(size=(5, 1)) * np.sin(2.0 * time)
    )
    yaw = start[:, 2:] + turn * time
    x, y = (start[:, k, None] + np.cumsum(speed * way(yaw), axis=1) * 0.1 for k, way in enumerate((np.cos, np.sin)))
    size = np.array([[4.5, 1.8], [12.0, 2.5], [4.0, 1.7], [5.0, 2.0], [2.2, 0.8]])[..., None] * np.ones((5, 2, 30))
    there = np.ones((5, 30), bool)
    there[1, :4] = there[3, 20:] = False
    red = np.zeros((5, 30), bool)
    red[0, 12] = rng.random() < 0.5
    return AgentTracks(x, y, np.angle(np.exp(1j * yaw)), size[:, 0], size[:, 1], there, red)


def corners(tracks: AgentTracks, agent: int, step: int) -> list[tuple[float, float]]:
    x, y, yaw, long, wide = (float(getattr(tracks, name)[agent, step]) for name in list(vars(tracks))[:5])
    ways = [(0.5 * a * long, 0.5 * b * wide) for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    return [(x + u * math.cos(yaw) - v * math.sin(yaw), y + u * math.sin(yaw) + v * math.cos(yaw)) for u, v in ways]


def nearest(tracks: AgentTracks, agent: int, step: int) -> float:
    found = [1e10]
    for other in range(len(tracks.x_m)):
        if other != agent and tracks.present[other, step] and tracks.present[agent, step]:
            mine, theirs = corners(tracks, agent, step), corners(tracks, other, step)
            hull = shapely.MultiPoint([(a - c, b - d) for a, b in mine for c, d in theirs]).convex_hull
            away = hull.exterior.distance(shapely.Point(0.0, 0.0))
            found.append(-away if hull.contains(shapely.Point(0.0, 0.0)) else away)
    return min(found)


def edge(tracks: AgentTracks, agent: int, step: int) -> float:
    def signed(x: float, y: float) -> float:
        inside, least = False, math.inf
        for (a, b), (c, d) in pairwise(RING):
            share = min(1.0, max(0.0, ((x - a) * (c - a) + (y - b) * (d - b)) / ((c - a) ** 2 + (d - b) ** 2)))
            least = min(least, math.hypot(x - a - share * (c - a), y - b - share * (d - b)))
            inside ^= (b > y) != (d > y) and x < a + (y - b) / (d - b) * (c - a)
        return -least if inside else least

    return max(signed(x, y) for x, y in corners(tracks, agent, step))


def speed_at(tracks: AgentTracks, agent: int, step: int) -> float:
    if not 0 < step < tracks.x_m.shape[1] - 1:
        return math.nan
    (x0, x1), (y0, y1) = ((line[agent, step - 1], line[agent, step + 1]) for line in (tracks.x_m, tracks.y_m))
    return math.hypot(x1 - x0, y1 - y0) / 0.2


def turn_at(tracks: AgentTracks, agent: int, step: int) -> float:
    if not 0 < step < tracks.x_m.shape[1] - 1:
        return math.nan
    return math.remainder(tracks.yaw_rad[agent, step + 1] - tracks.yaw_rad[agent, step - 1], math.tau) / 0.2


def collision_s(tracks: AgentTracks, agent: int, step: int) -> float:
    """The one that is followed is the nearest ahead; angles are not wrapped."""
    yaw, best = tracks.yaw_rad[agent, step], (1e10, -1)
    for other in range(len(tracks.x_m)):
        turn = abs(tracks.yaw_rad[other, step] - yaw)
        places = corners(tracks, other, step)
        moved = [(x - tracks.x_m[agent, step], y - tracks.y_m[agent, step]) for x, y in places]
        ahead = min(x * math.cos(yaw) + y * math.sin(yaw) for x, y in moved) - 0.5 * tracks.length_m[agent, step]
        sides = [y * math.cos(yaw) - x * math.sin(yaw) for x, y in moved]
        aside = (
            abs(0.5 * (min(sides) + max(sides))) - 0.5 * (max(sides) - min(sides)) - 0.5 * tracks.width_m[agent, step]
        )
        aligned = turn <= math.radians(75.0) and (aside < -0.5 or turn <= math.radians(10.0))
        if tracks.present[other, step] and ahead > 0.0 and aside < 0.0 and aligned:
            best = min(best, (ahead, other))
    closing = speed_at(tracks, agent, step) - speed_at(tracks, best[1], step)
    return min(best[0] / closing, 5.0) if closing > 0.0 else 5.0


Features = dict[str, list[float]]


def features(tracks: AgentTracks, agent: int) -> Features:
    steps = range(tracks.x_m.shape[1])
    there = tracks.present[agent]
    speed, turn = ([way(tracks, agent, step) for step in steps] for way in (speed_at, turn_at))
    gain = [(speed[k + 1] - speed[k - 1]) / 0.2 if 0 < k < len(speed) - 1 else math.nan for k in steps]
    bend = [
        math.remainder(0.2 * (turn[k + 1] - turn[k - 1]), math.tau) / 0.04 if 0 < k < len(turn) - 1 else math.nan
        for k in steps
    ]
    near, off = ([way(tracks, agent, step) for step in steps] for way in (nearest, edge))
    return {
        "linear_speed": speed, "linear_acceleration": gain, "angular_speed": turn, "angular_acceleration": bend,
        "distance_to_nearest_object": near, "time_to_collision": [collision_s(tracks, agent, step) for step in steps],
        "collision_indication": [float(any(near[k] < 0.0 and there[k] for k in steps))],
        "distance_to_road_edge": off, "offroad_indication": [float(any(off[k] > 0.0 and there[k] for k in steps))],
        "traffic_light_violation": [float(any(there & tracks.red_crossed[agent]))],
    }  # fmt: skip


def counted(name: str, there: Any, step: int) -> bool:
    """Differences need the steps before and after, second ones two of each."""
    reach = {"linear_speed": [1], "angular_speed": [1], "linear_acceleration": [0, 2], "angular_acceleration": [0, 2]}
    sides = [step + sign * way for way in reach.get(name, [0]) for sign in (-1, 1)]
    return all(0 <= side < len(there) and there[side] for side in sides)


def likelihood(name: str, there: Any, logged: list[Features], rollouts: list[list[Features]]) -> float:
    low, high, number, added, _ = BINS[name]

    def bin_of(value: float) -> int:
        return min(number - 1, max(0, math.floor((value - low) / (high - low) * number)))

    logs: list[float] = []
    for agent, real in enumerate(logged):
        values = real[name]
        samples = [value for one in rollouts for value in one[agent][name] if not math.isnan(value)]
        counts = Counter(map(bin_of, samples))
        kept = [k for k in range(len(values)) if len(values) == 1 or counted(name, there[agent], k)]
        whole = len(samples) + added * number
        logs += [math.log((counts[bin_of(values[k])] + added) / whole) for k in kept if not math.isnan(values[k])]
    return math.exp(sum(logs) / len(logs))


@pytest.mark.parametrize(("seed", "spread"), [(0, 0.1), (1, 0.4), (2, 1.0)])
def test_every_term_is_that_of_a_second_implementation(seed: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    logged, agents = scene(rng, 0.1), [0, 1, 3]
    rollouts = [scene(rng, spread) for _ in range(3)]
    found = score_sim_agents(logged, rollouts, np.isin(range(5), agents), shapely.Polygon(RING))
    real, *simulated = ([features(one, agent) for agent in agents] for one in (logged, *rollouts))
    expected = {name: likelihood(name, logged.present[agents], real, simulated) for name in BINS}
    assert {name: found[name] for name in BINS} == pytest.approx(expected, abs=1e-6)
    assert found["score"] == pytest.approx(sum(BINS[name][4] * value for name, value in expected.items()), abs=1e-6)
