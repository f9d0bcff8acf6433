"""Trajectory predictors: what they answer, their protocol, and the table of all."""

from collections.abc import Mapping, Sequence
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
"""How far the probabilities of a sample may sum up from 1: models answer in single precision."""


@dataclass(frozen=True)
class Hypotheses:
    """k predicted paths for each of N samples, the most probable first. ``checked`` says what must hold."""

    xy_m: Floats
    """Positions on the common grid, frame ``map``, shape ``(N, k, FUTURE_POINTS, 2)``."""
    probability: Floats
    """Shape ``(N, k)``; of each sample not increasing, and the sum is 1."""

    def __len__(self) -> int:
        return len(self.xy_m)

    @staticmethod
    def certain(xy_m: Floats) -> "Hypotheses":
        """One hypothesis for each sample, from paths of shape ``(N, FUTURE_POINTS, 2)``."""
        return Hypotheses(xy_m[:, None], np.ones((len(xy_m), 1)))

    @staticmethod
    def ranked(xy_m: Floats, probability: Floats) -> "Hypotheses":
        """Sorts hypotheses by their probability, equal ones in the given order, and makes the sum exactly 1.

        Args:
            xy_m: Shape ``(N, k, FUTURE_POINTS, 2)``.
            probability: Shape ``(N, k)``, with positive sums.
        """
        order = np.argsort(-probability, axis=1, kind="stable")
        ranked = np.take_along_axis(probability, order, axis=1)
        paths_m = np.take_along_axis(xy_m, order[..., None, None], axis=1)
        return Hypotheses(paths_m, ranked / ranked.sum(axis=1, keepdims=True))

    def select(self, samples: Flags | Rows) -> "Hypotheses":
        """Some of the samples, given as a mask or as indices."""
        return Hypotheses(self.xy_m[samples], self.probability[samples])


def checked(model: str, hypotheses: Hypotheses, samples: int) -> Hypotheses:
    """The hypotheses as double precision.

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
        """The past that the predictor needs; a sample has this past and the common future."""

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """The hypotheses of every sample of the batch, in its order."""


LABEL: Final = ":"
"""Separates a model from its label: ``csp:mine`` is the model ``csp``, in a row of its own."""


class Checkpoint(Enum):
    """Whether a predictor loads trained weights from a file."""

    NONE = "takes none"
    OPTIONAL = "may be given"
    REQUIRED = "must be given"


@dataclass(frozen=True)
class PredictorKind:
    """One line of the table of predictors."""

    summary: str
    maker: str
    """Where its constructor is: ``module:name``, loaded when the predictor is asked for. It takes the file of the
    weights, or None for its own ones; the constructor of a predictor without weights takes nothing."""
    checkpoint: Checkpoint = Checkpoint.NONE
    extra: str = ""
    """Extra of the package that brings what the constructor imports; empty where nothing more is needed."""
    simple: bool = False
    """Whether nothing of it is learned. Claims are made against the best of these."""

    def make(self, name: str, checkpoint: Path | None = None) -> Predictor:
        """The predictor.

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


_HERE: Final = "siren_ros.scoring.evaluation.prediction"
_BASELINES: Final = f"{_HERE}.baselines"
_SIREN: Final = "siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor:make"
_PUBLISHED: Final = "siren_ros.scoring.evaluation.prediction.published.predictors"


def _simple(summary: str, maker: str) -> PredictorKind:
    return PredictorKind(summary, maker, simple=True)


PREDICTORS: Final[Mapping[str, PredictorKind]] = {
    "cv": _simple("constant velocity", f"{_BASELINES}:ConstantVelocity"),
    "idm": _simple("Intelligent Driver Model along the lane", f"{_BASELINES}:IdmPredictor"),
    "ca": _simple("constant acceleration", f"{_HERE}.kinematic:make_ca"),
    "ctra": _simple("constant turn rate and acceleration", f"{_HERE}.kinematic:make_ctra"),
    "cv_lane": _simple("constant speed along the lane", f"{_HERE}.lane_following:make_cv_lane"),
    "ca_lane": _simple("constant acceleration along the lane", f"{_HERE}.lane_following:make_ca_lane"),
    "decay_lane": _simple("along the lane, acceleration that decays", f"{_HERE}.lane_following:make_decay_lane"),
    "imm": _simple("Kalman filter of two interacting models", f"{_HERE}.kalman:ImmPredictor"),
    "siren": PredictorKind("SIREN's own, trained on its episodes", _SIREN, Checkpoint.OPTIONAL),
    "csp": PredictorKind("convolutional social pooling", f"{_PUBLISHED}:make_csp", Checkpoint.REQUIRED, "models"),
    "stdan": PredictorKind("dynamic attention", f"{_PUBLISHED}:make_stdan", Checkpoint.REQUIRED, "models"),
    "bat": PredictorKind("behaviour-aware", f"{_PUBLISHED}:make_bat", Checkpoint.REQUIRED, "models"),
}
"""Every predictor, by the user's name for it."""


def is_simple(model: str) -> bool:
    """Whether a model, with or without a label, is a simple baseline; what other programs predicted is none."""
    kind = PREDICTORS.get(model.partition(LABEL)[0])
    return kind is not None and kind.simple


def predictors_named(names: Sequence[str], checkpoints: Mapping[str, Path] | None = None) -> dict[str, Predictor]:
    """The predictors of some names of the table, in their order; a name may have a label (``csp:mine``).

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
