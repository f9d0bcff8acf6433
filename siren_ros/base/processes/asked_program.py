"""Asks a program of somebody else, one line after the other, within limits of time, memory and files.

It gets the next line only when it has answered the last one. Its group of processes ends with it; one that leaves the
group has its processor time and no more. Limits are those of its processes (``setrlimit(2)``), or of a container where
one is asked for. A container hides other files from it; so does Linux's Landlock where the kernel has it.
"""

import ctypes
import os
import selectors
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from siren_ros.base.processes.interrupts import end_program
from siren_ros.errors import InputError, shown_text

ANSWER_S: Final = 10.0
"""Wall time for an answer, unless the caller sets another limit."""
MEMORY_MB: Final = 4096
"""Memory of each process, unless the caller sets another limit."""
LINE_BYTES: Final = 64 * 2**20
"""Longest answer."""
_FILE_BYTES: Final = 2**30
"""Largest file that the program may write."""
_PROCESSES: Final = 256
"""Most processes in a container."""
_CHUNK: Final = 2**16
_SAID: Final = 300
"""Characters of a program's last words in messages."""
_SYSTEM: Final = "/usr:/lib:/lib64:/bin:/etc:/opt:/proc/cpuinfo:/proc/meminfo:/sys/devices/system"
"""What programs may read besides their own folders: the system's programs and libraries."""
_LANDLOCK: Final = 444
"""Number of ``landlock_create_ruleset(2)``, the same on all machines; the two other calls follow."""
_ASK_VERSION: Final = 1
_WITH_LIMITS: Final = """
import ctypes, os, resource, struct, sys
version, home, places, *limits = sys.argv[1:8]
for name, most in zip(("AS", "CPU", "FSIZE", "CORE"), map(int, limits)):
    resource.setrlimit(getattr(resource, "RLIMIT_" + name), (most, most))
if int(version) > 0:
    call = ctypes.CDLL(None).syscall
    everything = 2 ** min(12 + int(version), 15) - 1
    handled = struct.pack("QQQ", everything, 3, 3)[: 8 if int(version) < 4 else 16 if int(version) < 6 else 24]
    rules = call(444, handled, len(handled), 0)
    rights = [(place, 1 | 4 | 8) for place in places.split(os.pathsep)]
    rights += [(home, everything), ("/dev/null", 2 | 4), ("/dev/urandom", 4)]
    for place, allowed in rights:
        if os.path.exists(place):
            inside = allowed if os.path.isdir(place) else allowed & (1 | 2 | 4)
            call(445, rules, 1, struct.pack("=Qi", inside, os.open(place, os.O_PATH)), 0)
    ctypes.CDLL(None).prctl(38, 1, 0, 0, 0)
    if rules < 0 or call(446, rules, 0):
        sys.exit("Landlock refuses the rules")
os.execv(sys.argv[8], sys.argv[8:])
"""
"""Source of a program that becomes another one, within limits. Where the kernel has Landlock (``landlock(7)``), that
reads the system's files and its own alone, writes to its home alone, uses no TCP, and reaches no other process. The
numbers are those of ``linux/landlock.h``: rights to execute (1), write (2) and read (4, 8), and what versions know."""
_ENGINES: Final = ("docker", "podman")
READ_AT: Final = "/read"
"""Folder of a container with what the program may read besides its own folder."""
_OWN_AT: Final = "/submission"


def container_words(image: str, folder: Path, readable: Path, memory_mb: int, processor_s: float) -> list[str]:
    """The command line of a container without network, in which a program sees its folder and another one, read-only.

    Raises:
        InputError: Neither Docker nor Podman is here.
    """
    engine = next(filter(None, map(shutil.which, _ENGINES)), None)
    if engine is None:
        raise InputError("container", image, f"a machine with {' or '.join(_ENGINES)}")
    mounts = ((folder, _OWN_AT), (readable, READ_AT))
    bound = [word for place, inside in mounts for word in ("-v", f"{place.resolve()}:{inside}:ro")]
    limits = ["--memory", f"{memory_mb}m", "--pids-limit", str(_PROCESSES), "--cap-drop", "ALL"]
    limits += ["--ulimit", f"cpu={int(processor_s) + 1}", "--init"]
    hidden = ["--network", "none", "--read-only", "--tmpfs", "/tmp"]  # noqa: S108 - in the container
    return [engine, "run", "--rm", "-i", *hidden, *limits, *bound, "-w", _OWN_AT, image]


def _landlock() -> int:
    """The version of Landlock that the kernel has; 0 or less without it."""
    if sys.platform != "linux":
        return 0
    return int(ctypes.CDLL(None).syscall(_LANDLOCK, None, 0, _ASK_VERSION))


