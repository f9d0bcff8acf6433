"""Samples of trajectory prediction: history of target and neighbours, surrounding map, signals, future.

Everything is in the frame of the target at the present: origin at its centre, x forward, y left.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Points
from siren_ros.data.episode_source import episode_name
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.lab.training.packed.parquet_samples import Column, Sample
from siren_ros.scoring.evaluation.prediction.samples import (
    FUTURE_POINTS,
    HistoryWindow,
    Population,
    SampleBatch,
    samples_of,
)
from siren_ros.scoring.evaluation.prediction.siren_model.columns import NEIGHBOURS, choose_neighbours, in_frame_of
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import Lights

_WINDOW: Final = HistoryWindow()
_ACTORS: Final = 1 + NEIGHBOURS
LANES: Final = 64
"""Number of lane pieces around a target, nearest first."""
_LANE_POINTS: Final = 10
_PIECE_M: Final = 25.0
"""Longer lanes are cut into pieces of at most this length."""
_STATES: Final = ("x_m", "y_m", "cos_yaw", "sin_yaw", "vx_mps", "vy_mps")
_SHOWN: Final = {
    "beacon": Lights.BEACON,
    "siren": Lights.SIREN,
    "brake": Lights.BRAKE,
    "indicator_left": Lights.INDICATOR_LEFT,
    "indicator_right": Lights.INDICATOR_RIGHT,
}
_ACTOR_FLAGS: Final = ("there", "is_emv", *_SHOWN)
_LANE_FLAGS: Final = ("there", "driving", "shoulder", "across_junction", "must_stop", "gives_way")
SIGNALS: Final = ("none", "red", "yellow", "green", "green_with_priority")
_SIGNAL_OF_LETTER: Final = {"r": 1, "u": 1, "y": 2, "Y": 2, "g": 3, "G": 4}
"""Code for each of SUMO's letters; ``u`` is red and yellow. Signals that are off or unknown have code 0."""
_CHUNK: Final = 256
"""Number of samples whose distances to all lane pieces are in memory at once."""

COLUMNS: Final[Mapping[str, Column]] = {
    "episode": Column(str, (), "id of the episode"),
    "template": Column(str, (), "template of the episode"),
    "step": Column(np.int32, (), "step of the present, 20 Hz"),
    "actor_id": Column(np.int32, (), "actor to predict"),
    "history": Column(
        np.float32,
        (_ACTORS, _WINDOW.points, len(_STATES)),
        "past of the target (first) and its neighbours within 80 m, emergency vehicles first; every 0.2 s, the present "
        "last; 0 where not observed",
        _STATES,
    ),
    "observed": Column(np.bool_, (_ACTORS, _WINDOW.points), "whether each point of the past was observed"),
    "size_m": Column(np.float32, (_ACTORS, 2), "length and width", ("length_m", "width_m")),
    "actor_class": Column(np.uint8, (_ACTORS,), "ActorClass of each actor"),
    "flags": Column(
        np.bool_, (_ACTORS, len(_ACTOR_FLAGS)), "what each actor is and shows at the present", _ACTOR_FLAGS
    ),
    "lanes": Column(
        np.float32, (LANES, _LANE_POINTS, 2), "centre lines in driving direction, the nearest first", ("x_m", "y_m")
    ),
    "lane_flags": Column(np.bool_, (LANES, len(_LANE_FLAGS)), "what each piece of a lane is", _LANE_FLAGS),
    "lane_limit_mps": Column(np.float32, (LANES,), "speed limit of each piece"),
    "lane_signal": Column(np.uint8, (LANES,), f"signal of each way across a junction: {', '.join(SIGNALS)}"),
    "future": Column(np.float32, (FUTURE_POINTS, 2), "true places of the target, 0.2 s to 5 s", ("x_m", "y_m")),
}


def prediction_samples(record: EpisodeRecord, population: Population = Population.REGION) -> Iterator[Sample]:
    """Samples of an episode, one per vehicle and 10 Hz frame with a complete window.

    Episodes with left-hand traffic give their mirror images, as in the training of ``siren``.
    """
    episode = record.description
    name = episode_name(episode.template, episode.level.name, episode.seed, episode.map_name)
    samples = samples_of(record.right_hand, _WINDOW, population)
    batch = samples.batch
    columns = _actor_columns(batch)
    if not len(batch):
        return
    lanes_around = _Lanes(batch).around
    future = in_frame_of(batch, samples.future_xy_m - batch.xy_m[:, None]).astype(np.float32)
    steps, ids = batch.sample_step, batch.actor_id
    for first in range(0, len(samples), _CHUNK):
        part = slice(first, min(first + _CHUNK, len(samples)))
        lanes = lanes_around(part)
        for row in range(part.start, part.stop):
            yield {
                "episode": name,
                "template": episode.template,
                "step": steps[row],
                "actor_id": ids[row],
                **{key: values[row] for key, values in columns.items()},
                **{key: values[row - first] for key, values in lanes.items()},
                "future": future[row],
            }


