"""At what rate tracks are logged, and whose windows count."""

from typing import Final

from siren_ros.numerics.units import STEP_S

LOG_PERIOD_STEPS: Final = 2
"""10 Hz (paper: "actor states are logged at 10 Hz")."""
FRAME_S: Final = LOG_PERIOD_STEPS * STEP_S
"""A *frame* is one logged step."""
REGION: Final = "region"
"""Vehicles in the interaction region around the EMV for the whole window."""
POPULATIONS: Final = (REGION, "all")
"""As in the evaluation of predictors."""
