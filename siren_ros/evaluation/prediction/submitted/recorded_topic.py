"""Predictions that a bag holds: those of a program that took part in the episode."""

from typing import Final

import numpy as np

from siren_ros.datasets.sources.episode_source import EpisodeSource
from siren_ros.errors import BagError
from siren_ros.evaluation.prediction.protocol.window import FUTURE_POINTS, HistoryWindow
from siren_ros.evaluation.prediction.submitted.columns import PERIODS_S, SubmittedRows, on_grid, refuse
from siren_ros.evaluation.prediction.submitted.submission import SubmittedPart, submission
from siren_ros.interfaces.programs.predictions import from_predicted_paths
from siren_ros.interfaces.topics import PREDICTIONS

_EPISODE: Final = "recorded"


def read_recorded_predictions(source: EpisodeSource, allow_missing: bool) -> SubmittedPart:
    """The predictions of an episode, checked.

    A program in the loop does not know who will stay in the population: samples of others are left out.

    Raises:
        BagError: The bag has no such topic.
        InputError: Paths of another horizon, and whatever ``submission`` refuses.
    """
    if PREDICTIONS.name not in source.bag.type_names:
        raise BagError(str(source.path), f"a bag with the topic {PREDICTIONS.name}, of an episode with a predictor")
    said = [from_predicted_paths(message.read()) for message in source.bag.messages({PREDICTIONS.name})]
    paths = [one for one in said if len(one)]
    counts = [len(one) for one in paths]
    step = np.repeat(np.array([one.step for one in paths], dtype=np.int64), counts)
    actor = np.concatenate([one.actor_id for one in paths]).astype(np.int64) if paths else step
    lengths = np.repeat(np.array([one.xy_m.shape[1] for one in paths], dtype=np.int64), counts)
    name = f"{PREDICTIONS.name} of {source.path}"
    refuse(
        name,
        ~np.isin(lengths, list(PERIODS_S)),
        "paths of another horizon",
        lambda row: f"actor {actor[row]} at step {step[row]} with {lengths[row]} points",
        f"paths of {', '.join(map(str, PERIODS_S))} points",
    )
    rows = SubmittedRows(
        source=name,
        episode=np.full(len(step), _EPISODE, dtype=object),
        actor_id=actor,
        step=step,
        mode=np.concatenate([np.arange(count) for count in counts]) if paths else step,
        probability=np.concatenate([one.probability for one in paths]) if paths else np.zeros(0),
        xy_m=np.concatenate([on_grid(one.xy_m) for one in paths]) if paths else np.zeros((0, FUTURE_POINTS, 2)),
        window=HistoryWindow(),
    )
    return submission(rows, allow_missing, allow_unknown=True).of_episode([_EPISODE])
