"""The table of all topics of the node graph: name, type, publisher, subscribers, rate. All nodes read it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from siren_ros.simulation.world.carrier import LABEL_PERIOD_STEPS
from siren_ros.simulation.world.commands import AV_SOURCE

EMV_CARRIER: Final = "emv"
AV_CARRIER: Final = "av"
"""Names of the carriers of sensors; their topics begin with these names."""
EVERY_STEP: Final = 1
ONCE: Final = 0


@dataclass(frozen=True)
class Topic:
    """One topic of the node graph."""

    name: str
    type_name: str
    publisher: str
    """Node that publishes the topic; an empty string means every participant."""
    subscribers: tuple[str, ...] = ()
    """Nodes of the lockstep whose subscriptions must be connected before the first step."""
    period_steps: int = EVERY_STEP
    """The topic has a message at every step that is a multiple of this; ONCE for latched topics."""

    @property
    def latched(self) -> bool:
        """Whether late subscribers get the last message (QoS: transient local)."""
        return self.period_steps == ONCE

    @property
    def recorded(self) -> bool:
        """Whether the episode's bag contains the topic."""
        return "recorder" in self.subscribers

    def subscriber_count(self, participants: Sequence[str]) -> int:
        """Number of an episode's participants that subscribe to this topic."""
        return sum(name in participants for name in self.subscribers)

    def of_sensor(self, sensor: str, period_steps: int) -> "Topic":
        """This topic for one sensor of a suite, with the sensor's name in place of ``{sensor}``."""
        return replace(self, name=self.name.format(sensor=sensor), period_steps=period_steps)

    def if_recorded(self, recorded: bool) -> "Topic":
        """This topic with the given choice whether it is recorded."""
        return replace(self, subscribers=("recorder",) if recorded else ())

    def of_carrier(self, carrier: str) -> "Topic":
        """This topic for another carrier than the first emergency vehicle: ``/av/odom`` in place of ``/emv/odom``.

        Of the nodes, only the recorder waits for messages of other carriers.
        """
        name = self.name.removeprefix(f"/{EMV_CARRIER}/")
        if carrier == EMV_CARRIER or name == self.name:
            return self
        return replace(self, name=f"/{carrier}/{name}", subscribers=("recorder",) if self.recorded else ())


_CONTROLLERS: Final = ("emv_controller", "yield_manager", "vehicle_dynamics")
_EVERYBODY: Final = (*_CONTROLLERS, "sensor_sim", "recorder", "kitti_exporter", "detector")

