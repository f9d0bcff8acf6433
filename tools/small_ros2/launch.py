"""``ros2 launch PACKAGE FILE`` and ``ros2 launch PATH``, for Python launch files that start nodes."""

import argparse
import signal
import subprocess
import sys
import time
from pathlib import Path

from small_ros2.errors import CommandError
from small_ros2.index import executable, prefix_of
from small_ros2.launch_files import Declared, Started, read_launch_file

POLL_S = 0.05
STOP_S = 10.0
"""Time for the other nodes to end after one whose end ends the launch; then they are killed."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("package", metavar="PACKAGE|PATH", help="name of the package, or path of a launch file")
    parser.add_argument("file", nargs="?", help="name of the launch file in the package")
    parser.add_argument("arguments", nargs="*", metavar="NAME:=VALUE", help="arguments of the launch file")
    parser.add_argument("--show-args", "-s", action="store_true", help="print the arguments of the launch file")
    parser.set_defaults(main=launch)


def launch_file(package: str, name: str | None) -> Path:
    """The file that the first words of the call name.

    Raises:
        CommandError: There is none.
    """
    if name is None:
        if not Path(package).is_file():
            raise CommandError(f"'{package}' is no launch file; name a package and a file of it, or a path")
        return Path(package)
    folder = prefix_of(package) / "share" / package
    files = sorted(path for path in folder.rglob("*launch*") if path.is_file())
    for path in files:
        if path.name == name:
            return path
    names = ", ".join(path.name for path in files) or "none"
    raise CommandError(f"package '{package}' has no launch file '{name}'; it has: {names}")


def launch(arguments: argparse.Namespace) -> int:
    """Starts the nodes of a launch file and waits for them."""
    words = list(arguments.arguments)
    name = arguments.file
    if name is not None and ":=" in name:
        words, name = [name, *words], None
    values = {}
    for word in words:
        key, sign, value = word.partition(":=")
        if not sign or not key:
            raise CommandError(f"'{word}' is not of the form NAME:=VALUE", exit_code=2)
        values[key] = value
    declared, nodes = read_launch_file(launch_file(arguments.package, name))
    if arguments.show_args:
        return show_arguments(declared)
    values = {**{argument.name: argument.default for argument in declared if argument.default is not None}, **values}
    for argument in declared:
        if argument.name not in values:
            raise CommandError(f"the launch file needs the argument '{argument.name}': {argument.description}", 2)
    return run_nodes(nodes, values)


def show_arguments(declared: list[Declared]) -> int:
    """Prints the arguments with their descriptions and defaults, in the real ros2's layout."""
    print("Arguments (pass arguments as '<name>:=<value>'):")
    for argument in declared:
        default = f"\n        (default: '{argument.default}')" if argument.default is not None else ""
        print(f"\n    '{argument.name}':\n        {argument.description}{default}")
    return 0


def run_nodes(nodes: list[Started], values: dict[str, str]) -> int:
    """Runs nodes until all have ended, or one whose end ends the launch; 1 where one ended with an error.

    Ctrl-C reaches the nodes from the terminal, so this program only waits for them; SIGTERM is passed on.
    """
    commands = [[str(executable(node.package, node.executable)), *node.ros_arguments(values)] for node in nodes]
    sys.stdout.flush()
    running: list[subprocess.Popen[bytes]] = []

    def pass_on(number: int, _frame: object) -> None:
        for process in running:
            process.send_signal(number)

    signal.signal(signal.SIGINT, lambda *_: None)
    signal.signal(signal.SIGTERM, pass_on)
    running += [subprocess.Popen(command) for command in commands]  # noqa: S603 - what the user names is the purpose
    while any(process.poll() is None for process in running):
        if any(node.ends_launch and process.poll() is not None for node, process in zip(nodes, running, strict=True)):
            break
        time.sleep(POLL_S)
    _end([process for process in running if process.poll() is None])
    return int(any(process.returncode for process in running))


def _end(processes: "list[subprocess.Popen[bytes]]") -> None:
    for process in processes:
        process.send_signal(signal.SIGINT)
    deadline_s = time.monotonic() + STOP_S
    for process in processes:
        try:
            process.wait(max(0.0, deadline_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
