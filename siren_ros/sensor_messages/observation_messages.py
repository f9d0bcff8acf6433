"""Observations as messages: the output of ``sensor_sim`` at a step."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from siren_ros.interfaces import topics
from siren_ros.interfaces.boxes import boxes_of, to_boxes, to_camera_truth, to_ground_truth, to_image_boxes
from siren_ros.interfaces.markers import to_markers, vehicle_markers
from siren_ros.interfaces.measurements import to_camera_info, to_compressed_image, to_image, to_point_cloud
from siren_ros.interfaces.topics import Topic
from siren_ros.interfaces.transforms import Transform, to_odometry, to_tf
from siren_ros.sensor_messages.sensor_topics import EMV, SENSOR_MESSAGES, Carrier, optical_frame
from siren_ros.sensors.camera.camera import CameraFrame
from siren_ros.sensors.rig import Observations
from siren_ros.sensors.specification import CameraSpec
from siren_ros.sensors.suite import LabelKinds, SensorSuite
from siren_ros.world.actors import ActorDescription, ActorStates
from siren_ros.world.carrier import BASE_FRAME, ODOM_FRAME, CameraTruth, GroundTruth, Odometry

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
    """Whether somebody listens to a topic that is not recorded."""
    carrier: Carrier = EMV

    def of_step(self, states: ActorStates, seen: Observations) -> Iterator[Published]:
        """Messages that are due at the step, each with its topic."""
        step, frame = states.step, self.carrier.frame
        if seen.truth is not None:
            yield from self._labels(replace(seen.truth, frame_id=frame(seen.truth.frame_id)))
        for sweep in seen.sweeps:
            period = next(spec.period_steps for spec in self.suite.lidars if spec.name == sweep.sensor)
            cloud = to_point_cloud(step, frame(sweep.sensor), sweep.points)
            yield self._own(topics.LIDAR.of_sensor(sweep.sensor, period)), cloud
        for exposure in seen.frames:
            yield from self._images(exposure, seen.labels.get(exposure.sensor))
        for spec, measured in seen.others:
            entry = SENSOR_MESSAGES[type(spec)]
            topic = self._own(entry.topic.of_sensor(spec.name, spec.period_steps))
            yield topic, entry.to_message(replace(measured, frame_id=frame(measured.frame_id)))

    def odometry(self, step: int, odometry: Odometry) -> Published:
        """The odometry of the carrier."""
        frame = self.carrier.frame
        return self._own(topics.ODOMETRY), to_odometry(step, odometry, frame(ODOM_FRAME), frame(BASE_FRAME))

    def _labels(self, truth: GroundTruth) -> Iterator[Published]:
        if truth.step % topics.GROUND_TRUTH.period_steps == 0:
            yield self._own(topics.GROUND_TRUTH), to_ground_truth(truth)
        if truth.step % topics.BOXES.period_steps == 0:
            yield self._own(topics.BOXES), to_boxes(boxes_of(truth, truth.frame_id))

    def label_kinds(self, camera: CameraSpec) -> LabelKinds:
        """Labels of a camera that the suite records or that somebody listens to."""
        period, recorded = camera.period_steps, LabelKinds.of(self.suite, camera)
        depth = self._own(topics.IMAGE_DEPTH.of_sensor(camera.name, period))
        instance = self._own(topics.IMAGE_INSTANCE.of_sensor(camera.name, period))
        return LabelKinds(
            recorded.depth or self.wants_raw(depth), recorded.instance or self.wants_raw(instance), recorded.boxes
        )

    def _images(self, frame: CameraFrame, labels: CameraTruth | None) -> Iterator[Published]:
        spec = next(camera for camera in self.suite.cameras if camera.name == frame.sensor)
        period, frame_id = spec.period_steps, self.carrier.frame(optical_frame(spec.name))
        compressed = topics.IMAGE_COMPRESSED.of_sensor(spec.name, period)
        yield self._own(compressed), to_compressed_image(frame.step, frame_id, frame.jpeg)
        info = topics.CAMERA_INFO.of_sensor(spec.name, period)
        yield self._own(info), to_camera_info(frame.step, frame_id, spec.intrinsics)
        raw = self._own(topics.IMAGE.of_sensor(spec.name, period))
        if self.wants_raw(raw):
            yield raw, to_image(frame.step, frame_id, frame.rgb)
        image = frame.image
        semantic = self._own(topics.IMAGE_SEMANTIC.of_sensor(spec.name, period).if_recorded(spec.semantic))
        if semantic.recorded or self.wants_raw(semantic):
            yield semantic, to_image(frame.step, frame_id, image.semantic)
        if image.depth_m is not None:
            depth = self._own(topics.IMAGE_DEPTH.of_sensor(spec.name, period).if_recorded(spec.depth))
            if depth.recorded or self.wants_raw(depth):
                yield depth, to_image(frame.step, frame_id, image.depth_m)
        if image.instance is not None:
            instance = self._own(topics.IMAGE_INSTANCE.of_sensor(spec.name, period).if_recorded(spec.instance))
            if instance.recorded or self.wants_raw(instance):
                yield instance, to_image(frame.step, frame_id, image.instance.astype(np.uint16))
        if labels is not None:
            truth = self._own(topics.IMAGE_TRUTH.of_sensor(spec.name, period))
            yield truth, to_camera_truth(labels, frame_id)
            boxes = self._own(topics.IMAGE_BOXES.of_sensor(spec.name, period))
            yield boxes, to_image_boxes(labels, frame_id)

    def _own(self, topic: Topic) -> Topic:
        return topic.of_carrier(self.carrier.name)
