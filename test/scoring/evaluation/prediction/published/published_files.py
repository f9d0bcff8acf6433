"""Where the published weights and the authors' answers to golden inputs are, on machines that have them."""

from pathlib import Path
from typing import Any

import numpy as np
from repository import shared_file

WEIGHTS = {"csp": "csp_ngsim.pt", "stdan": "stdan_ngsim_epoch9.pt", "bat": "bat_ngsim_epoch8.pt"}


def weights(model: str) -> Path:
    """The file of a model's published weights."""
    return shared_file("checkpoints", WEIGHTS[model])


def golden(model: str) -> dict[str, np.ndarray[Any, Any]]:
    """Inputs, and what the authors' code answers to them."""
    with np.load(shared_file("checkpoints", f"{model}_golden.npz")) as content:
        return dict(content)


def golden_cells(known: dict[str, np.ndarray[Any, Any]]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Sample and cell of each neighbour of golden inputs."""
    taken = known["mask"][..., 0].reshape(len(known["mask"]), -1)
    sample, cell = np.nonzero(taken)
    return sample, cell
