"""Questions of a sealed round: one frame of an episode with its history, for programs and people who must not see more.

A question ends at the frame that it asks for. An episode has one question, because the history of a second one would be
the answer to the first. Its content is JSON; answers are paths on the common grid.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from siren_ros.base.numerics.arrays import Floats
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import BagError, InputError, whole_file, writing
from siren_ros.scoring.evaluation.prediction.metrics import ade, distances
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses, Predictor, causal_answer
from siren_ros.scoring.evaluation.prediction.samples import (
    HistoryWindow,
    ObservedActors,
    Population,
    SampleBatch,
    ScoredSamples,
    samples_of,
)
from siren_ros.scoring.evaluation.prediction.submission import Submission
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.world.actors import ActorClass

Content = Mapping[str, Any]
"""JSON types of a question, an answer or a file of a round."""
_POINTS: Final = ("x_m", "y_m", "vx_mps", "vy_mps", "yaw_rad", "accel_mps2")
"""Values of each point of a history; null where it was not observed."""
_UNKNOWN: Final = "?"
"""State of a signal that is not known."""
_COLUMNS: Final = ("episode", "actor", "step", "mode", "probability", "x", "y")


def question_of(record: EpisodeRecord, rng: np.random.Generator) -> ScoredSamples:
    """One frame of an episode, drawn among those with samples in the region around the EMV, with its true future.

    Raises:
        BagError: The episode has no sample: 8 s of one vehicle in the region.
    """
    samples = samples_of(record, HistoryWindow(), Population.REGION)
    frames = samples.batch.actors.frame[samples.batch.target]
    if not len(frames):
        raise BagError(record.description.template, "an episode with vehicles around the EMV for 8 s")
    frame = int(rng.choice(np.unique(frames)))
    return ScoredSamples(samples.batch.between(frame, frame + 1), samples.future_xy_m[frames == frame])


def content_of(name: str, map_sha256: str, batch: SampleBatch) -> dict[str, Any]:
    """The question as JSON: all that a predictor may see, to the last bit. ``batch_of`` reads it."""
    actors, lanes = batch.actors, batch.network.lanes
    values = np.concatenate(
        (actors.xy_m, actors.velocity_mps, actors.yaw_rad[..., None], actors.accel_mps2[..., None]), axis=-1
    )
    asked = np.isin(np.arange(len(actors)), batch.target)

    def points(column: Floats, row: int) -> list[float | None]:
        pairs = zip(column.tolist(), actors.observed[row].tolist(), strict=True)
        return [value if there else None for value, there in pairs]

    told = [
        {
            "id": int(actors.actor_id[row]),
            "class": ActorClass(int(actors.actor_class[row])).name.lower(),
            "emv": bool(actors.is_emv[row]),
            "length_m": float(actors.length_m[row]),
            "width_m": float(actors.width_m[row]),
            "lights": int(actors.lights[row]),
            "asked": bool(asked[row]),
            **{key: points(column, row) for key, column in zip(_POINTS, values[row].T, strict=True)},
            "lane": [None if lane == NO_LANE else lanes[lane].lane_id for lane in actors.past_sumo_lane[row].tolist()],
        }
        for row in range(len(actors))
    ]
    signals = {
        key: "".join(chr(code) if code else _UNKNOWN for code in states[0].tolist())
        for key, states in sorted(batch.signals.items())
    }
    about = {"episode": name, "map": map_sha256, "step": int(batch.step[0]), "times_s": batch.window.times_s.tolist()}
    return {**about, "signals": signals, "actors": told}


def batch_of(content: Content, network: RoadNetwork) -> SampleBatch:
    """Inverse of ``content_of``.

    Raises:
        InputError: It is no question, or one on another map.
    """
    try:
        return _batch_of(content, network)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as error:
        raise InputError("question", repr(error), "a question of a round, on its map") from error


def _batch_of(content: Content, network: RoadNetwork) -> SampleBatch:
    told, window = content["actors"], HistoryWindow()
    values = np.array([[one[name] for name in _POINTS] for one in told], dtype=np.float64).transpose(0, 2, 1)
    observed = ~np.isnan(values[..., 0])
    values = np.where(observed[..., None], values, 0.0)
    lane_of = {lane.lane_id: number for number, lane in enumerate(network.lanes)} | {None: NO_LANE}

    def column(name: str, kind: type) -> Any:
        return np.array([one[name] for one in told], dtype=kind)

    actors = ObservedActors(
        frame=np.zeros(len(told), dtype=np.intp),
        actor_id=column("id", np.uint32),
        actor_class=np.array([ActorClass[one["class"].upper()] for one in told], dtype=np.uint8),
        is_emv=column("emv", np.bool_),
        length_m=column("length_m", np.float64),
        width_m=column("width_m", np.float64),
        lights=column("lights", np.uint8),
        observed=observed,
        xy_m=values[..., :2],
        velocity_mps=values[..., 2:4],
        yaw_rad=values[..., 4],
        accel_mps2=values[..., 5],
        past_sumo_lane=np.array([[lane_of[lane] for lane in one["lane"]] for one in told], dtype=np.int32),
    )
    return SampleBatch(
        network=network,
        window=window,
        step=np.array([content["step"]], dtype=np.int64),
        frame_offset=np.array([0, len(told)]),
        actors=actors,
        target=np.flatnonzero(column("asked", np.bool_)),
        signals={
            key: np.array([[0 if state == _UNKNOWN else ord(state) for state in states]], dtype=np.uint8)
            for key, states in content["signals"].items()
        },
    )


Answer = tuple[str, int, int, int, float, list[float], list[float]]
"""A hypothesis as a row of a file of predictions."""


def rows_of(name: str, batch: SampleBatch, hypotheses: Hypotheses) -> list[Answer]:
    """The rows of a predictor's answer to a question; hypotheses without probability are left out."""
    return [
        (name, actor, step, mode, float(probability), *hypotheses.xy_m[sample, mode].T.tolist())
        for sample, (actor, step) in enumerate(zip(batch.actor_id.tolist(), batch.sample_step.tolist(), strict=True))
        for mode, probability in enumerate(hypotheses.probability[sample])
        if probability > 0.0
    ]


