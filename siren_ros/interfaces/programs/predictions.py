"""Predicted paths as messages of the topic ``/predictions``."""

from typing import Any

import numpy as np

from siren_ros.errors import EpisodeError
from siren_ros.interfaces.message_content import checks_content
from siren_ros.interfaces.messages import as_arrays, check_stamp, make_message, sequence, stamp
from siren_ros.numerics.units import time_ns_of_step
from siren_ros.world.carrier import PredictedPaths


def to_predicted_paths(paths: PredictedPaths) -> Any:
    """``siren_msgs/PredictedPaths``."""
    return make_message(
        "siren_msgs/msg/PredictedPaths",
        stamp=stamp(time_ns_of_step(paths.step)),
        step=paths.step,
        actor_id=sequence(paths.actor_id.astype(np.uint32)),
        probability=sequence(paths.probability.astype(np.float64)),
        x_m=sequence(paths.xy_m[..., 0].ravel()),
        y_m=sequence(paths.xy_m[..., 1].ravel()),
    )


@checks_content
def from_predicted_paths(message: Any) -> PredictedPaths:
    """Inverse of ``to_predicted_paths``; without paths their length is 0.

    Raises:
        EpisodeError: Arrays of lengths that do not fit, or a stamp that is not the time of the step; another program
            may have made the message.
    """
    step = int(message.step)
    check_stamp(message.stamp, step)
    arrays = as_arrays(
        message, {"actor_id": np.uint32, "probability": np.float64, "x_m": np.float64, "y_m": np.float64}
    )
    count, numbers = len(arrays["actor_id"]), len(arrays["x_m"])
    fits = len(arrays["probability"]) == count and len(arrays["y_m"]) == numbers
    if not fits or (numbers % count if count else numbers):
        lengths = ", ".join(f"{len(values)} {name}" for name, values in arrays.items())
        raise EpisodeError(f"paths of step {step} with {lengths}")
    xy_m = np.stack((arrays["x_m"], arrays["y_m"]), axis=-1).reshape(count, numbers // count if count else 0, 2)
    return PredictedPaths(step, arrays["actor_id"], arrays["probability"], xy_m)
