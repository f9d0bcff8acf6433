"""A detector in an ONNX file, with its card next to it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.detection.pillars.grid import PillarGrid
from siren_ros.evaluation.detection.pillars.pillars import FEATURES, Pillars
from siren_ros.evaluation.network_file import open_network
from siren_ros.numerics.arrays import Floats

FORM_VERSION: Final = 1
"""Of inputs and outputs; a file of another form is refused."""
INPUTS: Final = ("points", "cell")
OUTPUTS: Final = ("box", "score", "class_share")
BOX_COLUMNS: Final = ("x", "y", "z", "length", "width", "height", "sin", "cos", "vx", "vy")
"""Of ``box``: in the LiDAR's frame, with the centre of the volume and the velocity over ground."""


@dataclass(frozen=True)
class DetectorNetwork:
    """A network that finds boxes, and what is known about it."""

    session: Any
    card: Mapping[str, Any]
    grid: PillarGrid
    class_names: tuple[str, ...]

    def run(self, pillars: Pillars) -> tuple[Floats, Floats, Floats]:
        """Boxes ``(K, 10)``, scores ``(K,)`` and shares of the classes ``(K, C)``, the highest scores first."""
        if not len(pillars):
            return np.zeros((0, len(BOX_COLUMNS))), np.zeros(0), np.zeros((0, len(self.class_names)))
        box, score, share = self.session.run(OUTPUTS, {"points": pillars.points, "cell": pillars.cell})
        return box.astype(np.float64), score.astype(np.float64), share.astype(np.float64)


def load_detector(path: Path) -> DetectorNetwork:
    """Loads a detector, which runs on one processor.

    Raises:
        InputError: No such file, no card, weights that are not the card's, or another form.
    """
    network = open_network(path)
    card, inputs = network.card, network.session.get_inputs()
    if card.get("form_version") != FORM_VERSION or not isinstance(card.get("grid"), dict):
        raise InputError("checkpoint", str(path), f"a detector of form {FORM_VERSION}, not {card.get('form_version')}")
    grid = PillarGrid.from_json(card["grid"])
    if [one.name for one in inputs] != list(INPUTS) or inputs[0].shape[1:] != [grid.points, len(FEATURES)]:
        raise InputError("checkpoint", str(path), f"inputs {', '.join(INPUTS)} as the card's grid has them")
    return DetectorNetwork(network.session, card, grid, tuple(card["class_names"]))
