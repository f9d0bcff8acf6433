"""A detector in an ONNX file, with its card next to it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnxruntime

from siren_ros.errors import InputError
from siren_ros.evaluation.detection.pillars.grid import PillarGrid
from siren_ros.evaluation.detection.pillars.pillars import FEATURES, Pillars
from siren_ros.numerics.arrays import Floats

FORM_VERSION: Final = 1
"""Of inputs and outputs; a file of another form is refused."""
INPUTS: Final = ("points", "cell")
OUTPUTS: Final = ("box", "score", "class_share")
BOX_COLUMNS: Final = ("x", "y", "z", "length", "width", "height", "sin", "cos", "vx", "vy")
"""Of ``box``: in the LiDAR's frame, with the centre of the volume and the velocity over ground."""


@dataclass(frozen=True)
class DetectorNetwork:
    """A network that can be run, and what is known about it."""

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


def card_path(network: Path) -> Path:
    """Where the card of a network is: next to it."""
    return network.with_suffix(".json")


def load_detector(path: Path, threads: int = 1) -> DetectorNetwork:
    """Loads a detector. An ONNX file holds arithmetic only, and nothing in it is executed as code.

    Args:
        path: The ONNX file.
        threads: Of onnxruntime. Bags are scored side by side in processes, where more would get in each other's way.

    Raises:
        InputError: No such file, no card, weights that are not the card's, or another form.
    """
    try:
        weights = path.read_bytes()
        card = json.loads(card_path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError("detector", str(path), f"an ONNX file with its card {card_path(path).name}") from error
    if not isinstance(card, dict) or card.get("sha256") != hashlib.sha256(weights).hexdigest():
        raise InputError("detector", str(path), "the weights that its card describes (another hash)")
    if card.get("form_version") != FORM_VERSION or not isinstance(card.get("grid"), dict):
        raise InputError("detector", str(path), f"a detector of form {FORM_VERSION}, not {card.get('form_version')}")
    grid = PillarGrid.from_json(card["grid"])
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    try:
        session = onnxruntime.InferenceSession(weights, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own errors have no common class but this
        raise InputError("detector", str(path), f"a network that onnxruntime can run ({error})") from error
    shape = session.get_inputs()[0].shape
    if [one.name for one in session.get_inputs()] != list(INPUTS) or shape[1:] != [grid.points, len(FEATURES)]:
        raise InputError("detector", str(path), f"inputs {', '.join(INPUTS)} as the card's grid has them")
    return DetectorNetwork(session, card, grid, tuple(card["class_names"]))
