"""Scenes of recorded episodes for models that simulate civilians again, and the simplest of such models.

A scene has a second of history and 8 s of future at 10 Hz, as those of the Waymo Open Sim Agents Challenge. Scored are
the civilians of the paper's interaction region; the EMV and all others are part of the scene.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
import shapely

from siren_ros.base.numerics.arrays import Flags, Floats, Ids, Rows, random_stream
from siren_ros.base.tables import Row, Table
from siren_ros.data.datasets.lane_graph import driven_shapes, lane_graph
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import LOG_PERIOD_STEPS, Track, tracks_of
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.realism.sim_agents import (
    GROUPS,
    STEP_S,
    AgentTracks,
    score_sim_agents,
)
from siren_ros.scoring.evaluation.statistics import block_sums, interval_of_mean
from siren_ros.scoring.judging.traversals import RED
from siren_ros.simulation.roads.road_network import MAPS_KEPT, RoadNetwork

HISTORY: Final = 11
"""Frames up to the present one."""
FUTURE: Final = 80
ROLLOUTS: Final = 32


@dataclass(frozen=True)
class SimAgentScene:
    """One scene. Agents are those present at the present frame, in the order of their ids."""

    first_frame: int
    """Number of the first frame of the history, 0.1 s each."""
    ids: Ids
    history: AgentTracks
    logged: AgentTracks
    """What happened in the 8 s after the present."""
    scored: Flags
    road: shapely.MultiPolygon | shapely.Polygon
    stop_lines: Floats
    """Stop lines of signals, shape ``(L, 4)``: x, y, heading of the lane, half its width."""
    red: Flags
    """Whether all movements of each line are red, shape ``(L, 80)``."""

    def score(self, rollouts: Floats) -> dict[str, float]:
        """Score simulated futures: x, y and yaw of all agents, shape ``(R, A, 80, 3)``.

        Raises:
            InputError: Another shape, or values that are not finite.
        """
        wanted = (len(self.ids), FUTURE, 3)
        if rollouts.ndim != 4 or rollouts.shape[1:] != wanted or not np.isfinite(rollouts).all():
            raise InputError("rollouts", str(rollouts.shape), f"finite numbers of shape (rollouts, {wanted})")
        made = [replace(self.logged, x_m=x, y_m=y, yaw_rad=yaw) for x, y, yaw in np.moveaxis(rollouts, 3, 1)]
        logged, *simulated = (replace(one, red_crossed=self._red_crossed(one)) for one in (self.logged, *made))
        return score_sim_agents(logged, simulated, self.scored, self.road)

    def _red_crossed(self, tracks: AgentTracks) -> Flags:
        """Whether each agent's middle passes a stop line at a frame at which that is red, shape ``(A, 80)``."""
        crossed = np.zeros(tracks.present.shape, dtype=np.bool_)
        for (x_m, y_m, yaw_rad, half_m), red in zip(self.stop_lines, self.red, strict=True):
            right, up = tracks.x_m - x_m, tracks.y_m - y_m
            ahead_m = right * np.cos(yaw_rad) + up * np.sin(yaw_rad)
            aside_m = np.abs(up * np.cos(yaw_rad) - right * np.sin(yaw_rad))
            over = (ahead_m[:, :-1] <= 0.0) & (ahead_m[:, 1:] > 0.0) & (aside_m[:, 1:] < half_m)
            crossed[:, 1:] |= over & red[1:]
        return crossed


def scenes_of(record: EpisodeRecord) -> Iterator[SimAgentScene]:
    """Find the scenes of an episode, one after the other; one in which nobody is scored is left out."""
    tracks = {track.actor.actor_id: track for track in tracks_of(record)}
    frames = record.steps // LOG_PERIOD_STEPS
    road = drivable_area(record.network)
    for first in range(0, frames - HISTORY - FUTURE + 1, FUTURE):
        present = first + HISTORY - 1
        here = {key: track for key, track in tracks.items() if present in track.frame}
        window = np.arange(first, first + HISTORY + FUTURE)
        poses = _poses(list(here.values()), window)
        scored = np.array([key not in record.emv_ids and _whole(track, window, present) for key, track in here.items()])
        if scored.any():
            parts = _cut(poses, slice(0, HISTORY)), _cut(poses, slice(HISTORY, None))
            yield SimAgentScene(
                first,
                np.array(list(here), dtype=np.uint32),
                *parts,
                scored,
                road,
                *_stop_lines(record, window[HISTORY:]),
            )


