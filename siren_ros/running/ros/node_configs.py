"""Configuration of every node, as one frozen dataclass each; defaults are defined only here."""

from dataclasses import dataclass
from typing import Final

from siren_ros.base.params.parameters import parameter
from siren_ros.data.lockstep import START_TIMEOUT_S, STEP_TIMEOUT_S
from siren_ros.simulation.scenario.episode import SHIPPED_DETECTOR, EpisodeRequest, KittiLayout
from siren_ros.simulation.world.actors import RESIDUAL_LIMIT_M

KITTI_LAYOUTS: Final = tuple(layout.value for layout in KittiLayout)

DEFAULT_PARTICIPANTS: Final = (
    "sumo_bridge",
    "emv_controller",
    "yield_manager",
    "vehicle_dynamics",
    "sensor_sim",
    "recorder",
)
OPTIONAL_PARTICIPANTS: Final = ("kitti_exporter", "detector")
"""Nodes that run only if the episode needs them."""


@dataclass(frozen=True)
class ParticipantConfig:
    """Parameters of every node in the lockstep."""

    participants: list[str] = parameter(
        list(DEFAULT_PARTICIPANTS),
        "Nodes of this episode; each waits until those it exchanges messages with are there.",
    )


@dataclass(frozen=True)
class SumoBridgeConfig(EpisodeRequest, ParticipantConfig):
    """Parameters of ``sumo_bridge``: map, scenario and SUMO."""

    residual_limit_m: float = parameter(
        RESIDUAL_LIMIT_M,
        "Distance between SUMO's and the simulated pose above which the episode fails.",
        minimum=0.1,
        maximum=100.0,
    )


EmvControllerConfig = ParticipantConfig
YieldManagerConfig = ParticipantConfig
VehicleDynamicsConfig = ParticipantConfig


@dataclass(frozen=True)
class SensorSimConfig(ParticipantConfig):
    """Parameters of ``sensor_sim``."""

    trails: bool = parameter(
        False, "Whether a step's sweeps and pictures may still be made while the next step begins."
    )
    carla: str = parameter("", "Of the node carla_bridge: HOST:PORT of the CARLA server that senses.")


@dataclass(frozen=True)
class RecorderConfig(ParticipantConfig):
    """Parameters of ``recorder``."""

    bag: str = parameter("", "Folder of the bag to write; empty: bags/TEMPLATE_LEVEL_seedN.")
    overwrite: bool = parameter(False, "Replace an earlier episode in that place; nothing else is ever replaced.")


@dataclass(frozen=True)
class KittiExporterConfig(ParticipantConfig):
    """Parameters of ``kitti_exporter``."""

    out: str = parameter("", "Folder of the KITTI export; empty: bags/TEMPLATE_LEVEL_seedN_kitti.")
    layout: str = parameter("kitti", "KITTI's own layout, or exactly the paper's.", choices=KITTI_LAYOUTS)
    overwrite: bool = parameter(False, "Replace an earlier export in that place; nothing else is ever replaced.")


@dataclass(frozen=True)
class DetectorConfig(ParticipantConfig):
    """Parameters of ``detector``."""

    weights: str = parameter(
        SHIPPED_DETECTOR, "The detector: pillars, or the path of an ONNX file of `siren train detection`."
    )


@dataclass(frozen=True)
class PlayerConfig:
    """Parameters of ``player``."""

    bag: str = parameter("", "Folder of the bag to play.")
    rate: float = parameter(1.0, "Simulated seconds per wall second.", minimum=0.01, maximum=100.0)
    start_s: float = parameter(0.0, "Simulated time at which it begins.", minimum=0.0, maximum=1e6)
    loop: bool = parameter(False, "Begin again at the end.")
    playback_duration_s: float = parameter(
        0.0, "Simulated duration that is played; 0: to the end of the bag.", minimum=0.0, maximum=1e6
    )
    topics: list[str] = parameter([], "Topics that are published, with the clock; empty: all.")
    paused: bool = parameter(False, "Wait for the service /rosbag2_player/resume before the first message.")
    delay_s: float = parameter(
        3.0, "Wall time that subscribers are given to connect before the first message.", minimum=0.0, maximum=3600.0
    )


@dataclass(frozen=True)
class ViewerConfig:
    """Parameters of ``viewer``."""

    port: int = parameter(0, "Port on this machine for the browser; 0: a free one.", minimum=0, maximum=65535)
    browser: bool = parameter(True, "Open the page in the browser; its address is printed in any case.")
    depth: int = parameter(
        1000, "Messages of a topic that wait while the viewer is busy; the oldest are lost.", minimum=8, maximum=100000
    )


@dataclass(frozen=True)
class CosimConfig(EpisodeRequest):
    """Parameters of ``cosim``: one episode with all its nodes."""

    bag: str = parameter("", "Folder of the bag to write; empty: bags/TEMPLATE_LEVEL_seedN.")
    overwrite: bool = parameter(
        False, "Replace an earlier episode and its KITTI export in that place; nothing else is ever replaced."
    )
    external: list[str] = parameter(
        [], "Programs that report every step on /siren/step_done under these names and are waited for."
    )
    kitti: bool = parameter(
        True, "Also write a KITTI export next to the bag, if the suite has a LiDAR and a front camera."
    )
    kitti_layout: str = parameter(
        "kitti", "KITTI's own layout, or exactly the paper's, which needs no camera.", choices=KITTI_LAYOUTS
    )
    processes: bool = parameter(False, "Run each node as a process of its own.")
    carla: str = parameter(
        "", "HOST:PORT of a CARLA server that senses, with the node carla_bridge; empty: the node sensor_sim senses."
    )
    realtime_factor: float = parameter(
        0.0, "Simulated seconds per wall second at most; 0: as fast as it goes.", minimum=0.0, maximum=1000.0
    )
    step_timeout_s: float = parameter(
        STEP_TIMEOUT_S,
        "Wall time after which a participant that has not finished its step ends the episode.",
        minimum=0.1,
        maximum=3600.0,
    )
    start_timeout_s: float = parameter(
        START_TIMEOUT_S,
        "Wall time after which a participant that is not ready for the first step ends the episode.",
        minimum=0.1,
        maximum=3600.0,
    )
    strict: bool = parameter(
        False, "End with exit code 1 also where the interaction did not happen, or vehicles collided."
    )
