"""Scores hypotheses with the metric functions of av2."""

import json
import sys
from pathlib import Path

import numpy as np
from av2.datasets.motion_forecasting.eval import metrics

given = np.load(Path(sys.argv[1]))
scores: dict[str, list[list[float]]] = {name: [] for name in ("ade", "fde", "missed", "brier_ade", "brier_fde")}
for paths, truth, probability in zip(given["paths"], given["truth"], given["probability"], strict=True):
    scores["ade"].append(metrics.compute_ade(paths, truth).tolist())
    scores["fde"].append(metrics.compute_fde(paths, truth).tolist())
    scores["missed"].append(metrics.compute_is_missed_prediction(paths, truth).astype(float).tolist())
    scores["brier_ade"].append(metrics.compute_brier_ade(paths, truth, probability, normalize=True).tolist())
    scores["brier_fde"].append(metrics.compute_brier_fde(paths, truth, probability, normalize=True).tolist())
print(json.dumps(scores))
