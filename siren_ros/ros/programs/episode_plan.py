"""An episode from the parameters of ``cosim``: its participants, its files, the parameters of each node."""

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

from siren_ros.datasets.kitti.live_export import Layout, LiveExport
from siren_ros.errors import InputError
from siren_ros.generation.episode_setup import default_bag_path, default_kitti_path, plan_length
from siren_ros.lockstep.lockstep import LockstepConfig
from siren_ros.params.parameter_field import Value
from siren_ros.recording.bag_folder import check_new_bag
from siren_ros.ros.parameters.node_configs import DEFAULT_PARTICIPANTS, OPTIONAL_PARTICIPANTS, CosimConfig
from siren_ros.ros.programs.composition import Overrides
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.sensors.suite.suite import EXPORTED_CAMERA, load_suite
from siren_ros.world.commands import AV_SOURCE

TRAILING: Final = frozenset({"sensor_sim", "recorder", *OPTIONAL_PARTICIPANTS})
"""If no other program takes part in the lockstep, these may still work on a step while the next one runs: in their own
processes, or in one process on the threads that cast rays and draw."""
SETTLE_S: Final = 0.25
"""For participants that other programs start; discovery on one machine takes 0.05 s."""
_NO_CAMERA: Final = (
    f"the suite has no {EXPORTED_CAMERA}; `-p sensors:=front` has one, `-p kitti_layout:=paper` needs none, and "
    "`-p kitti:=false` asks for no export"
)
_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,63}")


@dataclass(frozen=True)
class EpisodePlan:
    """One episode before its nodes exist."""

    nodes: tuple[str, ...]
    """Participants that this program starts."""
    others: tuple[str, ...]
    """Participants that other programs start; the lockstep waits for them."""
    steps: int
    own_steps: int
    """Of the template, without ``duration_s``."""
    bag: Path
    kitti: Path | None
    """Folder of the KITTI export, None without one."""
    no_kitti: str
    """What a suite with a LiDAR lacks for the KITTI export that is wanted, and the parameter that helps; else empty."""
    overrides: Mapping[str, Overrides]
    """Parameters of each node; the recorder comes first, because a bag that exists already ends the episode."""

    def lockstep(self, config: CosimConfig) -> LockstepConfig:
        """Participants and time limits."""
        return LockstepConfig(
            participants=(*self.nodes, *self.others),
            outside=self.others,
            steps=self.steps,
            step_timeout_s=config.step_timeout_s,
            start_timeout_s=config.start_timeout_s,
            trailing=frozenset() if self.others else TRAILING,
        )

    @property
    def is_cut_short(self) -> bool:
        """Whether ``duration_s`` ends the episode before the template does."""
        return self.steps < self.own_steps

    @property
    def settle_s(self) -> float:
        """Time for discovery before the first step, where other programs take part."""
        return SETTLE_S if self.others else 0.0


def plan_episode(config: CosimConfig) -> EpisodePlan:
    """Work out an episode from the parameters.

    Raises:
        InputError: A template or suite that does not exist, an external participant with a name that is not allowed, or
            a place of the bag or of the export that is taken or cannot be written.
    """
    request = EpisodeRequest.within(config)
    suite = load_suite(config.sensors)
    bag = Path(config.bag) if config.bag else default_bag_path(request)
    check_new_bag(bag)
    has_camera = any(camera.name == EXPORTED_CAMERA for camera in suite.cameras) or _is_paper(config.kitti_layout)
    kitti = default_kitti_path(bag) if config.kitti and suite.lidars and has_camera else None
    if kitti:
        LiveExport(kitti).check()
    no_kitti = _NO_CAMERA if config.kitti and suite.lidars and not has_camera else ""
    if config.detector and not suite.lidars:
        raise InputError("sensors", config.sensors, "a suite with a LiDAR, for the detector")
    nodes = (
        *DEFAULT_PARTICIPANTS,
        *(("kitti_exporter",) if kitti else ()),
        *(("detector",) if config.detector else ()),
    )
    told: dict[str, dict[str, Value]] = {name: {"participants": list(nodes)} for name in ("recorder", *nodes)}
    told["sumo_bridge"].update(asdict(request))
    told["recorder"]["bag"] = str(bag)
    if kitti:
        told["kitti_exporter"] |= {"out": str(kitti), "layout": config.kitti_layout}
    if config.detector:
        told["detector"]["weights"] = config.detector
    predictor = [config.predictor] if config.predictor and config.predictor not in config.external else []
    others = (*_checked_names([*config.external, *predictor]), *((AV_SOURCE,) if config.av else ()))
    told["sensor_sim"]["trails"] = not others and config.realtime_factor == 0.0
    own_steps = plan_length(replace(request, duration_s=0.0))
    return EpisodePlan(nodes, others, plan_length(request), own_steps, bag, kitti, no_kitti, told)


def _is_paper(layout: str) -> bool:
    return Layout(layout) is Layout.PAPER


def _checked_names(names: list[str]) -> tuple[str, ...]:
    taken = {*DEFAULT_PARTICIPANTS, *OPTIONAL_PARTICIPANTS, AV_SOURCE}
    for name in names:
        if not _NAME.fullmatch(name):
            raise InputError("external", name, "names of at most 64 letters, digits and underscores")
        if name in taken:
            raise InputError("external", name, "names that no other participant of the episode has")
        taken.add(name)
    return tuple(names)
