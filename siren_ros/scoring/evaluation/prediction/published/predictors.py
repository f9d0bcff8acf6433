"""Makes predictors of CSP, STDAN and BAT.

Published weights are loaded without running anything that is in the file, and are held against the network.
"""

import pickle
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor, nn

from siren_ros.base.numerics.arrays import Floats
from siren_ros.data.datasets.ngsim import FOOT_M
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.published.inputs import (
    Features,
    NgsimView,
    bat_features,
    behaviour_tensor,
    csp_features,
    from_polar,
    ngsim_view,
    polar,
    positions_ft,
    stdan_features,
)
from siren_ros.scoring.evaluation.prediction.published.layers import Neighbours, NetworkInput, mode_probabilities
from siren_ros.scoring.evaluation.prediction.published.networks import Bat, BatInput, Csp, Stdan
from siren_ros.scoring.evaluation.prediction.samples import FUTURE_POINTS, HistoryWindow, SampleBatch

_UNREADABLE: Final = (RuntimeError, ValueError, KeyError, IndexError, AttributeError, TypeError, EOFError, ImportError)
"""Errors that torch raises for damaged or foreign files."""
_RENAMED: Final = {"soc_conv_3x1.": "conv_3x1."}
"""Name of a layer of CSP in another published repository, and its name here."""


def load_weights(network: nn.Module, model: str, path: Path | None) -> nn.Module:
    """Load weights from a file into a network, and set it to prediction mode.

    The file holds a state dict, alone or under ``state_dict``, or one for each part of the network by the part's name.
    Where the authors published a file for each part (``epoch9_gd.tar`` and ``epoch9_g.tar``), the path is that of one
    and the others lie next to it.

    Raises:
        InputError: There is no file, or it cannot be read, holds code, or is not of this model; with counts and the
            first offender.
    """
    if path is None:
        raise InputError("checkpoint", model, f"{model}=PATH of its weights")
    given, expected = _with_parts(network, path), network.state_dict()
    missing = [name for name in expected if name not in given]
    unknown = [name for name in given if name not in expected]
    reshaped = [name for name in expected if name in given and given[name].shape != expected[name].shape]
    wrong = []
    if missing:
        wrong.append(f"{len(missing)} of {len(expected)} missing, first {missing[0]}")
    if reshaped:
        first = reshaped[0]
        shapes = f"{tuple(given[first].shape)} instead of {tuple(expected[first].shape)}"
        wrong.append(f"{len(reshaped)} of another shape, first {first}: {shapes}")
    if unknown:
        wrong.append(f"{len(unknown)} unknown, first {unknown[0]}")
    if wrong:
        raise InputError("checkpoint", str(path), f"weights of {model} ({'; '.join(wrong)})")
    infinite = [name for name in expected if not bool(torch.isfinite(given[name]).all())]
    if infinite:
        what = f"finite weights ({len(infinite)} of {len(expected)} are not, first {infinite[0]})"
        raise InputError("checkpoint", str(path), what)
    network.load_state_dict(given)
    network.eval()
    return network


def _with_parts(network: nn.Module, path: Path) -> dict[str, Tensor]:
    """All weights of all parts of the network, by name."""
    parts = [name for name, _ in network.named_children()]
    content = _read(path)
    of_path = next((part for part in parts if path.stem.endswith(f"_{part}")), None)
    if of_path is not None and not any(name in parts for name in content):
        prefix = path.stem.removesuffix(of_path)
        content = {part: _read(path.with_name(f"{prefix}{part}{path.suffix}")) for part in parts}
    return _flat(content, str(path))


def _read(path: Path) -> Mapping[str, Any]:
    try:
        with warnings.catch_warnings():
            # torch warns about some files; the checks below refuse what is wrong
            warnings.simplefilter("ignore")
            content = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise InputError("checkpoint", str(path), f"a file that can be read ({error.strerror or error})") from error
    except pickle.UnpicklingError as error:
        raise InputError("checkpoint", str(path), "weights alone; the file holds code or is none of torch's") from error
    except _UNREADABLE as error:
        raise InputError("checkpoint", str(path), f"weights that torch saved ({type(error).__name__})") from error
    if isinstance(content, Mapping) and "state_dict" in content:
        content = content["state_dict"]
    if not isinstance(content, Mapping):
        raise InputError("checkpoint", str(path), f"a state dict, not {type(content).__name__}")
    return content


