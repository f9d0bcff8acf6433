"""Scores hypotheses with the metric functions of av2."""

import json
import sys
from pathlib import Path

import numpy as np
from av2.datasets.motion_forecasting.eval import metrics

given = np.load(Path(sys.argv[1]))
found: dict[str, list[list[float]]] = {name: [] for name in ("ade", "fde", "missed", "brier_ade", "brier_fde")}
for paths, truth, probability in zip(given["paths"], given["truth"], given["probability"], strict=True):
    found["ade"].append(metrics.compute_ade(paths, truth).tolist())
    found["fde"].append(metrics.compute_fde(paths, truth).tolist())
    found["missed"].append(metrics.compute_is_missed_prediction(paths, truth).astype(float).tolist())
    found["brier_ade"].append(metrics.compute_brier_ade(paths, truth, probability, normalize=True).tolist())
    found["brier_fde"].append(metrics.compute_brier_fde(paths, truth, probability, normalize=True).tolist())
print(json.dumps(found))
