"""Classes by their names: emergency vehicles by kind, and ``car`` for all other vehicles."""

from typing import Final

import numpy as np

from siren_ros.evaluation.detection.protocol.boxes import FoundBoxes, TruthBoxes
from siren_ros.numerics.arrays import Flags
from siren_ros.world.actors import EMERGENCY_CLASSES

CAR: Final = "car"
_EMERGENCY: Final = {one.name.lower(): one for one in sorted(EMERGENCY_CLASSES)}
CLASS_NAMES: Final = (CAR, *_EMERGENCY)
"""Names that a detection can have: ``car`` for every civilian vehicle, as in the paper, and the emergency vehicles."""


def labels_named(truth: TruthBoxes, name: str) -> Flags:
    """Which labels should get that one of ``CLASS_NAMES``, shape ``(N,)``."""
    of_kind = _EMERGENCY.get(name)
    wanted: Flags = (
        truth.actor_class == of_kind if of_kind is not None else ~np.isin(truth.actor_class, [*EMERGENCY_CLASSES])
    )
    return wanted


def names_kinds(found: FoundBoxes) -> bool:
    """Whether any detection has the name of an emergency vehicle."""
    return bool(np.isin(found.label, [*_EMERGENCY]).any())
