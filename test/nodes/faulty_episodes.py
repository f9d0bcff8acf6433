"""Episodes to which something happens: marked, so that whatever they leave behind is found."""

import os
import shutil
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

from live_episodes import Domain, without_waiting
from preloaded_programs import PreloadedProgram

from siren_ros.data.recording.bag_reader import read_episode

TAG = "SIREN_TEST_TAG"
Start = Callable[..., "Episode"]
LOOK_S = 0.04
PATIENCE_S = 80.0
"""Less than the time limit of a step: what is broken is seen as such, not as a step that takes too long."""
FOREVER = (
    *("template:=S2", "duration_s:=600.0", "realtime_factor:=2.0", "kitti:=false", "bag:=bags/bag"),
    "step_timeout_s:=90.0",  # programs of their own compile their loops, all at once, where no test has before
)


class Episode:
    """A running episode with its processes and its bag."""

    def __init__(
        self,
        domain: Domain,
        folder: Path,
        *parameters: str,
        sensors: str = "none",
        prelude: str = "",
        programs: "type[subprocess.Popen[Any]]" = PreloadedProgram,
        **popen: object,
    ) -> None:
        self.folder = folder
        self.domain = domain
        self.tag = uuid.uuid4().hex
        flags = [part for item in (*FOREVER, f"sensors:={sensors}", *parameters) for part in ("-p", item)]
        program = ["-c", f"{prelude}\nimport sys\nfrom siren_nodes.cosim import main\nsys.exit(main())"]
        self._out = folder / "out.txt"
        self._err = folder / "err.txt"
        with self._out.open("w") as out, self._err.open("w") as err:
            self.process = programs(  # type: ignore[call-overload] # further arguments of the test's
                [sys.executable, *program, "--ros-args", *flags],
                env={**domain.environment, TAG: self.tag},
                cwd=folder,
                stdout=out,
                stderr=err,
                **popen,
            )

    @property
    def out(self) -> str:
        return self._out.read_text()

    @property
    def err(self) -> str:
        return self._err.read_text()

    @property
    def bag(self) -> Path:
        return self.folder / "bags" / "bag"

    @property
    def saved_steps(self) -> int:
        """Steps of the record that is left."""
        return read_episode(self.folder / "bags" / "bag.partial").steps

    @property
    def working(self) -> Path:
        return self.folder / "bags" / ".bag.partial"

    @property
    def error(self) -> str:
        """The line on standard error that ``cosim`` has ended with; nothing of Python's is beside it."""
        assert self.process.returncode not in {0, None}
        assert "Traceback" not in self.err
        lines = [line for line in without_waiting(self.err.splitlines()) if line.startswith("cosim: ")]
        assert len(lines) == 1, self.err
        return lines[0]

    def processes(self) -> dict[int, list[str]]:
        """Command lines of all processes that this episode started and that still live, by process id."""
        command_lines = {}
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    marked = f"{TAG}={self.tag}".encode() in (entry / "environ").read_bytes()
                    if marked and "\nState:\tZ" not in (entry / "status").read_text():
                        command_lines[int(entry.name)] = (entry / "cmdline").read_text().split("\0")
                except OSError:
                    continue
        return command_lines

    def process_of(self, node: str) -> int:
        return next(number for number, command in self.processes().items() if f"siren_nodes.{node}" in command)

    def wait_until_recorded(self, size_bytes: int = 150_000) -> None:
        """Until more than a simulated second is on the disk: the map has 50 kB, a second without sensors 60 kB."""
        file = self.working / "bag_0.mcap"
        self._wait(lambda: file.exists() and file.stat().st_size > size_bytes)

    def wait_until_told(self, text: str) -> None:
        """Until a text is on standard error."""
        self._wait(lambda: text in self.err)

    def wait_until_it_catches(self, number: signal.Signals) -> None:
        """Until the program has a handler for a signal, other than Python's own for SIGINT."""
        status = Path(f"/proc/{self.process.pid}/status")

        def caught() -> bool:
            masks = dict(line.split(":", 1) for line in status.read_text().splitlines())
            return bool(int(masks["SigCgt"], 16) >> (number - 1) & 1)

        self._wait(caught)

    def wait_until_gone(self) -> None:
        """Until no process is left."""
        self._wait(lambda: self.process.poll() is not None and not self.processes())

    def _wait(self, condition: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline_s, f"waited too long: {self.out}\n{self.err}\n{self.processes()}"
            time.sleep(LOOK_S)

    def kill_all(self) -> None:
        for number in self.processes():
            try:
                os.kill(number, signal.SIGKILL)
            except ProcessLookupError:
                continue
        self.process.wait()


def next_episode_starts(episode: Episode) -> None:
    """An episode with the same bag name runs from start to end where the last one was interrupted."""
    done = episode.domain.run(
        "template:=S2", "duration_s:=0.1", "sensors:=none", "kitti:=false", "bag:=bags/bag", cwd=episode.folder
    )
    assert done.code == 0, done.err
    assert episode.bag.is_dir()


def in_own_mounts(
    prepare: str, command: list[str], environment: dict[str, str]
) -> "subprocess.CompletedProcess[str] | None":
    """Runs a program in a mount namespace of its own; None where the right to prepare one is missing.

    Args:
        prepare: Shell line that mounts what the program is to find.
        command: The program.
        environment: Its variables.
    """
    unshare = shutil.which("unshare")
    if unshare is None:
        return None
    words = [unshare, "--mount", "sh", "-c", f'{prepare} && exec "$@"', "sh"]
    if subprocess.run([*words, "true"], check=False, capture_output=True).returncode:
        return None
    return subprocess.run([*words, *command], env=environment, check=False, capture_output=True, text=True)


def mounted(folder: Path, size: str) -> bool:
    """Whether a small disk of its own could be mounted there."""
    program = shutil.which("mount")
    if program is None:
        return False
    command = [program, "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    return subprocess.run(command, check=False, capture_output=True).returncode == 0
