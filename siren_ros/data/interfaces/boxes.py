"""Vehicles as boxes in messages: labels, detections, and markers for viewers.

Labels are ``siren_msgs/GroundTruth`` and ``siren_msgs/CameraTruth``; for standard tools they are also
``vision_msgs/Detection3DArray`` and ``vision_msgs/Detection2DArray``. A detector's boxes are a
``vision_msgs/Detection3DArray`` with confidences. ``visualization_msgs/MarkerArray`` shows the vehicles in RViz and
Foxglove while an episode runs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import NS_PER_S
from siren_ros.data.interfaces.measurements import (
    Vector,
    quaternion_of_yaw,
    to_pose,
)
from siren_ros.data.interfaces.messages import as_arrays, as_sequences, checks_content, header, make_message, step_of
from siren_ros.data.interfaces.wire import COUNT, STAMPED, CdrWriter, Layout, stamped, text, text_once
from siren_ros.simulation.world.actors import ActorClass, ActorDescription, ActorStates, Mode
from siren_ros.simulation.world.carrier import (
    CAMERA_TRUTH_DTYPES,
    GROUND_TRUTH_DTYPES,
    MAP_FRAME,
    CameraTruth,
    GroundTruth,
)


def to_ground_truth(truth: GroundTruth) -> Any:
    """Makes the message ``siren_msgs/GroundTruth``."""
    return make_message(
        "siren_msgs/msg/GroundTruth",
        header=header(truth.step, truth.frame_id),
        step=truth.step,
        carrier_id=truth.carrier_id,
        **as_sequences(truth, GROUND_TRUTH_DTYPES),
    )


@checks_content
def from_ground_truth(message: Any) -> GroundTruth:
    """Reads the message that ``to_ground_truth`` makes."""
    return GroundTruth(
        step=int(message.step),
        carrier_id=int(message.carrier_id),
        frame_id=str(message.header.frame_id),
        **as_arrays(message, GROUND_TRUTH_DTYPES),
    )


@dataclass(frozen=True)
class SpaceBoxes:
    """Boxes of one step in a sensor frame, labels or detections; one row per box."""

    step: int
    frame_id: str
    class_names: tuple[str, ...]
    """Lower-case names of ``ActorClass`` for labels."""
    score: Floats
    """Confidence of each box, 0 to 1."""
    centre_m: Floats
    """Centre of the volume, shape ``(N, 3)``."""
    size_m: Floats
    """Length, width, height, shape ``(N, 3)``."""
    yaw_rad: Floats
    ids: tuple[str, ...] | None = None
    """Actor ids of labels; None for detections."""


def boxes_of(truth: GroundTruth, frame_id: str) -> SpaceBoxes:
    """The boxes of a step's ground truth, with score 1."""
    return SpaceBoxes(
        step=truth.step,
        frame_id=frame_id,
        class_names=tuple(ActorClass(int(code)).name.lower() for code in truth.actor_class),
        score=np.ones(len(truth)),
        centre_m=np.stack((truth.x_m, truth.y_m, truth.z_m), axis=1),
        size_m=np.stack((truth.length_m, truth.width_m, truth.height_m), axis=1),
        yaw_rad=truth.yaw_rad,
        ids=tuple(str(int(actor_id)) for actor_id in truth.actor_id),
    )


_ARRAY: Final = Layout(f"{STAMPED} I")
_BOX: Final = Layout(f"{STAMPED} I s d 7d 36d 7d 3d s")
_CERTAIN: Final = (0.0,) * 36
"""Covariance of a pose without uncertainty."""


def to_boxes(boxes: SpaceBoxes) -> bytes:
    """Boxes as ``vision_msgs/Detection3DArray`` in CDR. The type has no field for velocities."""
    writer = CdrWriter()
    head = stamped(boxes.step, boxes.frame_id)
    ids = boxes.ids or ("",) * len(boxes.score)
    writer.put(_ARRAY, *head, len(boxes.score))
    numbers = zip(
        *(boxes.score.tolist(), boxes.centre_m.tolist(), boxes.size_m.tolist(), boxes.yaw_rad.tolist()), strict=True
    )
    for name, box_id, (score, centre, size, yaw_rad) in zip(boxes.class_names, ids, numbers, strict=True):
        pose = (*centre, *quaternion_of_yaw(yaw_rad))
        writer.put(_BOX, *head, 1, text(name), score, *pose, *_CERTAIN, *pose, *size, text(box_id))
    return writer.cdr()


def to_camera_truth(truth: CameraTruth, frame_id: str) -> Any:
    """Makes the message ``siren_msgs/CameraTruth`` in the camera's optical frame."""
    return make_message(
        "siren_msgs/msg/CameraTruth",
        header=header(truth.step, frame_id),
        step=truth.step,
        **as_sequences(truth, CAMERA_TRUTH_DTYPES),
    )


def from_camera_truth(message: Any) -> CameraTruth:
    """Reads the message that ``to_camera_truth`` makes."""
    step = step_of(message)
    return CameraTruth(step=step, **as_arrays(message, CAMERA_TRUTH_DTYPES))


