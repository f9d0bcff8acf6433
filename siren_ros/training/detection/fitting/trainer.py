"""From frames to an ONNX file."""

from collections.abc import Callable
from pathlib import Path

import torch

from siren_ros.training.detection.fit_config import DetectionFit, FittedDetector, NetworkSize
from siren_ros.training.detection.fitting.fit import Progress, fit
from siren_ros.training.detection.fitting.onnx_export import onnx_bytes
from siren_ros.training.detection.frame_draws import FrameDraws


def fitted_detector(
    draws: FrameDraws, config: DetectionFit, threads: int, checkpoint: Path, told: Callable[[str], bool]
) -> FittedDetector | None:
    """Fits a network and exports it.

    Args:
        draws: The frames.
        config: Settings.
        threads: Of the processor.
        checkpoint: Where the state is kept, and taken from.
        told: Called with one line at each checkpoint; False stops the training there.

    Returns:
        The network; None where the training was stopped.
    """
    torch.set_num_threads(threads)

    def tell(progress: Progress) -> bool:
        return told(
            f"step {progress.step}/{config.steps}: loss {progress.loss:.3f} (heat {progress.heat:.3f}, "
            f"boxes {progress.box:.3f}, classes {progress.named:.3f}), {progress.seconds:.0f} s"
        )

    fitted = fit(draws, NetworkSize(), config, checkpoint, tell)
    if fitted is None:
        return None
    network = fitted.network
    return FittedDetector(
        onnx=onnx_bytes(network),
        parameters=sum(weights.numel() for weights in network.parameters()),
        made_with=f"torch {torch.__version__}",
        processor_s=fitted.processor_s,
        plans=fitted.plans,
    )
