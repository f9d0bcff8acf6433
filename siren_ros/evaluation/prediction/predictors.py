"""The protocol of trajectory predictors, and the table of all predictors."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, Protocol

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.constant_velocity import ConstantVelocity
from siren_ros.evaluation.prediction.idm_predictor import IdmPredictor
from siren_ros.evaluation.prediction.prediction_samples import SampleBatch
from siren_ros.evaluation.prediction.prediction_window import FUTURE_POINTS, HistoryWindow
from siren_ros.numerics.arrays import Floats


class Predictor(Protocol):
    """Predicts the positions of vehicles from their past, their neighbours' past and the map."""

    @property
    def window(self) -> HistoryWindow:
        """The past that the predictor needs; a sample has this past and the common future."""

    def predict(self, batch: SampleBatch) -> Floats:
        """Hypotheses on the common grid, shape ``(N, k, FUTURE_POINTS, 2)``, frame ``map``, the most probable first."""


PREDICTORS: Final[Mapping[str, Callable[[], Predictor]]] = {"cv": ConstantVelocity, "idm": IdmPredictor}
"""Constructor of each predictor, by the user's name for it. A constructor may load files."""


def predictors_named(names: Sequence[str]) -> dict[str, Predictor]:
    """The predictors of some names, in their order.

    Raises:
        InputError: No name, one given twice, or one that is unknown.
    """
    known = ", ".join(PREDICTORS)
    if not names:
        raise InputError("models", "", f"one or several of {known}")
    for position, name in enumerate(names):
        if name not in PREDICTORS:
            raise InputError("models", name, f"one or several of {known}")
        if name in names[:position]:
            raise InputError("models", name, "each model once")
    return {name: PREDICTORS[name]() for name in names}


def hypotheses_of(name: str, predictor: Predictor, batch: SampleBatch) -> Floats:
    """A predictor's hypotheses, checked.

    Raises:
        InputError: The hypotheses do not have the protocol's shape, or have values that are not finite.
    """
    hypotheses = np.asarray(predictor.predict(batch), dtype=np.float64)
    wanted = f"hypotheses of shape ({len(batch)}, k, {FUTURE_POINTS}, 2) with finite values"
    shape = hypotheses.shape
    if len(shape) != 4 or shape[1] < 1 or (shape[0], *shape[2:]) != (len(batch), FUTURE_POINTS, 2):
        raise InputError(f"model {name}", shape, wanted)
    if not np.isfinite(hypotheses).all():
        raise InputError(f"model {name}", "values that are not finite", wanted)
    return hypotheses