def to_image_boxes(truth: CameraTruth, frame_id: str) -> Any:
    """Visible vehicles as ``vision_msgs/Detection2DArray``: the id is the actor's, the score its visible fraction."""
    stamped = header(truth.step, frame_id)
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


Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity, 0–1 each."""

EMV_COLOUR: Final[Colour] = (0.85, 0.10, 0.12, 1.0)
MODE_COLOURS: Final[dict[Mode, Colour]] = {
    Mode.YIELD_REACTING: (0.99, 0.85, 0.30, 1.0),
    Mode.YIELD_DEFERRED: (0.95, 0.60, 0.10, 1.0),
    Mode.YIELD_LANE_CHANGE: (0.10, 0.60, 0.85, 1.0),
    Mode.YIELD_KEEP_LANE: (0.15, 0.70, 0.55, 1.0),
    Mode.YIELD_PULL_OVER: (0.45, 0.35, 0.80, 1.0),
    Mode.YIELD_HOLD: (0.30, 0.20, 0.55, 1.0),
    Mode.REJOIN: (0.55, 0.75, 0.45, 1.0),
    Mode.STOPPED: (0.83, 0.0, 0.0, 1.0),
}
"""Colours of civilians that yield or have been in contact; all other vehicles have their paint."""
LIFETIME_NS: Final = 400_000_000
"""Lifetime of a marker: two periods of the topic. Markers of actors that have left disappear by themselves."""
_TEXT_HEIGHT_M: Final = 1.4
_TEXT_ABOVE_ROOF_M: Final = 1.2


class MarkerShape(IntEnum):
    """The ``type`` constants of ``visualization_msgs/Marker`` in use."""

    CUBE = 1
    TEXT = 9


@dataclass(frozen=True)
class Marker:
    """One shape in the ``map`` frame."""

    namespace: str
    marker_id: int
    shape: MarkerShape
    centre_m: Vector
    yaw_rad: float
    size_m: Vector
    colour: Colour
    text: str = ""


def vehicle_markers(states: ActorStates, actors: Mapping[int, ActorDescription]) -> tuple[Marker, ...]:
    """A coloured box per actor, and above each EMV its mode and speed."""
    markers = []
    rows = zip(
        states.actor_id.tolist(),
        states.x_m.tolist(),
        states.y_m.tolist(),
        states.z_m.tolist(),
        states.yaw_rad.tolist(),
        states.mode.tolist(),
        states.speed_mps.tolist(),
        strict=True,
    )
    for actor_id, x_m, y_m, z_m, yaw_rad, mode_code, speed_mps in rows:
        actor, mode = actors[actor_id], Mode(mode_code)
        size = (actor.length_m, actor.width_m, actor.height_m)
        centre = (x_m, y_m, z_m + actor.height_m / 2.0)
        colour = _colour_of(actor, mode)
        markers.append(Marker("vehicles", actor_id, MarkerShape.CUBE, centre, yaw_rad, size, colour))
        if actor.is_emv:
            above = (x_m, y_m, z_m + actor.height_m + _TEXT_ABOVE_ROOF_M)
            text = f"{mode.name.lower().replace('_', ' ')}  {speed_mps * 3.6:.0f} km/h"
            text_size = (0.0, 0.0, _TEXT_HEIGHT_M)
            markers.append(Marker("emv", actor_id, MarkerShape.TEXT, above, 0.0, text_size, (1.0, 1.0, 1.0, 1.0), text))
    return tuple(markers)


def _colour_of(actor: ActorDescription, mode: Mode) -> Colour:
    if actor.is_emv:
        return EMV_COLOUR
    red, green, blue = actor.colour_rgb
    return MODE_COLOURS.get(mode, (red / 255.0, green / 255.0, blue / 255.0, 0.85))


_MARKER: Final = Layout(f"{STAMPED} s i i i 7d 3d 4f i I ? I I s i I s s I I s s s I ?")
"""Fields of a marker. The zero counts at its end mean: no points, no colours, no texture, no mesh."""


def to_markers(step: int, markers: Sequence[Marker]) -> bytes:
    """Makes the message ``visualization_msgs/MarkerArray`` of one step, as CDR."""
    writer = CdrWriter()
    writer.put(COUNT, len(markers))
    head, nothing = stamped(step, MAP_FRAME), text("")
    lifetime = divmod(LIFETIME_NS, NS_PER_S)
    bare = (False, 0, 0, nothing, 0, 0, nothing, nothing, 0, 0)
    meshless = (nothing, nothing, 0, False)
    for marker in markers:
        writer.put(
            _MARKER,
            *head,
            text(marker.namespace),
            *(marker.marker_id, int(marker.shape), 0),
            *(*marker.centre_m, *quaternion_of_yaw(marker.yaw_rad), *marker.size_m),
            *(*marker.colour, *lifetime, *bare),
            text_once(marker.text),
            *meshless,
        )
    return writer.cdr()
