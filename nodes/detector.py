"""``detector``: detects vehicles during the episode, with ``-p detector:=pillars``."""

import sys
import time
from functools import partial
from typing import Any

import numpy as np

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.boxes import SpaceBoxes, to_boxes
from siren_ros.data.interfaces.conversions import EpisodeClosing
from siren_ros.data.interfaces.measurements import from_point_cloud, from_tf, matrix_between
from siren_ros.data.interfaces.messages import make_message
from siren_ros.data.lockstep import Input
from siren_ros.errors import InputError
from siren_ros.running.ros.node_configs import DetectorConfig
from siren_ros.running.ros.participants.participant import Participant
from siren_ros.running.ros.programs.program import run_program
from siren_ros.scoring.evaluation.detection.boxes import FoundBoxes
from siren_ros.scoring.evaluation.detection.pillar_detector import (
    PillarDetector,
    detector_file,
    load_detector,
)
from siren_ros.sensing.suite import load_suite
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.world.carrier import BASE_FRAME, MAP_FRAME


class Detector(Participant[DetectorConfig]):
    """Runs a detector on the sweeps of the first LiDAR; it answers at the steps that have labels."""

    config_type = DetectorConfig
    inputs = (Input(topics.TF),)
    outputs = (topics.DETECTIONS, topics.DETECTION_LATENCY)

    def __init__(self, name: str, **node_options: Any) -> None:
        super().__init__(name, **node_options)
        self._latencies_s: list[float] = []

    def prepare(self, episode: EpisodeDescription, map_xml: bytes) -> None:  # noqa: ARG002 - the interface of all nodes
        """Load the network and subscribe to the first LiDAR."""
        suite = load_suite(episode.sensor_suite, episode.files)
        if not suite.lidars:
            raise InputError("sensors", episode.sensor_suite, "a suite with a LiDAR, for the detector")
        lidar = min(suite.lidars, key=lambda spec: spec.name)
        self._lidar = topics.LIDAR.of_sensor(lidar.name, lidar.period_steps)
        self._base_from_lidar = lidar.mount.base_from_sensor
        self._frame_id = lidar.name
        self._detector = PillarDetector(load_detector(detector_file(self.config.weights)), lidar.mount.z_m)
        self.join_more([Input(self._lidar)])

    def on_step(self, step: int, inputs: dict[str, Any]) -> None:
        """Take the sweep; where the step has labels, say what is there."""
        began = time.perf_counter()
        sweep = inputs.get(self._lidar.name)
        if sweep is not None:
            map_from_base = matrix_between(from_tf(inputs[topics.TF.name]), MAP_FRAME, BASE_FRAME)
            self._detector.add(step, from_point_cloud(sweep), map_from_base @ self._base_from_lidar)
        if step % topics.DETECTIONS.period_steps:
            return
        detected = FoundBoxes.none() if sweep is None else self._detector.boxes()
        names = tuple(detected.label.tolist())
        boxes = SpaceBoxes(
            step, self._frame_id, names, detected.score, detected.centre_m, detected.size_m, detected.yaw_rad
        )
        self.send(topics.DETECTIONS, to_boxes(boxes))
        self._latencies_s.append(time.perf_counter() - began)
        self.send(topics.DETECTION_LATENCY, make_message("std_msgs/msg/Float64", data=self._latencies_s[-1]))

    def close(self, closing: EpisodeClosing) -> None:  # noqa: ARG002 - the interface of all nodes
        """Say how long it took."""
        if self._latencies_s:
            middle, slow = np.percentile(self._latencies_s, [50.0, 95.0])
            self.get_logger().info(f"latency of a detection: median {middle:.3f} s, 95 % below {slow:.3f} s")


NODE = Detector
main = partial(run_program, NODE, "detector")

if __name__ == "__main__":
    sys.exit(main())
