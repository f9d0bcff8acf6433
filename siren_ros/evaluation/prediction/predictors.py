"""The table of all trajectory predictors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Final

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.protocol.predictor import Predictor, PredictorOptions

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
    """Where its constructor is: ``module:name``, loaded when it is asked for; it takes ``PredictorOptions``."""
    checkpoint: Checkpoint = Checkpoint.NONE
    extra: str = ""
    """Extra of the package that brings what the constructor imports; empty where nothing more is needed."""

    def make(self, name: str, options: PredictorOptions) -> Predictor:
        """The predictor.

        Raises:
            InputError: It takes no checkpoint, needs one, or the packages of its extra are not installed.
        """
        given = options.checkpoint
        if given is not None and self.checkpoint is Checkpoint.NONE:
            raise InputError("checkpoint", f"{name}={given}", f"a model that has weights, unlike {name}")
        if given is None and self.checkpoint is Checkpoint.REQUIRED:
            raise InputError("models", name, f"{name} together with --checkpoint {name}=PATH")
        module, _, attribute = self.maker.partition(":")
        try:
            found: Predictor = getattr(import_module(module), attribute)(options)
        except ModuleNotFoundError as error:
            if not self.extra:
                raise
            runs = f"./env --with {self.extra} siren evaluate prediction …"
            raise InputError("models", name, f"the package {error.name}, as {runs} brings it") from error
        return found


_BASELINES: Final = "siren_ros.evaluation.prediction.baselines"
_PUBLISHED: Final = "siren_ros.evaluation.prediction.published.predictors"
_OWN: Final = "siren_ros.evaluation.prediction.siren_model.siren_predictor"
PREDICTORS: Final[Mapping[str, PredictorKind]] = {
    "cv": PredictorKind("constant velocity", f"{_BASELINES}.constant_velocity:make"),
    "idm": PredictorKind("Intelligent Driver Model along the lane", f"{_BASELINES}.idm_predictor:make"),
    "siren": PredictorKind("SIREN's own, trained on its episodes", f"{_OWN}:make", Checkpoint.OPTIONAL),
    "csp": PredictorKind("convolutional social pooling", f"{_PUBLISHED}:make_csp", Checkpoint.REQUIRED, "models"),
    "stdan": PredictorKind("dynamic attention", f"{_PUBLISHED}:make_stdan", Checkpoint.REQUIRED, "models"),
    "bat": PredictorKind("behaviour-aware", f"{_PUBLISHED}:make_bat", Checkpoint.REQUIRED, "models"),
}
"""Every predictor, by the user's name for it."""


def predictors_named(names: Sequence[str], checkpoints: Mapping[str, Path] | None = None) -> dict[str, Predictor]:
    """The predictors of some names, in their order.

    Args:
        names: Names of the table, each alone or with a label (``csp:mine``).
        checkpoints: Files of weights by the names, with their labels.

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
    return {
        name: PREDICTORS[name.partition(LABEL)[0]].make(name, PredictorOptions(checkpoints.get(name))) for name in names
    }