CLOCK: Final = Topic("/clock", "rosgraph_msgs/msg/Clock", "cosim", ("sumo_bridge", "recorder", "kitti_exporter"))
"""Simulated time; begins a step."""
EPISODE: Final = Topic("/siren/episode", "siren_msgs/msg/EpisodeDescription", "sumo_bridge", _EVERYBODY, ONCE)
"""Template, level, seed, map, drawn values, parameter files."""
MAP: Final = Topic("/siren/map", "std_msgs/msg/String", "sumo_bridge", _EVERYBODY, ONCE)
"""The compiled SUMO net, as XML text."""
TRAFFIC: Final = Topic(
    "/siren/traffic_state", "siren_msgs/msg/TrafficState", "sumo_bridge", (*_CONTROLLERS, "sensor_sim", "recorder")
)
"""SUMO's vehicles and signals, SUMO's advice to the EMV."""
ROSTER: Final = Topic("/siren/roster", "siren_msgs/msg/TrafficState", "sumo_bridge", period_steps=ONCE)
"""The last state in which an actor is new, with all actors so far in ``spawned``: for programs that come later."""
EMV_COMMANDS: Final = Topic(
    "/siren/emv_commands", "siren_msgs/msg/VehicleCommands", "emv_controller", ("vehicle_dynamics", "recorder")
)
"""Pedals and steering of the emergency vehicles."""
YIELD_COMMANDS: Final = Topic(
    "/siren/yield_commands", "siren_msgs/msg/VehicleCommands", "yield_manager", ("vehicle_dynamics", "recorder")
)
"""Pedals and steering of the civilians that yield."""
ACTORS: Final = Topic(
    "/siren/actor_states", "siren_msgs/msg/ActorStates", "vehicle_dynamics", ("sumo_bridge", "sensor_sim", "recorder")
)
"""The simulated state of everybody: the truth."""
EVENTS: Final = Topic("/siren/events", "siren_msgs/msg/Events", "vehicle_dynamics", ("recorder",))
"""What happened in the step, and the hash of the state."""
STEP_DONE: Final = Topic("/siren/step_done", "siren_msgs/msg/StepDone", "")
"""The participant has finished step k."""
EPISODE_END: Final = Topic("/siren/episode_end", "siren_msgs/msg/EpisodeEnd", "cosim", period_steps=ONCE)
"""Why the episode ended. The recorder writes it and the outcome as the last messages of the bag."""
OUTCOME: Final = Topic("/siren/outcome", "siren_msgs/msg/EpisodeOutcome", "recorder", ("recorder",), ONCE)
"""Whether the interaction happened, with numbers."""
TF: Final = Topic("/tf", "tf2_msgs/msg/TFMessage", "sensor_sim", ("recorder", "detector"))
"""``map`` → ``odom`` → ``base_link`` of each carrier."""
TF_STATIC: Final = Topic("/tf_static", "tf2_msgs/msg/TFMessage", "sensor_sim", ("recorder",), ONCE)
"""Mounts of the sensors."""
SENSING: Final = Topic("/siren/sensing", "std_msgs/msg/String", "sensor_sim", ("recorder",), ONCE)
"""How the sensors of each carrier were simulated on this machine, as a JSON object."""
ODOMETRY: Final = Topic("/emv/odom", "nav_msgs/msg/Odometry", "sensor_sim", ("recorder",))
"""Wheel odometry: pose in ``odom``, velocity in ``base_link``, with errors and covariances."""
GROUND_TRUTH: Final = Topic(
    "/emv/ground_truth", "siren_msgs/msg/GroundTruth", "sensor_sim", ("recorder", "kitti_exporter"), LABEL_PERIOD_STEPS
)
"""Boxes in space in the frame of the carrier's first LiDAR, or its ``base_link`` without one; LiDAR points on each."""
BOXES: Final = Topic(
    "/emv/ground_truth/boxes", "vision_msgs/msg/Detection3DArray", "sensor_sim", ("recorder",), LABEL_PERIOD_STEPS
)
"""The same boxes for standard tools."""
MARKERS: Final = Topic("/siren/markers", "visualization_msgs/msg/MarkerArray", "sensor_sim", ("recorder",), 4)
"""Roads, vehicles and modes for RViz and Foxglove."""
LIDAR: Final = Topic(
    "/emv/{sensor}/points", "sensor_msgs/msg/PointCloud2", "sensor_sim", ("recorder", "kitti_exporter", "detector")
)
"""LiDAR: x, y, z, intensity, time, ring, instance."""
IMAGE: Final = Topic("/emv/{sensor}/image_raw", "sensor_msgs/msg/Image", "sensor_sim", (), 2)
"""Camera, ``rgb8``, while somebody subscribes; the bag holds the compressed image."""
IMAGE_COMPRESSED: Final = Topic(
    "/emv/{sensor}/image_raw/compressed",
    "sensor_msgs/msg/CompressedImage",
    "sensor_sim",
    ("recorder", "kitti_exporter"),
    2,
)
"""Camera: JPEG."""
IMAGE_DEPTH: Final = Topic("/emv/{sensor}/depth/image_raw", "sensor_msgs/msg/Image", "sensor_sim", (), 2)
"""``32FC1``, metres along the optical axis, 0 in the sky; like the next two recorded where the suite says so."""
IMAGE_SEMANTIC: Final = Topic("/emv/{sensor}/semantic/image_raw", "sensor_msgs/msg/Image", "sensor_sim", (), 2)
"""``mono8``, CARLA's semantic classes."""
IMAGE_INSTANCE: Final = Topic("/emv/{sensor}/instance/image_raw", "sensor_msgs/msg/Image", "sensor_sim", (), 2)
"""``mono16``, actor ids."""
IMAGE_TRUTH: Final = Topic("/emv/{sensor}/ground_truth", "siren_msgs/msg/CameraTruth", "sensor_sim", ("recorder",), 2)
"""Boxes in the image, visible fraction, truncation, class, EMV; with ``labels: true``."""
IMAGE_BOXES: Final = Topic(
    "/emv/{sensor}/ground_truth/boxes", "vision_msgs/msg/Detection2DArray", "sensor_sim", ("recorder",), 2
)
"""The same boxes for standard tools."""
GNSS: Final = Topic("/emv/{sensor}/fix", "sensor_msgs/msg/NavSatFix", "sensor_sim", ("recorder",), 2)
"""GNSS."""
IMU: Final = Topic("/emv/{sensor}/data", "sensor_msgs/msg/Imu", "sensor_sim", ("recorder",))
"""IMU: specific force, angular rate."""
AUDIO: Final = Topic("/emv/{sensor}/audio", "siren_msgs/msg/AudioChunk", "sensor_sim", ("recorder",))
"""Microphone: 16-bit PCM, a chunk per step."""
CAMERA_INFO: Final = Topic("/emv/{sensor}/camera_info", "sensor_msgs/msg/CameraInfo", "sensor_sim", ("recorder",), 2)
"""Intrinsics, exact to the pixel."""

