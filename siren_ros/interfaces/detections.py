"""What a detector found: ``vision_msgs/Detection3DArray`` with confidences."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from siren_ros.interfaces.messages import header, make_message, time_ns_of
from siren_ros.interfaces.transforms import from_quaternion, quaternion_of_yaw, to_pose, to_vector, yaw_of_quaternion
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import step_of_time_ns, time_ns_of_step


@dataclass(frozen=True)
class DetectedBoxes:
    """Boxes of one step in a sensor frame, one row per detection."""

    step: int
    frame_id: str
    class_names: tuple[str, ...]
    score: Floats
    """Confidence, 0 to 1."""
    centre_m: Floats
    """Centre of the volume, shape ``(N, 3)``."""
    size_m: Floats
    """Length, width, height, shape ``(N, 3)``."""
    yaw_rad: Floats


def to_detections(boxes: DetectedBoxes) -> Any:
    """``vision_msgs/Detection3DArray``; it has no place for velocities."""
    shared = {"header": header(time_ns_of_step(boxes.step), boxes.frame_id)}
    return make_message(
        "vision_msgs/msg/Detection3DArray",
        detections=[_to_detection(boxes, row, shared) for row in range(len(boxes.score))],
        **shared,
    )


def _to_detection(boxes: DetectedBoxes, row: int, shared: dict[str, Any]) -> Any:
    pose = to_pose(boxes.centre_m[row], quaternion_of_yaw(float(boxes.yaw_rad[row])))
    name, score = boxes.class_names[row], float(boxes.score[row])
    result = make_message(
        "vision_msgs/msg/ObjectHypothesisWithPose",
        hypothesis=make_message("vision_msgs/msg/ObjectHypothesis", class_id=name, score=score),
        pose=make_message("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
    )
    box = make_message("vision_msgs/msg/BoundingBox3D", center=pose, size=to_vector(boxes.size_m[row].tolist()))
    return make_message("vision_msgs/msg/Detection3D", results=[result], bbox=box, id="", **shared)


def from_detections(message: Any) -> DetectedBoxes:
    """Inverse of ``to_detections``."""
    found = message.detections
    centres = [detection.bbox.center for detection in found]
    sizes = [detection.bbox.size for detection in found]
    best = [detection.results[0].hypothesis for detection in found]
    return DetectedBoxes(
        step=step_of_time_ns(time_ns_of(message.header.stamp)),
        frame_id=str(message.header.frame_id),
        class_names=tuple(str(one.class_id) for one in best),
        score=np.array([float(one.score) for one in best]),
        centre_m=np.array([(one.position.x, one.position.y, one.position.z) for one in centres]).reshape(-1, 3),
        size_m=np.array([(size.x, size.y, size.z) for size in sizes]).reshape(-1, 3),
        yaw_rad=np.array([yaw_of_quaternion(from_quaternion(one.orientation)) for one in centres]),
    )