def rows_in(question: Content, answer: Any) -> list[Answer]:
    """The rows of a program's answer: ``{"paths": {"12": [[1.0, [[x, y], …]], …], …}}``, by the ids of the actors.

    Raises:
        InputError: It is something else; whether it can be scored is checked when it is read.
    """
    try:
        return [
            (
                question["episode"],
                int(actor),
                question["step"],
                mode,
                float(probability),
                [float(x) for x, _ in path],
                [float(y) for _, y in path],
            )
            for actor, modes in answer["paths"].items()
            for mode, (probability, path) in enumerate(modes)
        ]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError("answer", repr(error), '{"paths": {"12": [[1.0, [[x, y], …]], …]}}') from error


def write_answers(file: Path, rows: Sequence[Answer]) -> None:
    """Write rows as a file of predictions; InputError where it cannot be written."""
    types = (pa.string(), pa.int64(), pa.int64(), pa.int64(), pa.float64(), *[pa.list_(pa.float64())] * 2)
    columns = zip(*rows, strict=True) if rows else [()] * len(types)
    content = [pa.array(list(column), kind) for column, kind in zip(columns, types, strict=True)]
    with writing(file), whole_file(file) as new:
        pq.write_table(pa.table(content, names=list(_COLUMNS)), new, compression="zstd")


def errors_of(questions: Mapping[str, ScoredSamples], submitted: Submission) -> list[Floats]:
    """ADE in metres of each asked vehicle, by question.

    Raises:
        InputError: Answers to other episodes, or an answer is missing or to nothing.
    """
    submitted.check_episodes([[name] for name in questions])
    errors = []
    for name, question in questions.items():
        rows, hypotheses = submitted.of_episode([name]).meet(question.batch)
        errors.append(ade(hypotheses, question.future_xy_m[rows]))
    return errors


def floor_of(questions: Mapping[str, ScoredSamples], models: Mapping[str, Predictor]) -> list[Floats]:
    """ADE in metres of whoever takes afterwards, for each vehicle, the best of all hypotheses of all models.

    Whoever is better than that on the average has seen the future, or deserves that somebody looks.
    """
    floors = []
    for question in questions.values():
        best = np.full(len(question), np.inf)
        for name, predictor in models.items():
            hypotheses, _ = causal_answer(name, predictor, question.batch)
            best = np.minimum(best, distances(hypotheses.xy_m, question.future_xy_m).mean(axis=-1).min(axis=1))
        floors.append(best)
    return floors
