"""CSP, STDAN and BAT as predictors of the protocol."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import torch
from torch import Tensor

from siren_ros.datasets.ngsim.conventions import FOOT_M
from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.protocol.predictor import PredictorOptions
from siren_ros.evaluation.prediction.protocol.samples import SampleBatch
from siren_ros.evaluation.prediction.protocol.window import FUTURE_POINTS, HistoryWindow
from siren_ros.evaluation.prediction.published.bat import Bat, BatInput
from siren_ros.evaluation.prediction.published.behaviour import behaviour_tensor
from siren_ros.evaluation.prediction.published.checkpoints import load_weights
from siren_ros.evaluation.prediction.published.csp import Csp, CspInput
from siren_ros.evaluation.prediction.published.features import (
    bat_features,
    csp_features,
    from_polar,
    polar,
    positions_ft,
    stdan_features,
)
from siren_ros.evaluation.prediction.published.manoeuvres import mode_probabilities
from siren_ros.evaluation.prediction.published.ngsim_view import NgsimView, ngsim_view
from siren_ros.evaluation.prediction.published.social_grid import Neighbours
from siren_ros.evaluation.prediction.published.stdan import Stdan, StdanInput
from siren_ros.numerics.arrays import Floats

_PART: Final = 1024
"""Samples that a network handles at once."""
Answer = tuple[Floats, Floats]
"""Feet to the right and ahead by sample, mode and point, ``(B, k, 25, 2)``, and the modes' probabilities ``(B, k)``."""


@dataclass(frozen=True)
class PublishedPredictor:
    """A network of others behind the protocol: views of batches in, hypotheses on the map out."""

    answer: Callable[[NgsimView], Answer]
    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """One hypothesis for each mode."""
        answers = [self._part(part) for part in ngsim_view(batch).parts(_PART)]
        if not answers:
            return Hypotheses.certain(np.zeros((0, FUTURE_POINTS, 2)))
        return Hypotheses.ranked(*(np.concatenate(arrays) for arrays in zip(*answers, strict=True)))

    def _part(self, view: NgsimView) -> Answer:
        with torch.inference_mode():
            right_ahead_ft, probability = self.answer(view)
        return view.on_map(right_ahead_ft * FOOT_M), probability


def make_csp(options: PredictorOptions) -> PublishedPredictor:
    """CSP with six modes."""
    network = Csp()
    _load(network, "csp", options)

    def answer(view: NgsimView) -> Answer:
        features = csp_features(view)
        given = CspInput(torch.from_numpy(features.own), torch.from_numpy(features.neighbours), _neighbours(view))
        modes, lateral, longitudinal = network(given)
        return _by_sample(modes), _doubles(mode_probabilities(lateral, longitudinal))

    return PublishedPredictor(answer)


def make_stdan(options: PredictorOptions) -> PublishedPredictor:
    """STDAN, whose own manoeuvres choose the one hypothesis."""
    network = Stdan()
    _load(network, "stdan", options)

    def answer(view: NgsimView) -> Answer:
        features = stdan_features(view)
        given = StdanInput(torch.from_numpy(features.own), torch.from_numpy(features.neighbours), _neighbours(view))
        path, _, _ = network(given)
        return _by_sample(path[None]), np.ones((len(view), 1))

    return PublishedPredictor(answer)


def make_bat(options: PredictorOptions) -> PublishedPredictor:
    """BAT with nine modes; the vehicles of one frame are a scene."""
    network = Bat()
    _load(network, "bat", options)

    def answer(view: NgsimView) -> Answer:
        features = bat_features(view)
        own, others = (polar(positions) for positions in positions_ft(view))
        given = BatInput(
            torch.from_numpy(features.own),
            torch.from_numpy(features.neighbours),
            torch.from_numpy(behaviour_tensor(own, others, view.sample, view.cell)),
            _neighbours(view),
            torch.from_numpy(view.scene),
        )
        modes, lateral, longitudinal = network(given)
        return from_polar(_by_sample(modes)), _doubles(mode_probabilities(lateral, longitudinal))

    return PublishedPredictor(answer)


def _load(network: torch.nn.Module, model: str, options: PredictorOptions) -> None:
    if options.checkpoint is None:
        raise InputError("checkpoint", model, f"{model}=PATH of its weights")
    load_weights(network, model, options.checkpoint)


def _neighbours(view: NgsimView) -> Neighbours:
    return Neighbours(torch.from_numpy(view.sample), torch.from_numpy(view.cell), len(view))


def _by_sample(modes: Tensor) -> Floats:
    """Means of ``(k, 25, B, 5)`` as ``(B, k, 25, 2)``."""
    return _doubles(modes[..., :2].permute(2, 0, 1, 3))


def _doubles(values: Tensor) -> Floats:
    return values.double().numpy()