AV_CONTROL: Final = Topic("/av/control_cmd", "siren_msgs/msg/AvControl", AV_SOURCE, ("vehicle_dynamics", "recorder"))
"""The answer of the AV's controller to a step; it drives the AV from this step to the next."""
AV_ROUTE: Final = Topic("/av/route", "nav_msgs/msg/Path", "sumo_bridge", ("recorder",), ONCE)
"""The AV's path along its route: lane centres, with the necessary lane changes."""

PREDICTIONS: Final = Topic("/predictions", "siren_msgs/msg/PredictedPaths", "", ("recorder",), 2)
"""Predicted positions of vehicles at every frame, from a predictor under test."""

DETECTIONS: Final = Topic(
    "/emv/detections", "vision_msgs/msg/Detection3DArray", "detector", ("recorder",), LABEL_PERIOD_STEPS
)
"""Boxes of vehicles in the frame of the first LiDAR, with class and confidence."""
DETECTION_LATENCY: Final = Topic("/emv/detections/latency", "std_msgs/msg/Float64", "detector", (), LABEL_PERIOD_STEPS)
"""Wall time of the detection in seconds. It is not recorded, so that bags of the same episode have the same bytes."""

OBSERVED: Final = {
    topic.name: replace(topic, name=topic.name.replace("/siren/", "/siren/observed/"), subscribers=())
    for topic in (TRAFFIC, ACTORS, EVENTS)
}
"""Copies of topics for programs that only watch, by the name of the original. A subscriber of the original would make
DDS deliver it to the lockstep's nodes as well, which slows them (``siren_ros/running/ros/transport/endpoints.py``)."""

DECISIVE_TOPICS: Final = frozenset(
    topic.name
    for topic in (
        CLOCK,
        EPISODE,
        MAP,
        TRAFFIC,
        EMV_COMMANDS,
        YIELD_COMMANDS,
        ACTORS,
        EVENTS,
        STEP_DONE,
        EPISODE_END,
        OUTCOME,
        SENSING,
        AV_CONTROL,
        AV_ROUTE,
        PREDICTIONS,
    )
)
"""Topics that decide the course of an episode and its record. An episode continues only while each of them has exactly
its known publishers. Other programs may publish on ``/tf`` and on the sensors' topics, because a forged measurement is
noticed when the true one arrives."""
STEERED_FROM_OUTSIDE: Final = frozenset({AV_CONTROL.name, PREDICTIONS.name})
"""Decisive topics that another program publishes; the program is known when it reports ready."""

LAGGED_INPUTS: Final = frozenset({(ACTORS.name, "sumo_bridge"), (AV_CONTROL.name, "vehicle_dynamics")})
"""Pairs of topic and subscriber in which a step needs the message of the previous step."""


def upstream_of(participant: str, *, lagged: bool = False) -> frozenset[str]:
    """Participants that must act on a step before this one can; ``lagged`` adds those of the previous step."""
    inputs = (
        CLOCK,
        TRAFFIC,
        EMV_COMMANDS,
        YIELD_COMMANDS,
        ACTORS,
        EVENTS,
        TF,
        ODOMETRY,
        GROUND_TRUTH,
        LIDAR,
        AV_CONTROL,
        DETECTIONS,
    )
    return frozenset(
        topic.publisher
        for topic in inputs
        if participant in topic.subscribers and (lagged or (topic.name, participant) not in LAGGED_INPUTS)
    )


CORE_TOPICS: Final = (CLOCK, EPISODE, MAP, TRAFFIC, EMV_COMMANDS, YIELD_COMMANDS, ACTORS, EVENTS, OUTCOME)
"""Topics that the record of every episode contains, with any sensors."""
CARRIER_TOPICS: Final = (TF_STATIC, SENSING, TF, ODOMETRY, GROUND_TRUTH, BOXES, MARKERS)
"""Topics that ``sensor_sim`` publishes with every suite, even an empty one."""
AV_TOPICS: Final = (AV_ROUTE, AV_CONTROL)
"""Further topics of an episode with an AV under test, with any sensors."""
AV_CARRIER_TOPICS: Final = tuple(topic.of_carrier(AV_CARRIER) for topic in (ODOMETRY, GROUND_TRUTH, BOXES))
"""Further topics that ``sensor_sim`` publishes for an AV under test."""
FIXED_TOPICS: Final = {
    topic.name: topic
    for topic in (*CORE_TOPICS, *CARRIER_TOPICS, *AV_TOPICS, *AV_CARRIER_TOPICS, PREDICTIONS, DETECTIONS)
}
"""Recorded topics by name whose rates do not depend on a sensor suite."""
