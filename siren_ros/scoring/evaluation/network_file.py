"""A trained network as the project ships it: an ONNX file with its card next to it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from siren_ros.base.params import plain_json
from siren_ros.errors import InputError, whole_file, writing


@dataclass(frozen=True)
class NetworkFile:
    """A network that can be run, and what is known about it."""

    session: Any
    card: Mapping[str, Any]


def card_path(network: Path) -> Path:
    """Where the card of a network is: next to it."""
    return network.with_suffix(".json")


def open_network(path: Path) -> NetworkFile:
    """Loads a network. An ONNX file holds arithmetic only, and nothing in it is executed as code.

    Raises:
        InputError: No such file, no card, or weights that are not the card's or cannot be run.
    """
    try:
        weights = path.read_bytes()
        card = plain_json.read(card_path(path))
    except (OSError, ValueError) as error:
        raise InputError("checkpoint", str(path), f"an ONNX file with its card {card_path(path).name}") from error
    if not isinstance(card, dict) or card.get("sha256") != hashlib.sha256(weights).hexdigest():
        raise InputError("checkpoint", str(path), "the weights that its card describes (another hash)")
    import onnxruntime  # noqa: PLC0415 - it starts threads, which processes that fork must not have

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    # Episodes are worked on side by side in processes; threads of their own would only get in their way.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        session = onnxruntime.InferenceSession(weights, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own errors have no common class but this
        raise InputError("checkpoint", str(path), f"a network that onnxruntime can run ({error})") from error
    return NetworkFile(session, card)


def write_network(path: Path, weights: bytes, card: Mapping[str, Any]) -> None:
    """Writes weights and card; the card has their SHA-256.

    Raises:
        InputError: The folder cannot be written.
    """
    with writing(path.parent, "folder"):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            file.write_bytes(weights)
        with whole_file(card_path(path)) as file:
            file.write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
