"""Checks that a predictor uses only the past.

A predictor gets all frames of an episode at once. On a sample of frames it is asked again with that frame alone, and,
where its answer then differs, with the frames up to that one: a predictor may look back, but never ahead.
"""

from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Rows
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses, Predictor, checked
from siren_ros.scoring.evaluation.prediction.samples import SampleBatch

CHECKED_FRAMES: Final = 3
"""Number of checked frames per episode, spread over it, without the last frame, after which nothing follows."""
TOLERANCE_M: Final = 0.01
"""Tolerance, because networks round differently in batches of other sizes."""
_LEAST_PROBABILITY: Final = 0.01
"""Hypotheses with a smaller probability are not compared one by one, because rounding may drop them."""


class CausalityError(InputError):
    """Raised for a predictor whose answer depends on later frames."""

    def __init__(self, model: str, step: int, away_m: float) -> None:
        where = f"answers at step {step} that move by {away_m:.2g} m with the later frames"
        super().__init__(
            f"model {model}", where, "a predictor that looks at the past alone and gives one answer each time"
        )


def causal_answer(model: str, predictor: Predictor, batch: SampleBatch) -> tuple[Hypotheses, int]:
    """The hypotheses of a whole batch, and the number of frames on which they were checked.

    The predictor is asked about single frames before it sees the whole.

    Raises:
        CausalityError: The answers to the whole batch differ from those to the frames until then.
        InputError: Answers that cannot be scored.
    """
    frames = _frames(batch)
    alone = {frame: _answer(model, predictor, batch.between(frame, frame + 1)) for frame in frames}
    whole = _answer(model, predictor, batch)
    for frame, answer in alone.items():
        rows = np.flatnonzero(batch.actors.frame[batch.target] == frame)
        expected = whole.select(rows)
        if _apart_m(answer, expected) <= TOLERANCE_M:
            continue
        until = _answer(model, predictor, batch.between(0, frame + 1))
        away_m = _apart_m(until.select(np.arange(len(until) - len(rows), len(until))), expected)
        if away_m > TOLERANCE_M:
            raise CausalityError(model, int(batch.step[frame]), away_m)
    return whole, len(frames)


def _frames(batch: SampleBatch) -> list[int]:
    """Frames with samples, evenly spread, without the last one of the batch."""
    with_samples = np.unique(batch.actors.frame[batch.target])
    before_the_last: Rows = with_samples[with_samples < len(batch.step) - 1]
    if not len(before_the_last):
        return []
    places = np.linspace(0.0, len(before_the_last) - 1, CHECKED_FRAMES + 2)[1:-1]
    return [int(before_the_last[place]) for place in np.unique(np.round(places).astype(np.intp))]


def _answer(model: str, predictor: Predictor, batch: SampleBatch) -> Hypotheses:
    return checked(model, predictor.predict(batch), len(batch))


def _apart_m(first: Hypotheses, second: Hypotheses) -> float:
    """Largest distance between two answers: between their mean paths, and from each path to the nearest one.

    Equally probable hypotheses may change their order.
    """
    means = (_mean(first) - _mean(second), first.xy_m[:, :, None] - second.xy_m[:, None])
    miss_m = [np.hypot(miss[..., 0], miss[..., 1]) for miss in means]
    pairs_m = miss_m[1].max(axis=-1)
    nearest_m = (
        np.where(first.probability > _LEAST_PROBABILITY, pairs_m.min(axis=2), 0.0),
        np.where(second.probability > _LEAST_PROBABILITY, pairs_m.min(axis=1), 0.0),
    )
    return float(max(values.max(initial=0.0) for values in (miss_m[0], *nearest_m)))


def _mean(hypotheses: Hypotheses) -> Floats:
    return np.asarray((hypotheses.xy_m * hypotheses.probability[..., None, None]).sum(axis=1))
