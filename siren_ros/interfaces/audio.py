"""Sound: ``siren_msgs/AudioChunk``."""

from typing import Any

import numpy as np
import numpy.typing as npt

from siren_ros.interfaces.messages import header, make_message, sequence
from siren_ros.numerics.units import time_ns_of_step


def to_audio(step: int, frame_id: str, sample_rate_hz: int, samples: npt.NDArray[np.int16]) -> Any:
    """``siren_msgs/AudioChunk`` of mono 16-bit PCM that ends at the step."""
    return make_message(
        "siren_msgs/msg/AudioChunk",
        header=header(time_ns_of_step(step), frame_id),
        sample_rate_hz=sample_rate_hz,
        samples=sequence(samples),
    )


def from_audio(message: Any) -> tuple[int, npt.NDArray[np.int16]]:
    """Sample rate in Hz and samples of an ``AudioChunk``."""
    return int(message.sample_rate_hz), np.array(message.samples, dtype=np.int16)
