"""Messages of programs that take part: the control of the AV's controller with its route, and predicted paths."""

from typing import Any

import numpy as np

from siren_ros.errors import EpisodeError
from siren_ros.interfaces.messages import (
    as_arrays,
    check_stamp,
    checks_content,
    from_plain_fields,
    header,
    make_message,
    plain_fields,
    sequence,
    stamp,
)
from siren_ros.interfaces.transforms import quaternion_of_yaw, to_pose
from siren_ros.numerics.geometry import Polyline
from siren_ros.numerics.units import time_ns_of_step
from siren_ros.world.carrier import MAP_FRAME, PredictedPaths
from siren_ros.world.commands import AvControl


def to_av_control(control: AvControl) -> Any:
    """``siren_msgs/AvControl``."""
    at = stamp(time_ns_of_step(control.step))
    return make_message("siren_msgs/msg/AvControl", stamp=at, **plain_fields(control))


@checks_content
def from_av_control(message: Any) -> AvControl:
    """Inverse of ``to_av_control``.

    Raises:
        EpisodeError: The stamp is not the time of the step; another program may have made the message.
    """
    control = from_plain_fields(AvControl, message)
    check_stamp(message.stamp, control.step)
    return control


def to_path(way: Polyline) -> Any:
    """``nav_msgs/Path`` of a route that is known before the first step; each pose points along it."""
    at_start = header(0, MAP_FRAME)
    headings = way.heading_rad(way.arc_m)
    return make_message(
        "nav_msgs/msg/Path",
        header=at_start,
        poses=[
            make_message(
                "geometry_msgs/msg/PoseStamped",
                header=at_start,
                pose=to_pose((x_m, y_m, 0.0), quaternion_of_yaw(float(heading))),
            )
            for (x_m, y_m), heading in zip(way.points.tolist(), headings, strict=True)
        ],
    )


def from_path(message: Any) -> Polyline:
    """Inverse of ``to_path``."""
    return Polyline.through([(pose.pose.position.x, pose.pose.position.y) for pose in message.poses])


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
