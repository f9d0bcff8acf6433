"""``cosim``: one whole episode. Starts the nodes, drives the lockstep, tells the user how it goes."""

import sys
import time
from dataclasses import asdict, fields
from pathlib import Path

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node

from siren_ros.generation.episode_setup import EpisodeRequest, default_bag_path, plan_length
from siren_ros.interfaces import topics
from siren_ros.interfaces.conversions import from_actor_states, from_episode_outcome
from siren_ros.interfaces.lockstep import LockstepConfig
from siren_ros.ros import wire
from siren_ros.ros.composition import Composition, InProcess, OutOfProcess, Overrides
from siren_ros.ros.endpoints import create_input
from siren_ros.ros.master import LockstepMaster
from siren_ros.ros.node_configs import DEFAULT_PARTICIPANTS, CosimConfig
from siren_ros.ros.parameter_overrides import check_names
from siren_ros.ros.parameters import declare_config
from siren_ros.ros.program import Interrupt, start_ros
from siren_ros.ros.progress import Progress
from siren_ros.ros.summary import closing_summary
from siren_ros.sensors.suite import load_suite
from siren_ros.world.episode import EpisodeEnd, EpisodeOutcome
from siren_ros.world.errors import EXIT_FAILED, EXIT_OK, SirenError

SPIN_S = 0.05
STOP_S = 10.0
FIRST_EMV = 1
"""Emergency vehicles have the first actor ids."""
SCENARIO_FIELDS = ("template", "level", "seed", "map", "duration_s", "preset", "sensors")


class Cosim(Node):
    """The master of one episode; the participants run in this process or in their own."""

    def __init__(self) -> None:
        super().__init__("cosim")
        self.began_s = time.monotonic()
        check_names(self._parameter_overrides, [field.name for field in fields(CosimConfig)])
        self.config = declare_config(self, CosimConfig)
        request = EpisodeRequest(**{name: getattr(self.config, name) for name in SCENARIO_FIELDS})
        suite = load_suite(self.config.sensors)
        self.bag = Path(self.config.bag) if self.config.bag else default_bag_path(request)
        self.steps = plan_length(request)
        self.kitti_folder = Path(f"{self.bag}_kitti") if self.config.kitti and suite.lidars else None
        self.outcome: EpisodeOutcome | None = None
        self.progress = Progress(self.steps)
        names = (*DEFAULT_PARTICIPANTS, *(("kitti_exporter",) if self.kitti_folder else ()))
        lockstep = LockstepConfig(names, self.steps, step_timeout_s=self.config.step_timeout_s)
        self.master = LockstepMaster(self, lockstep, self.config.realtime_factor)
        self.master.on_step_begun = self.progress.begin_step
        create_input(self, topics.OUTCOME, self._on_outcome)
        create_input(self, topics.ACTORS, self._on_actors)

    def overrides(self) -> dict[str, Overrides]:
        """What each participant is told; the recorder first, since a bag that exists ends everything early."""
        participants = list(self.master.config.participants)
        told: dict[str, Overrides] = {name: {"participants": participants} for name in ["recorder", *participants]}
        values = asdict(self.config)
        told["sumo_bridge"] = {**told["sumo_bridge"], **{name: values[name] for name in SCENARIO_FIELDS}}
        told["recorder"] = {**told["recorder"], "bag": str(self.bag)}
        if self.kitti_folder:
            told["kitti_exporter"] = {**told["kitti_exporter"], "out": str(self.kitti_folder)}
        return told

    def _on_actors(self, cdr: bytes) -> None:
        if self.progress.wants_states(self.master.state.step):
            self.progress.show_states(from_actor_states(wire.decode(topics.ACTORS, cdr)), FIRST_EMV)

    def _on_outcome(self, cdr: bytes) -> None:
        self.outcome = from_episode_outcome(wire.decode(topics.OUTCOME, cdr))


def run_episode(cosim: Cosim, interrupt: Interrupt) -> int:
    """Run the episode of a master to its end; returns the program's exit code."""
    executor = EventsExecutor()
    executor.add_node(cosim)
    overrides = cosim.overrides()
    ros_args = sys.argv[sys.argv.index("--ros-args") + 1 :] if "--ros-args" in sys.argv else []
    composition: Composition = (
        OutOfProcess(overrides, ros_args) if cosim.config.processes else InProcess(executor, overrides)
    )
    try:
        while not cosim.master.closed:
            executor.spin_once(timeout_sec=SPIN_S)
            if interrupt:
                cosim.master.interrupt(f"stopped by {interrupt.signal_name}")
            if failure := composition.failure():
                cosim.master.fail(failure)
    finally:
        cosim.progress.close()
        composition.stop(STOP_S)
        executor.shutdown()
    state = cosim.master.state
    print("\n".join(closing_summary(cosim.bag, cosim.kitti_folder, state, cosim.outcome, cosim.progress.wall_s)))
    refused = composition.exit_code()
    if state.end is EpisodeEnd.COMPLETE:
        return EXIT_OK
    return refused or EXIT_FAILED


def main() -> int:
    """Run one episode as the parameters say."""
    start_ros()
    interrupt = Interrupt()
    try:
        return run_episode(Cosim(), interrupt)
    except SirenError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return EXIT_FAILED
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
