"""Where the published weights and the authors' answers to golden inputs are, on machines that have them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from repository import REPOSITORY

CHECKPOINTS = REPOSITORY.parent / "shared" / "checkpoints"
WEIGHTS = {"csp": "csp_ngsim.pt", "stdan": "stdan_ngsim_epoch9.pt", "bat": "bat_ngsim_epoch8.pt"}


def weights(model: str) -> Path:
    """The file of a model's published weights."""
    return _there(CHECKPOINTS / WEIGHTS[model])


def golden(model: str) -> dict[str, np.ndarray[Any, Any]]:
    """Inputs, and what the authors' code answers to them."""
    with np.load(_there(CHECKPOINTS / f"{model}_golden.npz")) as content:
        return dict(content)


def golden_cells(known: dict[str, np.ndarray[Any, Any]]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Sample and cell of each neighbour of golden inputs."""
    taken = known["mask"][..., 0].reshape(len(known["mask"]), -1)
    sample, cell = np.nonzero(taken)
    return sample, cell


def _there(path: Path) -> Path:
    if not path.is_file():
        pytest.skip(f"the published weights are not on this machine ({path.name})")
    return path