def _whole(track: Track, window: Rows, present: int) -> bool:
    """Whether a vehicle is there all the time, and in the region at the present."""
    return bool(np.isin(window, track.frame).all() and track.in_region[np.searchsorted(track.frame, present)])


def _stop_lines(record: EpisodeRecord, frames: Rows) -> tuple[Floats, Flags]:
    """Stop lines of signals, and when all of their movements are red."""
    lines, reds = [], []
    for index, movements in record.network.connections_from.items():
        red = np.ones(len(frames), dtype=np.bool_)
        signals = [movement for movement in movements if movement.signal_id is not None]
        for movement in signals:
            states = record.signal_states(str(movement.signal_id))
            letters = (movement.letter_in(states.get(frame * LOG_PERIOD_STEPS, "")) for frame in frames.tolist())
            red &= np.array([letter in RED for letter in letters])
        if signals:
            lane = record.network.lanes[index]
            yaw_rad = float(lane.centre.heading_rad(lane.length_m))
            lines.append((*lane.centre.points[-1].tolist(), yaw_rad, 0.5 * lane.width_m))
            reds.append(red)
    return np.array(lines).reshape(-1, 4), np.array(reds, dtype=np.bool_).reshape(-1, len(frames))


def _poses(tracks: list[Track], window: Rows) -> AgentTracks:
    x_m, y_m, yaw_rad = np.zeros((3, len(tracks), len(window)))
    there = np.zeros((len(tracks), len(window)), dtype=np.bool_)
    for row, track in enumerate(tracks):
        at = np.searchsorted(track.frame, window).clip(0, len(track) - 1)
        there[row] = track.frame[at] == window
        x_m[row], y_m[row], yaw_rad[row] = track.x_m[at], track.y_m[at], track.yaw_rad[at]
    sizes = (np.array([[getattr(track.actor, name)] for track in tracks]) for name in ("length_m", "width_m"))
    length_m, width_m = (np.repeat(size, len(window), axis=1) for size in sizes)
    return AgentTracks(x_m, y_m, yaw_rad, length_m, width_m, there)


def _cut(poses: AgentTracks, frames: slice) -> AgentTracks:
    return AgentTracks(**{name: column[:, frames] for name, column in vars(poses).items() if column is not None})


@lru_cache(maxsize=MAPS_KEPT)
def drivable_area(network: RoadNetwork) -> shapely.MultiPolygon | shapely.Polygon:
    """The surface of all lanes for vehicles and of the junctions."""
    return shapely.union_all(driven_shapes(network, lane_graph(network)), grid_size=0.01)


def constant_velocity(scene: SimAgentScene, rng: np.random.Generator) -> Floats:
    """All agents go on straight at their present speed; all rollouts are the same."""
    del rng
    past = scene.history
    velocity = np.stack((past.x_m[:, -1] - past.x_m[:, -2], past.y_m[:, -1] - past.y_m[:, -2]), axis=-1)
    steps = np.arange(1, FUTURE + 1)
    x, y = (column[:, -1:] + velocity[:, axis, None] * steps for axis, column in enumerate((past.x_m, past.y_m)))
    yaw = np.repeat(past.yaw_rad[:, -1:], FUTURE, axis=1)
    return np.repeat(np.stack((x, y, yaw), axis=-1)[None], ROLLOUTS, axis=0)


