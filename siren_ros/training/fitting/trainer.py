"""From samples to an ONNX file."""

from collections.abc import Callable

import torch

from siren_ros.training.fit_config import FitConfig, FittedNetwork
from siren_ros.training.fitting.fit import Progress, fit
from siren_ros.training.fitting.onnx_export import onnx_bytes
from siren_ros.training.sample_store import SampleStore


def fitted_network(store: SampleStore, config: FitConfig, told: Callable[[str], None]) -> FittedNetwork:
    """Fits a network and exports it.

    Args:
        store: The samples.
        config: Settings.
        told: Called with one line after each epoch.
    """

    def tell(progress: Progress) -> None:
        told(
            f"epoch {progress.epoch + 1}/{config.epochs}: loss {progress.loss:.3f}, ADE {progress.ade_m:.3f} m, "
            f"minADE6 {progress.min_ade_m:.3f} m, {progress.seconds:.0f} s"
        )

    network = fit(store, config, tell)
    return FittedNetwork(
        onnx=onnx_bytes(network),
        parameters=sum(weights.numel() for weights in network.parameters()),
        made_with=f"torch {torch.__version__}",
    )
