"""Plans an episode from the parameters of ``cosim`` (participants, files, nodes) and starts its nodes.

The nodes run in this process or in one process each.
"""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from rclpy.parameter import Parameter

from siren_ros.base.params.parameters import Value
from siren_ros.data.datasets.files import LiveExport
from siren_ros.data.lockstep import LockstepConfig
from siren_ros.data.recording.bag_folder import check_new_bag, default_kitti_path
from siren_ros.errors import InputError, SirenError
from siren_ros.running.generation.episode_setup import default_bag_path, plan_length
from siren_ros.running.ros.node_configs import DEFAULT_PARTICIPANTS, OPTIONAL_PARTICIPANTS, CosimConfig
from siren_ros.running.ros.participants.watchdog import Work, overdue, working_s
from siren_ros.running.ros.programs.program import PARENT_VARIABLE
from siren_ros.sensing.suite import EXPORTED_CAMERA, load_suite
from siren_ros.simulation.scenario.episode import EpisodeRequest, KittiLayout
from siren_ros.simulation.world.commands import AV_SOURCE

TERMINATE_S = 1.0
FLUSH_S = 1.0
"""Longest delay of an episode's end by a subscriber that hangs."""
Overrides = Mapping[str, Value]


NodeType = Callable[..., Any]
"""Makes a node, like the class of a participant: ``make(name, parameter_overrides=...)``."""


class Composition:
    """Base of compositions: participants that run somewhere.

    Defaults are answers for events that cannot occur there.
    """

    def failure(self) -> str:
        """Error outside the lockstep's reports, with the participant's name; empty if there is none."""
        return ""

    def gone(self) -> tuple[str, ...]:
        """Participants that no longer answer."""
        return ()

    def closed(self) -> tuple[str, ...]:
        """Participants that have closed normally."""
        raise NotImplementedError

    def hanging(self, config: LockstepConfig) -> str:
        """Text about a participant that blocks the lockstep itself; empty if there is none."""
        return overdue(self.works(), config, working_s())

    def works(self) -> tuple[Work | None, ...]:
        """Current activities of the participants in this process."""
        return ()

    def exit_code(self) -> int:
        """Exit code of a participant that refused its input, otherwise 0."""
        return 0

    def stop(self, timeout_s: float, late: Collection[str] = ()) -> None:
        """Wait for the participants to finish, and end the others.

        Args:
            timeout_s: For all of them together.
            late: Participants that get no more time.
        """
        raise NotImplementedError


class InProcess(Composition):
    """All participants as nodes of this process on one executor. Bad input raises in the constructor."""

    def __init__(self, executor: Any, node_types: Mapping[str, NodeType], overrides: Mapping[str, Overrides]) -> None:
        """Make the nodes.

        Args:
            executor: Runs their callbacks.
            node_types: What makes the node of each name.
            overrides: The participants and their parameters, in the order in which they are made.

        Raises:
            SirenError: A node refuses its parameters; the others are discarded.
        """
        self.nodes: list[Any] = []
        self._executor = executor
        try:
            for name, values in overrides.items():
                parameters = [Parameter(key, value=value) for key, value in values.items()]
                self.nodes.append(node_types[name](name, parameter_overrides=parameters))
                executor.add_node(self.nodes[-1])
        except SirenError:
            for node in self.nodes:
                node.discard()
            raise

    def closed(self) -> tuple[str, ...]:
        """Nodes that have finished."""
        return tuple(node.get_name() for node in self.nodes if node.finished)

    def works(self) -> tuple[Work | None, ...]:
        """For each node the callback that has not returned yet."""
        return tuple(node.work for node in tuple(self.nodes))

    def stop(self, timeout_s: float, late: Collection[str] = ()) -> None:  # noqa: ARG002 - of all compositions
        """Let published messages reach outside subscribers, then destroy the nodes."""
        deadline_s = time.monotonic() + min(timeout_s, FLUSH_S)
        for node in self.nodes:
            node.flush(max(0.0, deadline_s - time.monotonic()))
            self._executor.remove_node(node)
            node.destroy_node()
        self.nodes.clear()


class OutOfProcess(Composition):
    """Each participant in its own process and process group, so that Ctrl-C reaches only this process."""

    def __init__(self, modules: Mapping[str, str], overrides: Mapping[str, Overrides], ros_args: list[str]) -> None:
        """Start the processes.

        Args:
            modules: The module that runs each node as a program.
            overrides: The participants and their parameters.
            ros_args: This program's own arguments after ``--ros-args``; every participant gets them too.
        """
        environment = {**os.environ, PARENT_VARIABLE: str(os.getpid())}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        for name, values in overrides.items():
            arguments = [f"{key}:={json.dumps(value)}" for key, value in values.items()]
            flags = [part for argument in arguments for part in ("-p", argument)]
            command = [sys.executable, "-m", modules[name], "--ros-args", *ros_args, *flags]
            self._processes[name] = subprocess.Popen(  # noqa: S603 - our own modules, no shell
                command, env=environment, stdin=subprocess.DEVNULL, start_new_session=True
            )

    def failure(self) -> str:
        """Text about a process that ended too early; empty if there is none."""
        for name in self.gone():
            code = int(self._processes[name].returncode)
            how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
            return f"{name}: its process ended early ({how})"
        return ""

    def gone(self) -> tuple[str, ...]:
        """Participants whose processes ended with an error."""
        return tuple(name for name, process in self._processes.items() if process.poll())

    def closed(self) -> tuple[str, ...]:
        """Participants whose processes ended without an error."""
        return tuple(name for name, process in self._processes.items() if process.poll() == 0)

    def exit_code(self) -> int:
        """First non-zero exit code of a process that ended by itself."""
        codes = (process.poll() for process in self._processes.values())
        return next((code for code in codes if code is not None and code > 0), 0)

    def stop(self, timeout_s: float, late: Collection[str] = ()) -> None:
        """Wait for the processes, then terminate and finally kill the remaining ones."""
        _wait([process for name, process in self._processes.items() if name not in late], timeout_s)
        for send in (subprocess.Popen.terminate, subprocess.Popen.kill):
            running = [process for process in self._processes.values() if process.poll() is None]
            for process in running:
                send(process)
            _wait(running, TERMINATE_S)


