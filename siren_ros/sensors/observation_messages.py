"""Observations as messages: what ``sensor_sim`` publishes at a step."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from siren_ros.interfaces import topics
from siren_ros.interfaces.boxes import boxes_of, to_boxes
from siren_ros.interfaces.conversions import to_ground_truth
from siren_ros.interfaces.factory import MessageFactory
from siren_ros.interfaces.images import PinholeCamera, to_camera_info, to_compressed_image, to_image
from siren_ros.interfaces.markers import to_markers, vehicle_markers
from siren_ros.interfaces.point_cloud import to_point_cloud
from siren_ros.interfaces.topics import Topic
from siren_ros.interfaces.transforms import to_odometry, to_tf
from siren_ros.sensors.camera import CameraFrame
from siren_ros.sensors.camera_model import Pinhole
from siren_ros.sensors.carrier import map_from_base_transform, odometry_of, optical_frame, row_of_carrier
from siren_ros.sensors.rig import Observations
from siren_ros.sensors.suite import CameraSpec, SensorSuite, period_steps
from siren_ros.world.actors import ActorDescription, ActorStates

Published = tuple[Topic, Any]


@dataclass(frozen=True)
class ObservationMessages:
    """Makes the messages of one suite."""

    factory: MessageFactory
    suite: SensorSuite
    carrier_id: int
    wants_raw: Callable[[Topic], bool]
    """Whether somebody listens to a topic that is not recorded."""

    def of_step(
        self, states: ActorStates, actors: Mapping[int, ActorDescription], seen: Observations
    ) -> Iterator[Published]:
        """Messages that are due at the step, each with its topic.

        Raises:
            EpisodeError: The carrier has left the map.
        """
        step, factory = states.step, self.factory
        row = row_of_carrier(states, self.carrier_id)
        yield topics.TF, to_tf(factory, step, [map_from_base_transform(states, row)])
        yield topics.ODOMETRY, to_odometry(factory, step, odometry_of(states, row))
        if step % topics.GROUND_TRUTH.period_steps == 0:
            yield topics.GROUND_TRUTH, to_ground_truth(factory, seen.truth)
        if step % topics.BOXES.period_steps == 0:
            yield topics.BOXES, to_boxes(factory, boxes_of(seen.truth, seen.truth.frame_id))
        if step % topics.MARKERS.period_steps == 0:
            yield topics.MARKERS, to_markers(factory, step, vehicle_markers(states, actors))
        for sweep in seen.sweeps:
            period = period_steps(next(spec.rate_hz for spec in self.suite.lidars if spec.name == sweep.sensor))
            cloud = to_point_cloud(factory, step, sweep.sensor, sweep.points)
            yield topics.LIDAR.of_sensor(sweep.sensor, period), cloud
        for frame in seen.frames:
            yield from self._images(frame)

    def _images(self, frame: CameraFrame) -> Iterator[Published]:
        spec = next(camera for camera in self.suite.cameras if camera.name == frame.sensor)
        period, frame_id = period_steps(spec.rate_hz), optical_frame(spec.name)
        compressed = topics.IMAGE_COMPRESSED.of_sensor(spec.name, period)
        yield compressed, to_compressed_image(self.factory, frame.step, frame_id, frame.jpeg)
        info = topics.CAMERA_INFO.of_sensor(spec.name, period)
        yield info, to_camera_info(self.factory, frame.step, frame_id, intrinsics(spec))
        raw = topics.IMAGE.of_sensor(spec.name, period)
        if self.wants_raw(raw):
            yield raw, to_image(self.factory, frame.step, frame_id, frame.rgb)


def intrinsics(spec: CameraSpec) -> PinholeCamera:
    """What CameraInfo says of a camera."""
    pinhole = Pinhole.of(spec)
    k = pinhole.k
    return PinholeCamera(pinhole.width, pinhole.height, float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]))
