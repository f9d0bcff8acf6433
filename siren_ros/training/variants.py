"""What is trained: the whole predictor, and without one of its sources."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from siren_ros.evaluation.prediction.siren_model.features import Ablation


@dataclass(frozen=True)
class Variant:
    """One way to train."""

    summary: str
    ablation: Ablation = Ablation.NONE
    ordinary_only: bool = False
    """Whether only episodes without emergency driving (L0) are trained on."""
    as_few_as_ordinary: bool = False
    """Whether no more episodes are trained on than there are ordinary ones."""


FULL: Final = "full"
VARIANTS: Final = MappingProxyType(
    {
        FULL: Variant("everything"),
        "no_siren": Variant("without beacon and siren", Ablation.SIREN),
        "no_map": Variant("without lanes, stop lines and signals", Ablation.MAP),
        "ordinary": Variant("trained on ordinary traffic only (L0)", ordinary_only=True),
        "few": Variant("trained on as many episodes as ordinary, of all levels", as_few_as_ordinary=True),
    }
)
"""By name. ``few`` tells what of the loss of ``ordinary`` is due to fewer episodes."""
