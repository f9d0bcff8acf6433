"""Labels of a picture: ``siren_msgs/CameraTruth``, and ``vision_msgs/Detection2DArray`` for standard tools."""

from typing import Any

import numpy as np

from siren_ros.interfaces.messages import as_arrays, as_sequences, header, make_message, time_ns_of
from siren_ros.interfaces.transforms import to_pose
from siren_ros.numerics.units import step_of_time_ns, time_ns_of_step
from siren_ros.world.actors import ActorClass
from siren_ros.world.carrier import CAMERA_TRUTH_DTYPES, CameraTruth


def to_camera_truth(truth: CameraTruth, frame_id: str) -> Any:
    """``siren_msgs/CameraTruth`` in the camera's optical frame."""
    return make_message(
        "siren_msgs/msg/CameraTruth",
        header=header(time_ns_of_step(truth.step), frame_id),
        step=truth.step,
        **as_sequences(truth, list(CAMERA_TRUTH_DTYPES)),
    )


def from_camera_truth(message: Any) -> CameraTruth:
    """Inverse of ``to_camera_truth``."""
    step = step_of_time_ns(time_ns_of(message.header.stamp))
    return CameraTruth(step=step, **as_arrays(message, CAMERA_TRUTH_DTYPES))


def to_image_boxes(truth: CameraTruth, frame_id: str) -> Any:
    """``vision_msgs/Detection2DArray`` of the visible vehicles.

    A detection's ``id`` is the actor's id, its score the visible fraction.
    """
    stamped = header(time_ns_of_step(truth.step), frame_id)
    nowhere = make_message(
        "geometry_msgs/msg/PoseWithCovariance",
        pose=to_pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
        covariance=np.zeros(36),
    )
    return make_message(
        "vision_msgs/msg/Detection2DArray",
        header=stamped,
        detections=[_detection(truth, int(row), stamped, nowhere) for row in np.flatnonzero(truth.visible_px)],
    )


def _detection(truth: CameraTruth, row: int, stamped: Any, nowhere: Any) -> Any:
    u, v = (
        float(truth.u_min_px[row] + truth.u_max_px[row]) / 2.0,
        float(truth.v_min_px[row] + truth.v_max_px[row]) / 2.0,
    )
    hypothesis = make_message(
        "vision_msgs/msg/ObjectHypothesis",
        class_id=ActorClass(int(truth.actor_class[row])).name.lower(),
        score=float(truth.visible_fraction[row]),
    )
    position = make_message("vision_msgs/msg/Point2D", x=u, y=v)
    return make_message(
        "vision_msgs/msg/Detection2D",
        header=stamped,
        results=[make_message("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=hypothesis, pose=nowhere)],
        bbox=make_message(
            "vision_msgs/msg/BoundingBox2D",
            center=make_message("vision_msgs/msg/Pose2D", position=position, theta=0.0),
            size_x=float(truth.u_max_px[row] - truth.u_min_px[row]),
            size_y=float(truth.v_max_px[row] - truth.v_min_px[row]),
        ),
        id=str(int(truth.actor_id[row])),
    )
