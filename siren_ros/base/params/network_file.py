"""Trained networks as files: an ONNX file with its card beside it."""

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
    """A network that can be run, with its card."""

    session: Any
    card: Mapping[str, Any]


def card_path(network: Path) -> Path:
    """Path of a network's card, beside the network."""
    return network.with_suffix(".json")


def open_network(path: Path) -> NetworkFile:
    """Load a network. An ONNX file contains only arithmetic; nothing in it is executed as code.

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
    import onnxruntime  # noqa: PLC0415 - it starts threads, and a process with threads must not fork

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    # Episodes run in parallel processes, where further threads would only compete.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        session = onnxruntime.InferenceSession(weights, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # errors of onnxruntime have no other common class
        raise InputError("checkpoint", str(path), f"a network that onnxruntime can run ({error})") from error
    return NetworkFile(session, card)


def write_network(path: Path, weights: bytes, card: Mapping[str, Any]) -> None:
    """Write weights and card; the card contains the weights' SHA-256.

    Raises:
        InputError: The folder cannot be written.
    """
    with writing(path.parent, "folder"):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            file.write_bytes(weights)
        with whole_file(card_path(path)) as file:
            file.write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
