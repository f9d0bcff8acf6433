"""Runs an episode whose AV a ROS program drives: ``cosim`` and the program as children in their own DDS domain."""

import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import fields
from pathlib import Path
from typing import Final

from siren_ros.base.params.folders import params_dir
from siren_ros.base.processes.interrupts import ENDS_S, end_program
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.conversions import from_episode_description, from_episode_outcome
from siren_ros.data.recording.bag_reader import open_bag
from siren_ros.data.recording.bag_writer import BagSummary
from siren_ros.errors import EXIT_BAD_INPUT, EXIT_OK, EpisodeError, InputError, shown_text
from siren_ros.running.generation.closed_loop import AnswerTimes, RecordedEpisode
from siren_ros.simulation.scenario.episode import EpisodeRequest

_DOMAIN: Final = "ROS_DOMAIN_ID"
_DOMAINS: Final = 100
"""Number of domains, from 1 on; the default domain is left to users."""
_TRIES: Final = 5
_LOOK_S: Final = 0.25
"""Wall time between checks of the programs."""
TOLD_S: Final = 12.0
"""Wall time in which ``cosim`` reports that its driver is gone."""
LIMIT_S: Final = 1800.0
"""Wall time after which an episode's programs are killed."""
_WATCH: Final = """
import os, signal, sys, time
groups = sys.stdin.read().split()
for number, wait_s in ((signal.SIGCONT, 0.0), (signal.SIGTERM, {ends_s}), (signal.SIGKILL, 0.0)):
    for group in map(int, groups):
        try:
            os.killpg(group, number)
        except ProcessLookupError:
            pass
    time.sleep(wait_s)
"""
"""Source of a program that reads groups of processes and ends them when its input ends, which happens when the process
at the other end of the pipe is killed. Users' programs cannot watch that process themselves."""
_SAID: Final = 300
"""Number of letters of a program's last output in messages."""


def episode_with_program(
    request: EpisodeRequest, bag: Path, program: str, *, real_time: bool = False, limit_s: float = LIMIT_S
) -> RecordedEpisode:
    """Run an episode with ``cosim`` and the program that drives its AV.

    Args:
        request: The episode, with an AV.
        bag: Folder of the bag to write.
        program: Command line of the program; it finds the episode by ``ROS_DOMAIN_ID``.
        real_time: Whether a step takes as long as it simulates.
        limit_s: Wall time after which both are killed.

    Raises:
        InputError: The program cannot be started, or ``cosim`` refuses the request.
        EpisodeError: The program hangs, ends, or answers what cannot be used; says which, and its last words.
    """
    first = os.getpid() % _DOMAINS
    for number in range(_TRIES):
        domain = 1 + (first + 17 * number) % _DOMAINS
        code, said, last, answers = _run(request, bag, program, domain, real_time=real_time, limit_s=limit_s)
        if code != EXIT_BAD_INPUT or _DOMAIN not in said:
            break
    if code == EXIT_BAD_INPUT:
        raise InputError("request", said, "an episode that cosim can run")
    if code != EXIT_OK:
        raise EpisodeError(said + (f" (the program: {last})" if last else ""))
    wanted = (topics.EPISODE.name, topics.OUTCOME.name)
    with open_bag(bag) as opened:  # the rest of the bag is not read
        told = {message.topic: message.read() for message in opened.messages(wanted)}
    if len(told) < len(wanted):
        raise EpisodeError("the bag has no outcome")
    described, outcome = from_episode_description(told[wanted[0]]), from_episode_outcome(told[wanted[1]])
    size = sum(file.stat().st_size for file in bag.iterdir())
    return RecordedEpisode(described, outcome, BagSummary(bag, size, {}), answers)


def _run(
    request: EpisodeRequest, bag: Path, program: str, domain: int, *, real_time: bool, limit_s: float
) -> tuple[int, str, str, AnswerTimes | None]:
    """Exit code of ``cosim``, its error, the program's last output if it failed, and its answer times."""
    named = {field.name: getattr(request, field.name) for field in fields(request)}
    asked: Mapping[str, object] = {
        **named,
        "bag": str(bag),
        **({"realtime_factor": 1.0} if real_time else {}),
    }
    flags = [part for name, value in asked.items() if value != "" for part in ("-p", f"{name}:={value}")]
    environment = {
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(params_dir() / "fastdds_localhost.xml"),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        **os.environ,
        _DOMAIN: str(domain),
    }
    cosim_words = [sys.executable, "-m", "siren_nodes.cosim", "--ros-args", *flags]
    with ExitStack() as stack:
        words, driver_words = (
            stack.enter_context(tempfile.TemporaryFile("w+", encoding="utf-8", errors="backslashreplace"))
            for _ in range(2)
        )
        watch = stack.enter_context(_watch())
        cosim = _child(cosim_words, environment, words)
        watch(cosim)
        stack.callback(end_program, cosim)
        try:
            driver = _child(shlex.split(program), environment, driver_words)
        except (OSError, ValueError, IndexError) as error:
            raise InputError("av", program, f"the command line of a program ({error})") from error
        watch(driver)
        stack.callback(end_program, driver)
        code = wait_for_episode(cosim, driver, limit_s)
        ended = driver.poll()
        last = f"exit code {ended}: {' '.join(lines_of(driver_words)[-1:])}"[:_SAID] if ended else ""
        if code is None:
            return 1, "the program ended before the episode" if ended else f"not done after {limit_s:g} s", last, None
        lines = lines_of(words)
        said = [line.removeprefix("cosim: ") for line in lines if line.startswith("cosim: ")]
        told = [line for line in said if not line.startswith(("waiting for ", "lower DDS"))]
        reason = told[-1] if told else " ".join(lines[-1:])
        return code, reason[:_SAID], last, AnswerTimes.in_lines(lines)


def wait_for_episode(cosim: "subprocess.Popen[str]", driver: "subprocess.Popen[str]", limit_s: float) -> int | None:
    """Wait for an episode whose AV another program drives, and return the exit code of its ``cosim``.

    None if it is not done after the wall time ``limit_s``, or ``TOLD_S`` after its driver has failed; then both run on.
    """
    left_s = limit_s
    while left_s > 0.0:
        with suppress(subprocess.TimeoutExpired):
            return cosim.wait(min(_LOOK_S, left_s))
        left_s -= _LOOK_S
        if driver.poll():
            left_s = min(left_s, TOLD_S)
    return None


def _child(words: list[str], environment: Mapping[str, str], output: object) -> "subprocess.Popen[str]":
    return subprocess.Popen(  # noqa: S603 - the user's own program, no shell
        words,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=output,  # type: ignore[call-overload] # a file
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


@contextmanager
def _watch() -> Iterator[Callable[["subprocess.Popen[str]"], None]]:
    """Gives the function by which a program and its children end soon after this process, however it ends."""
    words = [sys.executable, "-I", "-S", "-c", _WATCH.format(ends_s=ENDS_S)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, start_new_session=True) as watch:  # noqa: S603 - our own

        def add(program: "subprocess.Popen[str]") -> None:
            if watch.stdin is not None:
                watch.stdin.write(f"{program.pid}\n".encode())
                watch.stdin.flush()

        try:
            yield add
        finally:
            watch.kill()


def lines_of(file: object) -> list[str]:
    """The lines that a program has written into a file, without empty ones, as a terminal can show them."""
    file.seek(0)  # type: ignore[attr-defined] # a file
    return [shown_text(line) for line in file.read().splitlines() if line.strip()]  # type: ignore[attr-defined] # a file