def _wait(processes: "list[subprocess.Popen[bytes]]", timeout_s: float) -> None:
    deadline_s = time.monotonic() + timeout_s
    for process in processes:
        with suppress(subprocess.TimeoutExpired):
            process.wait(max(0.0, deadline_s - time.monotonic()))


TRAILING: Final = frozenset({"sensor_sim", "recorder", *OPTIONAL_PARTICIPANTS})
"""Participants that may still work on a step while the next one runs, if no other program takes part: in their own
processes, or in threads that cast rays and draw."""
SETTLE_S: Final = 0.25
"""Additional time for participants in other programs; discovery on one machine takes 0.05 s."""
_NO_CAMERA: Final = (
    f"the suite has no {EXPORTED_CAMERA}; `-p sensors:=front` has one, `-p kitti_layout:=paper` needs none, and "
    "`-p kitti:=false` asks for no export"
)
_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,63}")


@dataclass(frozen=True)
class EpisodePlan:
    """Plan of one episode, before its nodes exist."""

    nodes: tuple[str, ...]
    """Participants that this program starts."""
    others: tuple[str, ...]
    """Participants that other programs start; the lockstep waits for them."""
    steps: int
    own_steps: int
    """Number of steps of the template, without ``duration_s``."""
    bag: Path
    kitti: Path | None
    """Folder of the KITTI export; None if there is none."""
    no_kitti: str
    """What the suite lacks for a requested KITTI export, and which parameter helps; empty if nothing."""
    overrides: Mapping[str, Overrides]
    """Parameters of each node. The recorder comes first, because an existing bag must end the episode early."""

    def file_of(self, name: str) -> str:
        """The file of a participant's node: its name, unless a CARLA server senses."""
        return "carla_bridge" if self.overrides[name].get("carla") else name

    def lockstep(self, config: CosimConfig) -> LockstepConfig:
        """Participants and time limits of the lockstep."""
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
        """Whether ``duration_s`` ends the episode before its template does."""
        return self.steps < self.own_steps

    @property
    def settle_s(self) -> float:
        """Time for discovery before the first step, if other programs take part."""
        return SETTLE_S if self.others else 0.0


def plan_episode(config: CosimConfig) -> EpisodePlan:
    """Plan an episode from the parameters.

    Raises:
        InputError: A template or suite that does not exist, an external participant with a name that is not allowed, or
            a place of the bag or of the export that is taken or cannot be written.
    """
    request = EpisodeRequest.within(config)
    suite = load_suite(config.sensors)
    bag = Path(config.bag) if config.bag else default_bag_path(request)
    check_new_bag(bag, overwrite=config.overwrite)
    has_camera = (
        any(camera.name == EXPORTED_CAMERA for camera in suite.cameras)
        or KittiLayout(config.kitti_layout) is KittiLayout.PAPER
    )
    kitti = default_kitti_path(bag) if config.kitti and suite.lidars and has_camera else None
    if kitti:
        LiveExport(kitti, overwrite=config.overwrite).check()
    no_kitti = _NO_CAMERA if config.kitti and suite.lidars and not has_camera else ""
    if config.detector and not suite.lidars:
        raise InputError("sensors", config.sensors, "a suite with a LiDAR, for the detector")
    nodes = (
        *DEFAULT_PARTICIPANTS,
        *(("kitti_exporter",) if kitti else ()),
        *(("detector",) if config.detector else ()),
    )
    overrides: dict[str, dict[str, Value]] = {name: {"participants": list(nodes)} for name in ("recorder", *nodes)}
    overrides["sumo_bridge"].update(asdict(request))
    overrides["recorder"] |= {"bag": str(bag), "overwrite": config.overwrite}
    if kitti:
        overrides["kitti_exporter"] |= {
            "out": str(kitti),
            "layout": config.kitti_layout,
            "overwrite": config.overwrite,
        }
    if config.detector:
        overrides["detector"]["weights"] = config.detector
    predictor = [config.predictor] if config.predictor and config.predictor not in config.external else []
    others = (*_checked_names([*config.external, *predictor]), *((AV_SOURCE,) if config.av else ()))
    overrides["sensor_sim"] |= {"trails": not others and config.realtime_factor == 0.0 and not config.carla}
    overrides["sensor_sim"] |= {"carla": config.carla} if config.carla else {}
    own_steps = plan_length(replace(request, duration_s=0.0))
    return EpisodePlan(nodes, others, plan_length(request), own_steps, bag, kitti, no_kitti, overrides)


def _checked_names(names: list[str]) -> tuple[str, ...]:
    taken = {*DEFAULT_PARTICIPANTS, *OPTIONAL_PARTICIPANTS, AV_SOURCE}
    for name in names:
        if not _NAME.fullmatch(name):
            raise InputError("external", name, "names of at most 64 letters, digits and underscores")
        if name in taken:
            raise InputError("external", name, "names that no other participant of the episode has")
        taken.add(name)
    return tuple(names)
