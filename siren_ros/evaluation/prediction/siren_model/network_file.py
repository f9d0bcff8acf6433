"""A trained network in an ONNX file, with its card next to it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnxruntime

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.protocol.window import FUTURE_POINTS
from siren_ros.evaluation.prediction.siren_model.features import FEATURES_VERSION, Ablation, Features
from siren_ros.numerics.arrays import Floats

OUTPUTS: Final = ("xy_m", "probability")
_SAMPLES_AT_ONCE: Final = 2048
"""Bounds the memory of a run."""


@dataclass(frozen=True)
class TrainedNetwork:
    """A network that can be run, and what is known about it."""

    session: Any
    card: Mapping[str, Any]

    @property
    def ablation(self) -> Ablation:
        """Input that the network was trained without."""
        return Ablation(self.card["ablation"])

    def run(self, features: Features) -> tuple[Floats, Floats]:
        """Paths in the samples' frames, ``(N, k, FUTURE_POINTS, 2)``, and probabilities, ``(N, k)``; not sorted."""
        parts = [
            self.session.run(OUTPUTS, _inputs(features, slice(start, start + _SAMPLES_AT_ONCE)))
            for start in range(0, len(features), _SAMPLES_AT_ONCE)
        ]
        if not parts:
            return np.empty((0, 1, FUTURE_POINTS, 2)), np.empty((0, 1))
        xy_m, probability = (np.concatenate(arrays).astype(np.float64) for arrays in zip(*parts, strict=True))
        return xy_m, probability


def _inputs(features: Features, rows: slice) -> dict[str, Any]:
    return {field.name: getattr(features, field.name)[rows] for field in fields(Features)}


def card_path(network: Path) -> Path:
    """Where the card of a network is: next to it."""
    return network.with_suffix(".json")


def load_network(path: Path) -> TrainedNetwork:
    """Loads a network. An ONNX file holds arithmetic only, and nothing in it is executed as code.

    Raises:
        InputError: No such file, no card, weights that are not the card's, or of another version of the features.
    """
    try:
        weights = path.read_bytes()
        card = json.loads(card_path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError("checkpoint", str(path), f"an ONNX file with its card {card_path(path).name}") from error
    if not isinstance(card, dict) or card.get("sha256") != hashlib.sha256(weights).hexdigest():
        raise InputError("checkpoint", str(path), "the weights that its card describes (another hash)")
    if card.get("features_version") != FEATURES_VERSION or card.get("ablation") not in set(Ablation):
        version = card.get("features_version")
        raise InputError("checkpoint", str(path), f"features of version {FEATURES_VERSION}, not {version}")
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    # Bags are scored side by side in processes; threads of their own would only get in their way.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        session = onnxruntime.InferenceSession(weights, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own errors have no common class but this
        raise InputError("checkpoint", str(path), f"a network that onnxruntime can run ({error})") from error
    return TrainedNetwork(session, card)
