"""Converts observations to messages: the output of ``sensor_sim`` at a step."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.boxes import boxes_of, to_boxes, to_camera_truth, to_ground_truth, to_image_boxes
from siren_ros.data.interfaces.markers import to_markers, vehicle_markers
from siren_ros.data.interfaces.measurements import to_camera_info, to_compressed_image, to_image, to_point_cloud
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.interfaces.transforms import Transform, to_odometry, to_tf
from siren_ros.data.sensor_messages.sensor_topics import EMV, SENSOR_MESSAGES, Carrier, optical_frame
from siren_ros.sensing.camera.camera import CameraFrame
from siren_ros.sensing.rig import Observations
from siren_ros.sensing.specification import CameraSpec, SensorSpec
from siren_ros.sensing.suite import LabelKinds, SensorSuite
from siren_ros.simulation.world.actors import ActorDescription, ActorStates
from siren_ros.simulation.world.carrier import BASE_FRAME, ODOM_FRAME, CameraTruth, GroundTruth, Odometry

Published = tuple[Topic, Any]


def shared_messages(
    states: ActorStates, actors: Mapping[int, ActorDescription], transforms: Sequence[Transform]
) -> Iterator[Published]:
    """Messages of a step that all carriers share: the tree of their frames, and the markers."""
    yield topics.TF, to_tf(states.step, transforms)
    if states.step % topics.MARKERS.period_steps == 0:
        yield topics.MARKERS, to_markers(states.step, vehicle_markers(states, actors))


@dataclass(frozen=True)
class ObservationMessages:
    """Makes the messages of one carrier's suite."""

    suite: SensorSuite
    carrier_id: int
    wants_raw: Callable[[Topic], bool]
    """Whether a topic that is not recorded has a subscriber."""
    carrier: Carrier = EMV

    def of_step(self, states: ActorStates, seen: Observations) -> Iterator[Published]:
        """Messages that are due at the step, each with its topic."""
        step, frame = states.step, self.carrier.frame
        if seen.truth is not None:
            yield from self._labels(replace(seen.truth, frame_id=frame(seen.truth.frame_id)))
        for sweep in seen.sweeps:
            lidar = next(spec for spec in self.suite.lidars if spec.name == sweep.sensor)
            yield self._topic(topics.LIDAR, lidar), to_point_cloud(step, frame(sweep.sensor), sweep.points)
        for exposure in seen.frames:
            yield from self._images(exposure, seen.labels.get(exposure.sensor))
        for spec, measured in seen.others:
            entry = SENSOR_MESSAGES[type(spec)]
            message = entry.to_message(replace(measured, frame_id=frame(measured.frame_id)))
            yield self._topic(entry.topic, spec), message

    def odometry(self, step: int, odometry: Odometry) -> Published:
        """The odometry of the carrier."""
        frame = self.carrier.frame
        return self._topic(topics.ODOMETRY), to_odometry(step, odometry, frame(ODOM_FRAME), frame(BASE_FRAME))

    def _labels(self, truth: GroundTruth) -> Iterator[Published]:
        if truth.step % topics.GROUND_TRUTH.period_steps == 0:
            yield self._topic(topics.GROUND_TRUTH), to_ground_truth(truth)
        if truth.step % topics.BOXES.period_steps == 0:
            yield self._topic(topics.BOXES), to_boxes(boxes_of(truth, truth.frame_id))

    def label_kinds(self, camera: CameraSpec) -> LabelKinds:
        """Labels of a camera that the suite records or for which there is a subscriber."""
        recorded = LabelKinds.of(self.suite, camera)
        depth, instance = (self._topic(topic, camera) for topic in (topics.IMAGE_DEPTH, topics.IMAGE_INSTANCE))
        return LabelKinds(
            recorded.depth or self.wants_raw(depth), recorded.instance or self.wants_raw(instance), recorded.boxes
        )

    def _images(self, frame: CameraFrame, labels: CameraTruth | None) -> Iterator[Published]:
        spec = next(camera for camera in self.suite.cameras if camera.name == frame.sensor)
        step, frame_id, image = frame.step, self.carrier.frame(optical_frame(spec.name)), frame.image
        yield self._topic(topics.IMAGE_COMPRESSED, spec), to_compressed_image(step, frame_id, frame.jpeg)
        yield self._topic(topics.CAMERA_INFO, spec), to_camera_info(step, frame_id, spec.intrinsics)
        raw: tuple[tuple[Topic, bool, Callable[[], npt.NDArray[Any] | None]], ...] = (
            (topics.IMAGE, False, lambda: frame.rgb),
            (topics.IMAGE_SEMANTIC, spec.semantic, lambda: image.semantic),
            (topics.IMAGE_DEPTH, spec.depth, lambda: image.depth_m),
            (topics.IMAGE_INSTANCE, spec.instance, lambda: image.instance),
        )
        for kind, recorded, pixels_of in raw:
            topic = self._topic(kind.if_recorded(recorded), spec)
            if (recorded or self.wants_raw(topic)) and (pixels := pixels_of()) is not None:
                yield topic, to_image(step, frame_id, pixels.astype(np.uint16) if pixels.dtype == np.uint32 else pixels)
        if labels is not None:
            yield self._topic(topics.IMAGE_TRUTH, spec), to_camera_truth(labels, frame_id)
            yield self._topic(topics.IMAGE_BOXES, spec), to_image_boxes(labels, frame_id)

    def _topic(self, topic: Topic, spec: SensorSpec | None = None) -> Topic:
        """The topic of this carrier, or of one of its sensors."""
        of_sensor = topic if spec is None else topic.of_sensor(spec.name, spec.period_steps)
        return of_sensor.of_carrier(self.carrier.name)
