"""``cosim``: starts the nodes, drives the lockstep and shows progress.

``siren_ros.running.ros.programs.episode_program`` does this; it takes seconds to load.
"""

import os
import sys
from importlib import import_module

from siren_ros.errors import EXIT_FAILED
from siren_ros.running.ros.programs.processes import Interrupt, Waiting, answer, outside_ros


def give_up(reason: str) -> None:
    """End this process: a node hangs in it, and the executor with the node."""
    print(f"cosim: {reason}; `siren recover` completes the bag", file=sys.stderr, flush=True)
    print(f"exit code {EXIT_FAILED}: the episode failed", flush=True)
    os._exit(EXIT_FAILED)


def main() -> int:
    """Run one episode as the parameters say."""
    if words := outside_ros(sys.argv[1:]):
        config_type = import_module("siren_ros.running.ros.node_configs").CosimConfig
        return answer(words, "cosim", config_type, "Simulates, senses, records and exports one episode.")
    interrupt = Interrupt("cosim")
    with Waiting("cosim", "its libraries to be loaded") as waiting:
        program = import_module("siren_ros.running.ros.programs.episode_program")
        return int(program.run("siren_nodes.{}".format, give_up, interrupt, waiting))


if __name__ == "__main__":
    sys.exit(main())
