"""A node's program as a process, without ROS, so that help and refusals come before rclpy starts.

* Its command line: help, error messages, and quoting of texts that YAML would change.
* Ctrl-C, SIGTERM or a closed terminal: the first asks for an orderly end, one that comes later forces it.
* A participant's process ends when the program that started it is gone.
* A program says what it waits for where nothing else has been said for a while.
"""

import json
import os
import re
import shlex
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields
from functools import partial
from itertools import pairwise
from pathlib import Path
from textwrap import fill
from typing import Any, Final, NamedTuple, Self, TextIO

from siren_ros.base.params.parameters import allowed_text, defaults_of
from siren_ros.base.processes.interrupts import signal_at_end_of_parent
from siren_ros.errors import EXIT_BAD_INPUT, EXIT_OK, InputError, SirenError

_BEGIN: Final = "--ros-args"
_END: Final = "--"
_HELP: Final = frozenset({"-h", "--help"})
_FLAGS: Final = ("-p", "--param")
_SETTING: Final = re.compile(r"(?:--)?([A-Za-z_][\w-]*):?=(.*)", re.DOTALL)
_STRUCTURE: Final = re.compile(r"(?![\[{\"']).*(:(\s|$)|\s#)", re.DOTALL)
"""Matches an unquoted text that YAML reads as a mapping, or as a text with a comment."""
_WIDTH: Final = 100


def quoted(arguments: Sequence[str]) -> list[str]:
    """Quote parameters so that they reach the node as typed: ``bag:=a: b`` is a text.

    >>> quoted(["cosim", "--ros-args", "-p", "bag:=a: b", "-p", "seed:=3"])
    ['cosim', '--ros-args', '-p', 'bag:="a: b"', '-p', 'seed:=3']
    """
    return [
        f"{name}:={json.dumps(value)}" if before in _FLAGS and _STRUCTURE.match(value) else argument
        for before, argument in pairwise(("", *arguments))
        for name, _, value in [argument.partition(":=")]
    ]


def outside_ros(arguments: Iterable[str]) -> tuple[str, ...]:
    """Arguments for the program itself, which are not between ``--ros-args`` and ``--``.

    >>> outside_ros(["seed:=1", "--ros-args", "-p", "seed:=3", "--", "--help"])
    ('seed:=1', '--help')
    """
    ours: list[str] = []
    of_ros = False
    for argument in arguments:
        if of_ros:
            of_ros = argument != _END
        elif argument == _BEGIN:
            of_ros = True
        else:
            ours.append(argument)
    return tuple(ours)


def answer(words: Sequence[str], name: str, config_type: Callable[[], Any], summary: str) -> int:
    """Print the help, or an error about arguments that are not for ROS; returns the exit code.

    Args:
        words: The arguments, at least one.
        name: Name of the program.
        config_type: The dataclass of its parameters.
        summary: What the program does.
    """
    if _HELP.intersection(words):
        try:
            print(help_text(called(name), config_type, summary), flush=True)
        except BrokenPipeError:  # the program that read the output has ended, as with `| head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_OK
    known = {field.name for field in fields(config_type())}
    print(f"{name}: {InputError('arguments', ' '.join(words), _allowed(words, known))}", file=sys.stderr)
    return EXIT_BAD_INPUT


def called(name: str) -> str:
    """Command that starts a program: pip installs it under its own name."""
    script = Path(sys.argv[0]).name
    return script if script.startswith("siren-") else f"ros2 run siren_ros {name}"


def help_text(command: str, config_type: Callable[[], Any], summary: str) -> str:
    """Help of a program: each parameter with its default, meaning and allowed values."""
    config = config_type()
    defaults = defaults_of(type(config))
    lines = [f"usage: {command} [--ros-args [-p NAME:=VALUE]... [--params-file FILE]]", ""]
    lines += [fill(summary, _WIDTH), "", "parameters, with their defaults:"]
    for field in fields(config):
        default = defaults[field.name]
        limited = field.metadata["choices"] or field.metadata["minimum"] is not None
        accepted = f" ({allowed_text(field, type(default))})" if limited else ""
        lines.append(f"  {field.name}:={json.dumps(default)}")
        text = field.metadata["description"] + accepted
        lines.append(fill(text, _WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6))
    return "\n".join(lines)


def _allowed(words: Sequence[str], known: set[str]) -> str:
    meant = [f"-p {shlex.quote(setting)}" for setting in _settings(words, known)]
    asked = f"; did you mean `{_BEGIN} {' '.join(meant)}`?" if meant else "; --help prints the parameters"
    return f"parameters behind {_BEGIN}, as -p NAME:=VALUE{asked}"


def _settings(words: Sequence[str], known: set[str]) -> Iterator[str]:
    for word in words:
        setting = _SETTING.fullmatch(word)
        name = setting[1].replace("-", "_") if setting else ""
        if setting and name in known:
            yield f"{name}:={setting[2]}"


SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SAME_S: Final = 1.0
"""Signals within this time of the first count as one: repeated Ctrl-C, or a shell that forwards it."""
_OUTPUTS: Final = (1, 2)


class PreparationInterruptedError(SirenError):
    """Raised by a signal during preparation, when there is no step at which the program could end."""