def _actor_columns(batch: SampleBatch) -> dict[str, npt.NDArray[Any]]:
    """Columns of target and neighbours, each of shape ``(N, A, …)``."""
    actors, others = batch.actors, choose_neighbours(batch)
    rows = np.concatenate((batch.target[:, None], others.actor), axis=1)
    there = np.concatenate((np.ones((len(batch), 1), dtype=np.bool_), others.there), axis=1)
    observed = actors.observed[rows] & there[..., None]
    place = in_frame_of(batch, actors.xy_m[rows] - batch.xy_m[:, None, None])
    velocity = in_frame_of(batch, actors.velocity_mps[rows])
    turned = actors.yaw_rad[rows] - batch.yaw_rad[:, None, None]
    states = np.concatenate((place, np.cos(turned)[..., None], np.sin(turned)[..., None], velocity), axis=-1)
    lights = actors.lights[rows]
    flags = np.stack((there, actors.is_emv[rows], *((lights & light) != 0 for light in _SHOWN.values())), axis=-1)
    size = np.stack((actors.length_m[rows], actors.width_m[rows]), axis=-1)
    return {
        "history": np.where(observed[..., None], states, 0.0).astype(np.float32),
        "observed": observed,
        "size_m": np.where(there[..., None], size, 0.0).astype(np.float32),
        "actor_class": np.where(there, actors.actor_class[rows], 0).astype(np.uint8),
        "flags": flags & there[..., None],
    }


@dataclass(frozen=True)
class _Piece:
    """A piece of a lane in the frame ``map``."""

    points: Points
    flags: tuple[bool, ...]
    limit_mps: float
    signal: tuple[str, int] | None
    """Id and link of the traffic light, for a path across a junction."""


_KINDS: Final = (LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL)


def _pieces_of(network: RoadNetwork) -> Iterator[_Piece]:
    for lane in network.lanes:
        if lane.kind not in _KINDS:
            continue
        movements = network.connections_over.get(lane.index, ())
        rules = (any(item.must_stop for item in movements), any(item.gives_way for item in movements))
        flags = (True, *(lane.kind is kind for kind in _KINDS), *rules)
        signal = next(((item.signal_id, item.signal_link) for item in movements if item.signal_id), None)
        ends = np.linspace(0.0, lane.length_m, max(1, int(np.ceil(lane.length_m / _PIECE_M))) + 1)
        for begin, end in pairwise(ends.tolist()):
            points = lane.centre.at(np.linspace(begin, end, _LANE_POINTS))
            yield _Piece(points, flags, lane.speed_limit_mps, signal)


class _Lanes:
    """Lanes of a batch's map, cut into pieces with few points."""

    def __init__(self, batch: SampleBatch) -> None:
        pieces = list(_pieces_of(batch.network))
        self._batch = batch
        self._points: Floats = np.stack([piece.points for piece in pieces])
        self._flags: Flags = np.array([piece.flags for piece in pieces], dtype=np.bool_)
        self._limit_mps = np.array([piece.limit_mps for piece in pieces], dtype=np.float32)
        self._signal = _signals(batch, pieces)

    def around(self, samples: slice) -> dict[str, npt.NDArray[Any]]:
        """Columns of the lanes around some samples, each of shape ``(len(samples), LANES, …)``."""
        batch = self._batch
        centre, yaw = batch.xy_m[samples], batch.yaw_rad[samples]
        apart = self._points[None] - centre[:, None, None]
        distance = np.einsum("nlpc,nlpc->nlp", apart, apart).min(axis=-1)
        nearest = np.argsort(distance, axis=1, kind="stable")[:, :LANES]
        rows = np.arange(len(centre))[:, None]
        cos, sin = np.cos(yaw)[:, None, None], np.sin(yaw)[:, None, None]
        x, y = np.moveaxis(apart[rows, nearest], -1, 0)
        frame = batch.actors.frame[batch.target[samples]]
        columns = {
            "lanes": np.stack((cos * x + sin * y, cos * y - sin * x), axis=-1).astype(np.float32),
            "lane_flags": self._flags[nearest],
            "lane_limit_mps": self._limit_mps[nearest],
            "lane_signal": self._signal[frame[:, None], nearest],
        }
        lacking = LANES - nearest.shape[1]
        return {
            name: np.pad(values, ((0, 0), (0, lacking), *((0, 0) for _ in values.shape[2:])))
            for name, values in columns.items()
        }


def _signals(batch: SampleBatch, pieces: Sequence[_Piece]) -> Codes:
    """State of each piece's signal at each frame of the batch, shape ``(F, P)``."""
    meaning = np.zeros(256, dtype=np.uint8)
    for letter, code in _SIGNAL_OF_LETTER.items():
        meaning[ord(letter)] = code
    shown = np.zeros((len(batch.step), len(pieces)), dtype=np.uint8)
    for number, piece in enumerate(pieces):
        states = None if piece.signal is None else batch.signals.get(piece.signal[0])
        if piece.signal is not None and states is not None and 0 <= piece.signal[1] < states.shape[1]:
            shown[:, number] = meaning[states[:, piece.signal[1]]]
    return shown