def isolation() -> str:
    """What a program in a process of its own cannot do here, in words."""
    return "program, without other files" if _landlock() > 0 else "program, with limits alone"


def limited(words: Sequence[str], home: str, readable: Sequence[Path], memory_mb: int, processor_s: float) -> list[str]:
    """The command line of a program within limits, which writes to its home alone.

    Args:
        words: Its own command line, with the path of the program.
        home: A folder that is its own.
        readable: What it may read besides the system's files.
        memory_mb: Memory of each process.
        processor_s: Processor time of each process.
    """
    limits = (memory_mb * 2**20, int(processor_s) + 1, _FILE_BYTES, 0)
    places = os.pathsep.join((_SYSTEM, *(str(place.resolve()) for place in readable)))
    about = (str(_landlock()), home, places, *map(str, limits))
    return [sys.executable, "-I", "-S", "-c", _WITH_LIMITS, *about, *words]


@contextmanager
def asked_program(
    words: Sequence[str],
    folder: Path,
    *,
    answer_s: float,
    memory_mb: int,
    processor_s: float,
    readable: Sequence[Path] = (),
) -> Iterator[Callable[[str], str]]:
    """Start a program in a folder, and give the function that writes a line to it and returns the line it answers.

    The program sees no variables but a path, a language and a temporary home.

    Args:
        words: The command line; that of ``container_words`` and the program's own for a container.
        folder: Its working folder.
        answer_s: Wall time of an answer.
        memory_mb: Memory of each process.
        processor_s: Processor time of each process.
        readable: What it may read besides the system's files and the installation of a program that is found by its
            name; nothing for a container, which has the limits itself.

    Raises:
        InputError: The program cannot be started; from the function: it ends, is too late, or says too much.
    """
    found = None if os.sep in words[0] else shutil.which(words[0], path=os.defpath)
    interpreter = [Path(found).resolve().parents[1]] if found else []
    words = [found or words[0], *words[1:]]
    with tempfile.TemporaryDirectory(prefix="siren-asked-") as home, tempfile.TemporaryFile() as said:
        environment = {"PATH": os.defpath, "LANG": "C.UTF-8", "HOME": home, "TMPDIR": home}
        if not readable:  # a container's engine needs that of its user; the program in it gets none of it
            environment = dict(os.environ)
        program = subprocess.Popen(  # noqa: S603 - a program that the organiser was asked to run, no shell
            limited(words, home, (*readable, *interpreter), memory_mb, processor_s) if readable else words,
            cwd=folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=said,
            start_new_session=True,
        )

        def refuse(why: str) -> InputError:
            said.seek(0, os.SEEK_END)
            said.seek(max(0, said.tell() - _CHUNK))
            last = said.read().decode(errors="replace").strip().splitlines()[-1:]
            told = f"{why}: {shown_text(' '.join(last), _SAID)}" if last else why
            return InputError("program", told, f"an answer to each line within {answer_s:g} s")

        try:
            yield lambda line: _answered(program, line, answer_s, refuse)
        finally:
            end_program(program)
            for pipe in (program.stdin, program.stdout):
                if pipe is not None:
                    pipe.close()


def _answered(
    program: "subprocess.Popen[bytes]", line: str, answer_s: float, refuse: Callable[[str], InputError]
) -> str:
    """The line that a program answers; it may begin to answer before it has read everything."""
    pipes = (program.stdin, selectors.EVENT_WRITE), (program.stdout, selectors.EVENT_READ)
    asked, answer, until_s = memoryview(f"{line}\n".encode()), bytearray(), time.monotonic() + answer_s
    with selectors.DefaultSelector() as ready:
        for pipe, event in pipes:
            if pipe is not None:
                os.set_blocking(pipe.fileno(), False)
                ready.register(pipe, event)
        while not answer.endswith(b"\n"):
            events = ready.select(max(0.0, until_s - time.monotonic()))
            if not events:
                raise refuse(f"no answer within {answer_s:g} s")
            for key, _ in events:
                if key.fileobj is program.stdout:
                    part = os.read(key.fd, _CHUNK)
                    if not part:
                        raise refuse("it ended")
                    answer += part
                    continue
                asked = asked[_write(key.fd, asked) :]
                if not asked:
                    ready.unregister(key.fileobj)
            if len(answer) > LINE_BYTES or b"\n" in answer[:-1]:
                raise refuse("more than one line, or one that is too long")
    return answer.decode(errors="replace")


def _write(pipe: int, asked: memoryview) -> int:
    """Bytes that a pipe takes; all of them where nobody reads any more: then its reader has ended, and that is said."""
    try:
        return os.write(pipe, asked[:_CHUNK])
    except BrokenPipeError:
        return len(asked)
