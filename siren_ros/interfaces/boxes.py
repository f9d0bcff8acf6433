"""Labels in space: ``siren_msgs/GroundTruth``, and ``vision_msgs/Detection3DArray`` for standard tools."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from siren_ros.interfaces.message_content import checks_content
from siren_ros.interfaces.messages import as_arrays, as_sequences, header, make_message, time_ns_of
from siren_ros.interfaces.transforms import from_quaternion, quaternion_of_yaw, to_pose, to_vector, yaw_of_quaternion
from siren_ros.numerics.arrays import Floats, Ids
from siren_ros.numerics.units import step_of_time_ns, time_ns_of_step
from siren_ros.world.actors import ActorClass
from siren_ros.world.carrier import GROUND_TRUTH_DTYPES, GroundTruth


def to_ground_truth(truth: GroundTruth) -> Any:
    """``siren_msgs/GroundTruth``."""
    return make_message(
        "siren_msgs/msg/GroundTruth",
        header=header(time_ns_of_step(truth.step), truth.frame_id),
        step=truth.step,
        carrier_id=truth.carrier_id,
        **as_sequences(truth, list(GROUND_TRUTH_DTYPES)),
    )


@checks_content
def from_ground_truth(message: Any) -> GroundTruth:
    """Inverse of ``to_ground_truth``."""
    return GroundTruth(
        step=int(message.step),
        carrier_id=int(message.carrier_id),
        frame_id=str(message.header.frame_id),
        **as_arrays(message, GROUND_TRUTH_DTYPES),
    )


@dataclass(frozen=True)
class LabelledBoxes:
    """Boxes of one step in a sensor frame; volume centres, one row per actor."""

    step: int
    frame_id: str
    actor_id: Ids
    class_names: tuple[str, ...]
    """Lower-case names of ``ActorClass``."""
    x_m: Floats
    y_m: Floats
    z_m: Floats
    yaw_rad: Floats
    length_m: Floats
    width_m: Floats
    height_m: Floats


def boxes_of(truth: GroundTruth, frame_id: str) -> LabelledBoxes:
    """The boxes of a step's ground truth."""
    return LabelledBoxes(
        step=truth.step,
        frame_id=frame_id,
        actor_id=truth.actor_id,
        class_names=tuple(ActorClass(int(code)).name.lower() for code in truth.actor_class),
        x_m=truth.x_m,
        y_m=truth.y_m,
        z_m=truth.z_m,
        yaw_rad=truth.yaw_rad,
        length_m=truth.length_m,
        width_m=truth.width_m,
        height_m=truth.height_m,
    )


def to_boxes(boxes: LabelledBoxes) -> Any:
    """``vision_msgs/Detection3DArray``; a detection's ``id`` is the actor's id, its score 1."""
    shared = {"header": header(time_ns_of_step(boxes.step), boxes.frame_id)}
    unknown = np.zeros(36)
    return make_message(
        "vision_msgs/msg/Detection3DArray",
        detections=[_to_detection(boxes, row, unknown, shared) for row in range(len(boxes.actor_id))],
        **shared,
    )


def _to_detection(boxes: LabelledBoxes, row: int, covariance: Floats, shared: dict[str, Any]) -> Any:
    centre = (boxes.x_m[row], boxes.y_m[row], boxes.z_m[row])
    pose = to_pose(centre, quaternion_of_yaw(float(boxes.yaw_rad[row])))
    hypothesis = make_message("vision_msgs/msg/ObjectHypothesis", class_id=boxes.class_names[row], score=1.0)
    with_covariance = make_message("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance)
    size = to_vector((boxes.length_m[row], boxes.width_m[row], boxes.height_m[row]))
    return make_message(
        "vision_msgs/msg/Detection3D",
        results=[make_message("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=hypothesis, pose=with_covariance)],
        bbox=make_message("vision_msgs/msg/BoundingBox3D", center=pose, size=size),
        id=str(int(boxes.actor_id[row])),
        **shared,
    )


def from_boxes(message: Any) -> LabelledBoxes:
    """Inverse of ``to_boxes``."""
    found = message.detections
    centres = [detection.bbox.center for detection in found]
    sizes = [detection.bbox.size for detection in found]
    return LabelledBoxes(
        step=step_of_time_ns(time_ns_of(message.header.stamp)),
        frame_id=str(message.header.frame_id),
        actor_id=np.array([int(detection.id) for detection in found], dtype=np.uint32),
        class_names=tuple(str(detection.results[0].hypothesis.class_id) for detection in found),
        x_m=np.array([centre.position.x for centre in centres]),
        y_m=np.array([centre.position.y for centre in centres]),
        z_m=np.array([centre.position.z for centre in centres]),
        yaw_rad=np.array([yaw_of_quaternion(from_quaternion(centre.orientation)) for centre in centres]),
        length_m=np.array([size.x for size in sizes]),
        width_m=np.array([size.y for size in sizes]),
        height_m=np.array([size.z for size in sizes]),
    )
