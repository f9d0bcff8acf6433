"""The past that a trajectory predictor gets and the times that it predicts (paper, "Trajectory prediction")."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.datasets.sources.sampling import LOG_PERIOD_STEPS
from siren_ros.numerics.units import STEP_S

FRAME_PERIOD_S: Final = LOG_PERIOD_STEPS * STEP_S
"""States are logged at 10 Hz; a *frame* is one logged step, and windows start at every frame."""
FUTURE_POINTS: Final = 25
FUTURE_STRIDE_FRAMES: Final = 2
"""The common grid of all methods: 5 s of future, a point every 0.2 s."""

LAST_FUTURE_STEP: Final = FUTURE_POINTS * FUTURE_STRIDE_FRAMES * LOG_PERIOD_STEPS
"""Steps from the present to the horizon."""

FrameOffsets = npt.NDArray[np.int64]


@dataclass(frozen=True)
class HistoryWindow:
    """The past that a predictor observes, the present included; counted in frames of 0.1 s.

    The default is 3 s at 0.2 s (NGSIM's convention), which CSP, STDAN, BAT and the references CV and IDM use.
    """

    points: int = 16
    stride_frames: int = 2
    future_frames: int = FUTURE_POINTS * FUTURE_STRIDE_FRAMES
    """Frames after the present that must be logged: a sample whose truth ends earlier is none."""

    @property
    def offsets(self) -> FrameOffsets:
        """Frames of the points relative to the present, shape ``(points,)``, the last one 0."""
        return np.arange(1 - self.points, 1, dtype=np.int64) * self.stride_frames

    @property
    def times_s(self) -> npt.NDArray[np.float64]:
        """Times of the points relative to the present, shape ``(points,)``."""
        return self.offsets * FRAME_PERIOD_S


ARGOVERSE_WINDOW: Final = HistoryWindow(points=50, stride_frames=1, future_frames=60)
"""Argoverse 2's scenarios of 11 s: what predictors trained on it observe (5 s at 0.1 s) and predict (6 s)."""
WINDOWS: Final = {"ngsim": HistoryWindow(), "argoverse2": ARGOVERSE_WINDOW}
"""By name."""


def future_offsets() -> FrameOffsets:
    """Frames of the scored points relative to the present, shape ``(FUTURE_POINTS,)``."""
    return np.arange(1, FUTURE_POINTS + 1, dtype=np.int64) * FUTURE_STRIDE_FRAMES


def future_times_s() -> npt.NDArray[np.float64]:
    """Times of the scored points relative to the present, shape ``(FUTURE_POINTS,)``: 0.2 s … 5 s."""
    return future_offsets() * FRAME_PERIOD_S
