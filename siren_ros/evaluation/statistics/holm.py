"""Several tests at once."""

from collections.abc import Sequence

import numpy as np


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values that hold for all tests together (S. Holm, Scand. J. Statist. 6 (1979) 65), in the given order."""
    count = len(p_values)
    order = np.argsort(p_values, kind="stable")
    stepped = np.minimum(np.asarray(p_values, dtype=np.float64)[order] * np.arange(count, 0, -1), 1.0)
    adjusted = np.empty(count)
    adjusted[order] = np.maximum.accumulate(stepped) if count else stepped
    return [float(value) for value in adjusted]