def _flat(content: Mapping[str, Any], path: str, prefix: str = "") -> dict[str, Tensor]:
    weights: dict[str, Tensor] = {}
    for name, value in content.items():
        full = f"{prefix}{name}"
        if isinstance(value, Mapping):
            weights.update(_flat(value, path, f"{full}."))
        elif isinstance(value, Tensor):
            for old, new in _RENAMED.items():
                full = full.replace(old, new)
            weights[full] = value
        else:
            raise InputError("checkpoint", path, f"tensors alone; {full} is of type {type(value).__name__}")
    return weights


MOST_SAMPLES: Final = 1024
"""Number of samples that a network processes at once."""
Answer = tuple[Floats, Floats]
"""Answer of a network: feet to the right and ahead by sample, mode and point, ``(B, k, 25, 2)``, and probabilities of
the modes, ``(B, k)``."""


@dataclass(frozen=True)
class PublishedPredictor:
    """Wraps a published network as a predictor: views of batches go in, hypotheses on the map come out."""

    answer: Callable[[NgsimView], Answer]
    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """Give one hypothesis per mode."""
        answers = [self._part(part) for part in ngsim_view(batch).parts(MOST_SAMPLES)]
        if not answers:
            return Hypotheses.certain(np.zeros((0, FUTURE_POINTS, 2)))
        return Hypotheses.ranked(*(np.concatenate(arrays) for arrays in zip(*answers, strict=True)))

    def _part(self, view: NgsimView) -> Answer:
        with torch.inference_mode():
            right_ahead_ft, probability = self.answer(view)
        return view.on_map(right_ahead_ft * FOOT_M), probability


def make_csp(checkpoint: Path | None) -> PublishedPredictor:
    """CSP with six modes."""
    network = load_weights(Csp(), "csp", checkpoint)

    def answer(view: NgsimView) -> Answer:
        modes, lateral, longitudinal = network(NetworkInput(*_tensors(csp_features(view), view)))
        return _by_sample(modes), mode_probabilities(lateral, longitudinal).double().numpy()

    return PublishedPredictor(answer)


def make_stdan(checkpoint: Path | None) -> PublishedPredictor:
    """STDAN; its recognised manoeuvres give its single hypothesis."""
    network = load_weights(Stdan(), "stdan", checkpoint)

    def answer(view: NgsimView) -> Answer:
        path, _, _ = network(NetworkInput(*_tensors(stdan_features(view), view)))
        return _by_sample(path[None]), np.ones((len(view), 1))

    return PublishedPredictor(answer)


def make_bat(checkpoint: Path | None) -> PublishedPredictor:
    """BAT with nine modes; the vehicles of a frame form a scene."""
    network = load_weights(Bat(), "bat", checkpoint)

    def answer(view: NgsimView) -> Answer:
        targets, others = (polar(positions) for positions in positions_ft(view))
        behaviour = torch.from_numpy(behaviour_tensor(targets, others, view.sample, view.cell))
        given = BatInput(*_tensors(bat_features(view), view), behaviour, torch.from_numpy(view.scene))
        modes, lateral, longitudinal = network(given)
        return from_polar(_by_sample(modes)), mode_probabilities(lateral, longitudinal).double().numpy()

    return PublishedPredictor(answer)


def _tensors(features: Features, view: NgsimView) -> tuple[Tensor, Tensor, Neighbours]:
    """Convert features to the parts of ``NetworkInput``."""
    targets, neighbours = (torch.from_numpy(values) for values in features)
    return targets, neighbours, Neighbours(torch.from_numpy(view.sample), torch.from_numpy(view.cell), len(view))


def _by_sample(modes: Tensor) -> Floats:
    """Rearrange means ``(k, 25, B, 5)`` as ``(B, k, 25, 2)``."""
    return modes[..., :2].permute(2, 0, 1, 3).double().numpy()
