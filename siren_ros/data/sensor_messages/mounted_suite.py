"""The suites of one episode, each on its carrier, in one shared world; they measure and make messages.

Sensing goes step by step; a step's measurements may end after the next step has begun. The messages are the output of
``sensor_sim`` at a step.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.boxes import (
    boxes_of,
    to_boxes,
    to_camera_truth,
    to_ground_truth,
    to_image_boxes,
    to_markers,
    vehicle_markers,
)
from siren_ros.data.interfaces.measurements import (
    Transform,
    in_layout,
    to_camera_info,
    to_compressed_image,
    to_image,
    to_odometry,
    to_point_cloud,
    to_tf,
)
from siren_ros.data.interfaces.messages import make_message
from siren_ros.data.interfaces.topics import AV_CARRIER_TOPICS, Topic
from siren_ros.data.sensor_messages.sensor_topics import (
    AV,
    EMV,
    SENSOR_MESSAGES,
    Carrier,
    carriers_of,
    frames_of,
    motion_of,
    noise_seed,
    optical_frame,
    row_of_carrier,
    static_transforms,
    suite_topics,
)
from siren_ros.sensing.camera.camera import CameraFrame
from siren_ros.sensing.look import load_look, look_of
from siren_ros.sensing.navigation import WheelOdometry
from siren_ros.sensing.rig import Elsewhere, Observations, Sensing, SensorRig
from siren_ros.sensing.scene.kerbside import scene_config_of
from siren_ros.sensing.specification import CameraSpec, SensorSpec
from siren_ros.sensing.suite import LabelKinds, SensorSuite
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.world.actors import ActorDescription, ActorStates, SignalState
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
            turn_s = 1.0 / lidar.rate_hz if lidar.motion_distortion else 0.0
            points = in_layout(sweep.points, lidar.points_layout, turn_s)
            yield self._topic(topics.LIDAR, lidar), to_point_cloud(step, frame(sweep.sensor), points)
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


@dataclass(frozen=True, eq=False)
class MountedSuite:
    """A suite on its carrier, ready to measure."""

    rig: SensorRig
    messages: ObservationMessages
    topics: tuple[Topic, ...]
    """Topics of this suite, besides those that every carrier has."""
    transforms: tuple[Transform, ...]
    """Mounts of the sensors."""
    wheels: WheelOdometry

    @property
    def carrier(self) -> Carrier:
        """The vehicle with the suite."""
        return self.messages.carrier

    def locate(self, states: ActorStates) -> tuple[tuple[Transform, ...], Published]:
        """Frames and odometry of the carrier; call it at every step. EpisodeError if the carrier has left the map."""
        motion = motion_of(states, row_of_carrier(states, self.messages.carrier_id))
        odometry = self.wheels.measure(states.step, motion)
        return frames_of(motion, odometry, self.carrier), self.messages.odometry(states.step, odometry)


def mounted_suites(
    episode: EpisodeDescription,
    network: RoadNetwork,
    wants_raw: Callable[[Topic], bool],
    *,
    in_background: bool,
    elsewhere: Callable[[SensorSuite, Carrier], Elsewhere] | None = None,
) -> Iterator[MountedSuite]:
    """Make the suites of all carriers of an episode. Call it in the thread that will measure.

    ``wants_raw`` is as ``ObservationMessages`` takes it, ``in_background`` as ``SensorRig`` does; ``elsewhere`` gives
    for each suite and its carrier what ``SensorRig`` takes as such.

    Raises:
        InputError: A suite or a look that cannot be loaded, or sensors inside a building.
    """
    look, scene = load_look(look_of(episode), episode.files), None
    for carrier, actor_id, suite in carriers_of(episode):
        messages = ObservationMessages(suite, actor_id, wants_raw, carrier)
        rig = SensorRig(
            suite,
            network,
            episode.seed,
            scene_config_of(episode.template_values),
            look=look,
            scene=scene,
            noise_seed=noise_seed(episode.seed, carrier),
            site=episode.site,
            label_kinds=messages.label_kinds,
            in_background=in_background,
            elsewhere=None if elsewhere is None else elsewhere(suite, carrier),
        )
        rig.prepare()
        scene = rig.scene
        topics_ = (*(AV_CARRIER_TOPICS if carrier == AV else ()), *suite_topics(suite, carrier))
        mounts = tuple(static_transforms(suite, carrier, rig.station))
        yield MountedSuite(rig, messages, topics_, mounts, WheelOdometry(noise_seed(episode.seed, carrier)))


def setup_messages(suites: Sequence[MountedSuite]) -> Iterator[Published]:
    """Messages before the first step: mounts of the sensors, and how this machine simulates them."""
    yield topics.TF_STATIC, to_tf(0, [transform for suite in suites for transform in suite.transforms])
    accounts = {suite.carrier.name: suite.rig.account for suite in suites}
    yield topics.SENSING, make_message(topics.SENSING.type_name, data=json.dumps(accounts, sort_keys=True))


class TrailingSensing:
    """Measures with the suites of an episode, and tracks for which steps all messages were published."""

    def __init__(self, suites: Sequence[MountedSuite], *, trails: bool) -> None:
        """Begin before the first step; ``trails`` allows a step's measurements to end during the next step."""
        self._suites = tuple(suites)
        self._trails = trails
        self._begun: tuple[ActorStates, list[Sensing]] | None = None
        self._unreported: list[int] = []
        self._busy_s = 0.0

    @property
    def under_way(self) -> bool:
        """Whether a step's measurements have begun and are not published yet."""
        return self._begun is not None

    def step(
        self, states: ActorStates, actors: Mapping[int, ActorDescription], signals: Iterable[SignalState]
    ) -> Iterator[Published]:
        """Begin to measure at a step; yield the messages that can be published now, each with its topic.

        The measurements of the step before end first. Their messages come after this step's measurements have begun,
        so that publishing runs in parallel with them. Raises EpisodeError where a carrier has left the map.
        """
        earlier = self._end()
        located = [suite.locate(states) for suite in self._suites]
        yield from shared_messages(states, actors, [transform for transforms, _ in located for transform in transforms])
        yield from (odometry for _, odometry in located)
        begun = [suite.rig.begin(states, actors, signals, suite.messages.carrier_id) for suite in self._suites]
        self._begun = (states, begun)
        yield from earlier
        if not self._trails or not any(sensing.under_way for sensing in begun):
            yield from self.finish()

    def finish(self) -> Iterator[Published]:
        """Wait for the measurements that have begun and yield their messages; none if none has begun."""
        yield from self._end()

    def finished_steps(self, busy_s: float) -> Iterator[tuple[int, float]]:
        """Steps whose messages were all published, each once.

        With each comes the wall time spent on sensing since the last call.
        """
        self._busy_s += busy_s
        while self._unreported:
            yield self._unreported.pop(0), self._busy_s
            self._busy_s = 0.0

    def _end(self) -> Iterator[Published]:
        """Wait now for the measurements that have begun; messages are made when they are requested."""
        if self._begun is None:
            return iter(())
        (states, begun), self._begun = self._begun, None
        return self._messages(states, [sensing.finish() for sensing in begun])

    def _messages(self, states: ActorStates, seen: Sequence[Observations]) -> Iterator[Published]:
        for suite, observations in zip(self._suites, seen, strict=True):
            yield from suite.messages.of_step(states, observations)
        self._unreported.append(states.step)