def random_agents(scene: SimAgentScene, rng: np.random.Generator) -> Floats:
    """Agents that jump: normal steps of 1 m and of 0.1 rad from the present on."""
    past = scene.history
    last = np.stack((past.x_m[:, -1], past.y_m[:, -1], past.yaw_rad[:, -1]), axis=-1)
    steps = rng.normal(scale=(1.0, 1.0, 0.1), size=(ROLLOUTS, len(scene.ids), FUTURE, 3))
    return np.asarray(last[None, :, None] + np.cumsum(steps, axis=2))


def log_resampled(scene: SimAgentScene, rng: np.random.Generator) -> Floats:
    """What happened, up to 0.2 s earlier or later in each rollout: as near to the record as a model can come."""
    real = scene.logged
    there = np.stack((real.x_m, real.y_m, np.unwrap(real.yaw_rad, axis=1)), axis=-1)
    frames = np.arange(FUTURE, dtype=np.float64)
    return np.stack([_shifted(there, frames, shift) for shift in rng.uniform(-0.2, 0.2, ROLLOUTS) / STEP_S])


def _shifted(there: Floats, frames: Floats, shift: float) -> Floats:
    at = (frames + shift).clip(0, FUTURE - 1)
    low = np.minimum(at.astype(np.intp), FUTURE - 2)
    share = (at - low)[:, None]
    return np.asarray((1.0 - share) * there[:, low] + share * there[:, low + 1])


SIM_AGENTS: Final[Mapping[str, Callable[[SimAgentScene, np.random.Generator], Floats]]] = {
    "random": random_agents,
    "constant_velocity": constant_velocity,
    "log_resampled": log_resampled,
}
"""The simplest models, by name; the last one sees the future."""


def scores_of_episode(record: EpisodeRecord, folder: Path | None = None) -> dict[str, list[dict[str, float]]]:
    """Scores of the simplest models on all scenes; with a folder those of ``rollouts`` from its files ``FRAME.npy``.

    Raises:
        InputError: A file is missing, or its array does not fit its scene.
    """
    found: dict[str, list[dict[str, float]]] = {}
    for scene in scenes_of(record):
        rng = random_stream(record.description.seed, f"sim_agents/{scene.first_frame}")
        for name, simulate in SIM_AGENTS.items():
            found.setdefault(name, []).append(scene.score(simulate(scene, rng)))
        if folder is not None:
            found.setdefault("rollouts", []).append(scene.score(_rollouts(folder / f"{scene.first_frame}.npy")))
    return found


def _rollouts(file: Path) -> Floats:
    try:
        return np.asarray(np.load(file, allow_pickle=False), dtype=np.float64)
    except (OSError, ValueError, EOFError) as error:
        raise InputError("rollouts", str(file), f"an array of NumPy ({error})") from error


def means_of_scenes(found: Mapping[str, Sequence[Mapping[str, float]]]) -> dict[str, dict[str, float]]:
    """Means over the scenes of an episode, by model."""
    return {
        model: {name: float(np.mean([one[name] for one in scenes])) for name in scenes[0]}
        | {"scenes": float(len(scenes))}
        for model, scenes in found.items()
    }


def sim_agent_table(episodes: Sequence[Mapping[str, Mapping[str, float]]]) -> Table:
    """A row a model: means over the episodes, with intervals."""
    columns = ("score", *GROUPS, "min_ade_m")
    models = dict.fromkeys(name for episode in episodes for name in episode)
    rows: list[Row] = []
    for model in models:
        of_model = [episode[model] for episode in episodes if model in episode]
        values = (np.array([one[column] for one in of_model]) for column in columns)
        blocks, stratum = np.arange(len(of_model)), np.zeros(len(of_model), dtype=np.intp)
        cells = (interval_of_mean(block_sums(column, blocks, stratum)) for column in values)
        rows.append((model, *cells, int(sum(one["scenes"] for one in of_model))))
    head = ("model", *columns, "scenes")
    return Table("sim_agents", "Civilians simulated again: likelihoods of what happened", head, tuple(rows), spec=".3f")