class Interrupt:
    """Remembers the first signal, so that a loop can end properly; its truth value tells whether one came."""

    def __init__(self, program: str) -> None:
        """Start to handle signals; an ignored SIGHUP stays ignored (``nohup``).

        Args:
            program: Name in the line that a forced end prints.
        """
        self.signal_name = ""
        self._program = program
        self._since_s = 0.0
        self._at_once = False
        for number in SIGNALS:
            if number is not signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._take)

    @contextmanager
    def ending_at_once(self) -> Iterator[None]:
        """Context in which a signal raises at once, even one that came before: a map may take minutes to compile.

        Raises:
            PreparationInterruptedError: A signal came.
        """
        self._at_once = True
        try:
            if self.signal_name:
                raise self._early()
            yield
        finally:
            self._at_once = False

    def _take(self, number: int, _frame: object) -> None:
        now_s = time.monotonic()
        if number == signal.SIGHUP:
            _leave_terminal()
        if not self.signal_name:
            self.signal_name, self._since_s = signal.Signals(number).name, now_s
            if self._at_once:
                raise self._early()
        elif now_s - self._since_s > SAME_S:
            line = f"{self._program}: ended at once by a second signal; `siren recover` completes a bag\n"
            os.write(_OUTPUTS[-1], line.encode())
            signal.signal(number, signal.SIG_DFL)  # the kernel then ends this process at any point
            os.kill(os.getpid(), number)

    def _early(self) -> SirenError:
        return PreparationInterruptedError(f"stopped by {self.signal_name}")

    def __bool__(self) -> bool:
        return bool(self.signal_name)


def _leave_terminal() -> None:
    """Discard further output, except to files, because writes to a closed terminal or pipe are errors."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    for output in _OUTPUTS:
        if not stat.S_ISREG(os.fstat(output).st_mode):
            os.dup2(nothing, output)
    os.close(nothing)


PARENT_CHECK_S: Final = 0.5
CLOSE_S: Final = 10.0
"""Time in which a running participant closes everything."""


class Parent:
    """The process that started this one."""

    def __init__(self, number: int) -> None:
        """Prepare for the parent's end, in any form.

        A stopped process (SIGSTOP) would not notice it, so the kernel continues it then. If a node does not return
        from a callback, a thread kills the process after ``CLOSE_S``.

        Args:
            number: Process id of the parent; 0: this process does not depend on one.
        """
        self._number = number
        if not self._number:
            return
        signal_at_end_of_parent(signal.SIGCONT)
        threading.Thread(target=self._watch, name="parent watch", daemon=True).start()

    @property
    def is_gone(self) -> bool:
        """Whether there was a parent and it has ended."""
        return bool(self._number) and os.getppid() != self._number

    def _watch(self) -> None:
        while not self.is_gone:
            time.sleep(PARENT_CHECK_S)
        time.sleep(CLOSE_S)
        os.kill(os.getpid(), signal.SIGKILL)


LOOK_S: Final = 0.25
FIRST_S: Final = 3.0
"""Time without messages at the start, because most waits are over by then."""
AGAIN_S: Final = 5.0
"""Least time between two lines. It doubles with each repeated line."""


class Awaited(NamedTuple):
    """What a program is waiting for."""

    what: str
    """Text about the wait; if empty, nothing is printed."""
    progress: Hashable = None
    """A changed value shows that the program makes progress; the silence then starts again."""
    note: str = ""
    """Additional text."""


class Silence(NamedTuple):
    """How long a program has been waiting, and what was printed about it."""

    awaited: Awaited
    since_s: float
    """Time at which this wait began."""
    other_s: float
    """Earliest time for a line that differs from the last one."""
    same_s: float
    """Earliest time to repeat the last line."""
    said: str = ""
    pause_s: float = AGAIN_S


def begin_silence(awaited: Awaited, now_s: float) -> Silence:
    """State before anything was printed."""
    return Silence(awaited, now_s, now_s + FIRST_S, now_s + FIRST_S)


def keep_silence(silence: Silence, awaited: Awaited, now_s: float) -> tuple[Silence, str]:
    """New state of the silence, and a line that is due; empty if none is.

    Args:
        silence: What was before.
        awaited: What is waited for now.
        now_s: Wall time.
    """
    if not awaited.what or awaited.progress != silence.awaited.progress:
        return begin_silence(awaited, now_s), ""
    if awaited.what != silence.awaited.what:
        silence = silence._replace(since_s=now_s)
    silence = silence._replace(awaited=awaited)
    same = awaited.what == silence.said
    if now_s < (silence.same_s if same else silence.other_s):
        return silence, ""
    pause_s = 2.0 * silence.pause_s if same else AGAIN_S
    so_far_s = round(now_s - silence.since_s)
    more = [*([f"{so_far_s} s so far"] if so_far_s else []), *([awaited.note] if awaited.note else [])]
    line = f"waiting for {awaited.what}" + (f" ({'; '.join(more)})" if more else "")
    silence = silence._replace(said=awaited.what, pause_s=pause_s)
    return silence._replace(other_s=now_s + AGAIN_S, same_s=now_s + pause_s), line


class Waiting:
    """A thread that checks every 0.25 s what a program waits for. It starts before modules are loaded."""

    def __init__(self, program: str, what: str, stream: TextIO | None = None) -> None:
        """Start the thread.

        Args:
            program: Name that begins each line.
            what: What is waited for first.
            stream: Gets the lines; by default standard error.
        """
        self._program = program
        self.ask: Callable[[], Awaited] = lambda: Awaited(what)
        self.say: Callable[[str], None] = partial(print, file=stream or sys.stderr, flush=True)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="waiting", daemon=True)
        self._thread.start()

    def expect(self, what: str) -> None:
        """Set what the program waits for."""
        self.ask = lambda: Awaited(what)

    def _run(self) -> None:
        silence = begin_silence(self.ask(), time.monotonic())
        while not self._stopped.wait(LOOK_S):
            silence, line = keep_silence(silence, self.ask(), time.monotonic())
            if line:
                with suppress(OSError, ValueError):  # the terminal is closed
                    self.say(f"{self._program}: {line}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join(LOOK_S)
