"""Trajectory predictors: their result type, their protocol, the table of all predictors, and whether one looks ahead.

A predictor gets all frames of an episode at once, and may use only the past. To check this, a copy of it from before
that is asked again on frames drawn anew in each run, with that frame alone, and, where its answer then differs, with
the frames up to that one: a predictor may look back, but never ahead. It cannot know at which frames it will be asked.
This proves nothing of a predictor that reads the bag itself, or the memory of this process.
"""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.samples import FUTURE_POINTS, HistoryWindow, SampleBatch

SUM_TOLERANCE: Final = 1e-3
"""Allowed difference of a sample's sum of probabilities from 1, since models compute in single precision."""


@dataclass(frozen=True)
class Hypotheses:
    """k predicted paths for each of N samples, most probable first; ``checked`` verifies the conditions."""

    xy_m: Floats
    """Positions on the common grid, frame ``map``, shape ``(N, k, FUTURE_POINTS, 2)``."""
    probability: Floats
    """Probabilities of each sample's paths, shape ``(N, k)``, decreasing, with the sum 1."""

    def __len__(self) -> int:
        return len(self.xy_m)

    @staticmethod
    def certain(xy_m: Floats) -> "Hypotheses":
        """Make one hypothesis per sample from paths of shape ``(N, FUTURE_POINTS, 2)``."""
        return Hypotheses(xy_m[:, None], np.ones((len(xy_m), 1)))

    @staticmethod
    def ranked(xy_m: Floats, probability: Floats) -> "Hypotheses":
        """Sort hypotheses by probability, equal ones in the given order, and scale the sum to exactly 1.

        Args:
            xy_m: Shape ``(N, k, FUTURE_POINTS, 2)``.
            probability: Shape ``(N, k)``, with positive sums.
        """
        order = np.argsort(-probability, axis=1, kind="stable")
        ranked = np.take_along_axis(probability, order, axis=1)
        paths_m = np.take_along_axis(xy_m, order[..., None, None], axis=1)
        return Hypotheses(paths_m, ranked / ranked.sum(axis=1, keepdims=True))

    def select(self, samples: Flags | Rows) -> "Hypotheses":
        """Select some of the samples by a mask or by indices."""
        return Hypotheses(self.xy_m[samples], self.probability[samples])


def checked(model: str, hypotheses: Hypotheses, samples: int) -> Hypotheses:
    """Check hypotheses and convert them to double precision.

    Raises:
        InputError: A wrong shape, values that are not finite, negative probabilities, probabilities that increase, or
            sums that are not 1; with the number of samples that are wrong, and the first.
    """
    xy_m = np.asarray(hypotheses.xy_m, dtype=np.float64)
    probability = np.asarray(hypotheses.probability, dtype=np.float64)
    shape = xy_m.shape
    if len(shape) != 4 or shape[1] < 1 or (shape[0], *shape[2:]) != (samples, FUTURE_POINTS, 2):
        raise InputError(f"model {model}", shape, f"hypotheses of shape ({samples}, k, {FUTURE_POINTS}, 2)")
    if probability.shape != shape[:2]:
        raise InputError(f"model {model}", probability.shape, f"probabilities of shape {shape[:2]}")
    for refused, what, allowed in (
        (~np.isfinite(xy_m).all(axis=(1, 2, 3)), "positions that are not finite", "finite values"),
        (~np.isfinite(probability).all(axis=1), "probabilities that are not finite", "finite values"),
        ((probability < 0.0).any(axis=1), "negative probabilities", "0 or more"),
        ((np.diff(probability, axis=1) > 0.0).any(axis=1), "probabilities that increase", "the most probable first"),
        (np.abs(probability.sum(axis=1) - 1.0) > SUM_TOLERANCE, "probabilities of another sum", "a sum of 1"),
    ):
        if refused.any():
            where = f"{what} in {refused.sum()} of {samples} samples, first in {int(np.argmax(refused))}"
            raise InputError(f"model {model}", where, allowed)
    return Hypotheses(xy_m, probability)


class Predictor(Protocol):
    """Predicts the positions of vehicles from their past, their neighbours' past and the map."""

    @property
    def window(self) -> HistoryWindow:
        """The history that the predictor needs; only vehicles with this history and the common future are samples."""

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """Predict all samples of the batch, in its order."""


LABEL: Final = ":"
"""Separator of model and label: ``csp:mine`` is the model ``csp`` with a row of its own."""


class Checkpoint(Enum):
    """Whether a predictor loads trained weights from a file."""

    NONE = "takes none"
    OPTIONAL = "may be given"
    REQUIRED = "must be given"


@dataclass(frozen=True)
class PredictorKind:
    """One entry of the table of predictors."""

    summary: str
    maker: str
    """Constructor as ``module:name``, loaded when the predictor is used. It takes the file of the weights, or None for
    the shipped ones; without weights it takes nothing."""
    checkpoint: Checkpoint = Checkpoint.NONE
    extra: str = ""
    """Extra of the package with the constructor's dependencies; empty if it needs none."""
    simple: bool = False
    """Whether the predictor has no learned part. Claims are made against the best of these."""

    def make(self, name: str, checkpoint: Path | None = None) -> Predictor:
        """Make the predictor.

        Raises:
            InputError: It takes no checkpoint, needs one, or the packages of its extra are not installed.
        """
        if checkpoint is not None and self.checkpoint is Checkpoint.NONE:
            raise InputError("checkpoint", f"{name}={checkpoint}", f"a model that has weights, unlike {name}")
        if checkpoint is None and self.checkpoint is Checkpoint.REQUIRED:
            raise InputError("models", name, f"{name} together with --checkpoint {name}=PATH")
        module, _, attribute = self.maker.partition(":")
        arguments = () if self.checkpoint is Checkpoint.NONE else (checkpoint,)
        try:
            predictor: Predictor = getattr(import_module(module), attribute)(*arguments)
        except ModuleNotFoundError as error:
            if not self.extra:
                raise
            runs = f"./env --with {self.extra} siren evaluate prediction …"
            raise InputError("models", name, f"the package {error.name}, as {runs} brings it") from error
        return predictor


