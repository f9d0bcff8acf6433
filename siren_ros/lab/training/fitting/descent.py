"""Common parts of the fittings: gradient descent with a one-cycle rate, running mean of the weights, ONNX export."""

import io
import warnings
from collections.abc import Callable, Sequence
from typing import Any, Final

import onnx
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from siren_ros.lab.training.settings import FitSettings, FittedNetwork

_OPSET: Final = 17


class Descent:
    """AdamW with torch's one-cycle rate (Smith and Topin 2019) and gradients of limited norm."""

    def __init__(
        self,
        network: nn.Module,
        config: FitSettings,
        steps: int,
        *,
        rising: float,
        gradient_max: float,
        averaging: float | None = None,
        betas: tuple[float, float] = (0.9, 0.999),
    ) -> None:
        """Start with the network's weights, on its device.

        The rate rises in the share ``rising`` of all steps. ``averaging`` is the share of the old weights in their
        running mean; None keeps no mean. ``betas`` are AdamW's.
        """
        self.network = network
        self._gradient_max = gradient_max
        self._average: AveragedModel | None = None
        if averaging is not None:
            self._average = AveragedModel(network, multi_avg_fn=_mean(averaging), use_buffers=True)
        self._optimizer = torch.optim.AdamW(
            network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, betas=betas
        )
        self._schedule = torch.optim.lr_scheduler.OneCycleLR(
            self._optimizer, config.learning_rate, total_steps=steps, pct_start=rising
        )

    @property
    def rate(self) -> float:
        """Learning rate of the next step."""
        return float(self._optimizer.param_groups[0]["lr"])

    def step(self, loss: Tensor) -> None:
        """Make one step to reduce a loss of the network."""
        self._optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.network.parameters(), self._gradient_max)
        self._optimizer.step()
        self._schedule.step()
        if self._average is not None:
            self._average.update_parameters(self.network)

    def result(self) -> Any:
        """Final network, on the processor: the running mean if there is one."""
        kept = self.network if self._average is None else self._average.module
        return kept.cpu().eval()

    def state(self) -> dict[str, Any]:
        """State from which a later run can continue."""
        average = {} if self._average is None else self._average.state_dict()
        return {"network": self.network.state_dict(), "average": average, "optimizer": self._optimizer.state_dict()}

    def go_on(self, state: dict[str, Any], done: int) -> None:
        """Continue after ``done`` steps from a ``state``, also of a descent with another number of steps."""
        self.network.load_state_dict(state["network"])
        self._optimizer.load_state_dict(state["optimizer"])
        if self._average is not None:
            self._average.load_state_dict(state["average"])
        self._schedule.last_epoch = done - 1
        with warnings.catch_warnings():
            # Torch warns that the schedule misses the steps of the earlier run.
            warnings.simplefilter("ignore", UserWarning)
            self._schedule.step()


def _mean(kept: float) -> Callable[..., None]:
    """Function for a running mean that forgets the first weights quickly."""

    def update(means: Sequence[Tensor], values: Sequence[Tensor], count: Tensor | int) -> None:
        share = 1.0 - min(kept, (1.0 + float(count)) / (10.0 + float(count)))
        for mean, value in zip(means, values, strict=True):  # the weights are already detached by AveragedModel
            if mean.is_floating_point():
                mean.lerp_(value, share)
            else:
                mean.copy_(value)

    return update


def exported(
    network: nn.Module,
    answer: nn.Module,
    example: tuple[Tensor, ...],
    inputs: Sequence[str],
    outputs: Sequence[str],
    free: dict[str, str],
    **figures: Any,
) -> FittedNetwork:
    """Export a fitted network.

    Args:
        network: What was fitted.
        answer: The network with what turns its outputs into those of the file.
        example: Inputs of any values.
        inputs: Names of the inputs.
        outputs: Names of the outputs.
        free: Names of inputs and outputs whose first dimension has any size, with a name for that dimension.
        figures: Further fields of the result.
    """
    buffer, axes = io.BytesIO(), {name: {0: size} for name, size in free.items()}
    with warnings.catch_warnings():
        # torch announces the end of the tracing exporter; its successor needs three more packages.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            answer.cpu().eval(),
            example,
            buffer,
            dynamo=False,
            opset_version=_OPSET,
            input_names=list(inputs),
            output_names=list(outputs),
            dynamic_axes=axes,
        )
    onnx.checker.check_model(onnx.load_from_string(buffer.getvalue()))
    parameters = sum(weights.numel() for weights in network.parameters())
    return FittedNetwork(buffer.getvalue(), parameters, f"torch {torch.__version__}", **figures)