_PREDICTION: Final = "siren_ros.scoring.evaluation.prediction"
_BASELINES: Final = f"{_PREDICTION}.baselines"
_SIREN: Final = f"{_PREDICTION}.siren_model.siren_predictor:make"
_PUBLISHED: Final = f"{_PREDICTION}.published.predictors"


def _simple(summary: str, maker: str) -> PredictorKind:
    return PredictorKind(summary, maker, simple=True)


PREDICTORS: Final[Mapping[str, PredictorKind]] = {
    "cv": _simple("constant velocity", f"{_BASELINES}:ConstantVelocity"),
    "idm": _simple("Intelligent Driver Model along the lane", f"{_BASELINES}:IdmPredictor"),
    "ca": _simple("constant acceleration", f"{_BASELINES}:make_ca"),
    "ctra": _simple("constant turn rate and acceleration", f"{_BASELINES}:make_ctra"),
    "cv_lane": _simple("constant speed along the lane", f"{_BASELINES}:make_cv_lane"),
    "ca_lane": _simple("constant acceleration along the lane", f"{_BASELINES}:make_ca_lane"),
    "decay_lane": _simple("along the lane, acceleration that decays", f"{_BASELINES}:make_decay_lane"),
    "idm_stop": _simple("IDM that stops at red signals and stop signs", f"{_BASELINES}:make_idm_stop"),
    "decay_stop": _simple("decay_lane that stops there, too", f"{_BASELINES}:make_decay_stop"),
    "imm": _simple("Kalman filter of two interacting models", f"{_PREDICTION}.imm:ImmPredictor"),
    "siren": PredictorKind("SIREN's own, trained on its episodes", _SIREN, Checkpoint.OPTIONAL),
    "csp": PredictorKind("convolutional social pooling", f"{_PUBLISHED}:make_csp", Checkpoint.REQUIRED, "models"),
    "stdan": PredictorKind("dynamic attention", f"{_PUBLISHED}:make_stdan", Checkpoint.REQUIRED, "models"),
    "bat": PredictorKind("behaviour-aware", f"{_PUBLISHED}:make_bat", Checkpoint.REQUIRED, "models"),
}
"""All predictors by name."""


def is_simple(model: str) -> bool:
    """Whether a model, with or without a label, is a simple baseline; predictions of other programs are not."""
    kind = PREDICTORS.get(model.partition(LABEL)[0])
    return kind is not None and kind.simple


def predictors_named(names: Sequence[str], checkpoints: Mapping[str, Path] | None = None) -> dict[str, Predictor]:
    """Make predictors by name, in the given order; a name may have a label (``csp:mine``).

    ``checkpoints`` are files of weights by the names, with their labels.

    Raises:
        InputError: No name, one given twice, one that is unknown, or a checkpoint that fits no name.
    """
    checkpoints = checkpoints or {}
    known = f"one or several of {', '.join(PREDICTORS)}"
    if not names:
        raise InputError("models", "", known)
    for position, name in enumerate(names):
        if name.partition(LABEL)[0] not in PREDICTORS:
            raise InputError("models", name, known)
        if name in names[:position]:
            raise InputError("models", name, "each model once")
    for name, path in checkpoints.items():
        if name not in names:
            raise InputError("checkpoint", f"{name}={path}", f"a name among the models: {', '.join(names)}")
    return {name: PREDICTORS[name.partition(LABEL)[0]].make(name, checkpoints.get(name)) for name in names}


CHECKED_FRAMES: Final = 3
"""Number of checked frames per episode, without the last frame, after which nothing follows."""
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


def causal_answer(
    model: str, predictor: Predictor, batch: SampleBatch, rng: np.random.Generator | None = None
) -> tuple[Hypotheses, int]:
    """The hypotheses of a whole batch, and the number of frames on which they were checked.

    The frames are drawn by ``rng``, without it from the system's entropy. What cannot be copied is asked itself.

    Raises:
        CausalityError: The answers to the whole batch differ from those to the frames until then.
        InputError: Answers that cannot be scored.
    """
    fresh = _copied(predictor)
    whole = _answer(model, predictor, batch)
    frames = _frames(batch, rng or np.random.default_rng())
    for frame in frames:
        rows = np.flatnonzero(batch.actors.frame[batch.target] == frame)
        expected = whole.select(rows)
        if _apart_m(_answer(model, fresh, batch.between(frame, frame + 1)), expected) <= TOLERANCE_M:
            continue
        until = _answer(model, fresh, batch.between(0, frame + 1))
        away_m = _apart_m(until.select(np.arange(len(until) - len(rows), len(until))), expected)
        if away_m > TOLERANCE_M:
            raise CausalityError(model, int(batch.step[frame]), away_m)
    return whole, len(frames)


def _copied(predictor: Predictor) -> Predictor:
    try:
        return deepcopy(predictor)
    except Exception:  # noqa: BLE001 - a program of somebody else: sessions of networks, handles, locks
        return predictor


def _frames(batch: SampleBatch, rng: np.random.Generator) -> list[int]:
    """Frames with samples, drawn among all, in their order, without the last one of the batch."""
    with_samples = np.unique(batch.actors.frame[batch.target])
    before_the_last: Rows = with_samples[with_samples < len(batch.step) - 1]
    count = min(CHECKED_FRAMES, len(before_the_last))
    return sorted(rng.choice(before_the_last, count, replace=False).tolist()) if count else []


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
