"""Programs that begin in a copy of a process that has loaded their modules, which takes seconds otherwise.

A server has loaded the modules and has made a short episode without ROS, which loads the compiled loops. There is one
thread, and neither ROS nor SUMO is under way. It forks for each program. A program looks as if it had been executed: it
is the child of who started it, it has its own arguments, variables, folder, streams and session, and ends as Python
ends. All copies share the seed of Python's hashes; tests of what may depend on it start their programs the usual way.
"""

import array
import atexit
import ctypes
import gc
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

LOADED: Final = (
    *("siren_ros.running.studies.ready_worker", "siren_ros.data.datasets.files"),
    *("siren_ros.data.datasets.kitti", "siren_ros.cli.main", "siren_ros.scoring.evaluation.detection.boxes"),
)
"""Most of what programs import, and first what makes the episode; rclpy is not among it, which starts threads."""
_WITHOUT_THREAD: Final = {"JE_ARROW_MALLOC_CONF": "background_thread:false"}
"""The allocator of SUMO's Arrow would start one."""
_IN_PROCESSES: Final = "processes:=true"
_ROOM_BYTES: Final = 1 << 16
"""Of arguments and of variables that ``/proc`` shows of a program."""
_SERVE: Final = "from preloaded_programs import main; main()"
_PR_SET_CHILD_SUBREAPER: Final = 36
_ARGUMENTS_BEGIN: Final = 47
"""Place in ``/proc/self/stat`` of where arguments begin and end and variables begin and end in memory."""
_SHORT_S: Final = 0.0005


class Server:
    """Forks programs, one at a time, each a child of this process."""

    def __init__(self, own: socket.socket) -> None:
        """Takes this process's end of the connection to a server."""
        self._socket = own

    def start(self, request: Mapping[str, Any], streams: Sequence[int]) -> int:
        """Starts a program; returns its process id."""
        with _adopting():
            descriptors = array.array("i", streams)
            content = json.dumps(request).encode()
            header = len(content).to_bytes(8, "big")
            self._socket.sendmsg([header], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, descriptors)])
            self._socket.sendall(content)
            return int.from_bytes(_received(self._socket, 8), "big")


@contextmanager
def _adopting() -> Iterator[None]:
    """Within it, processes become children of this one whose parents end below it."""
    for adopts in (1, 0):
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, adopts, 0, 0, 0)
        if adopts:
            yield


def _received(connection: socket.socket, size: int) -> bytes:
    content = b""
    while len(content) < size:
        part = connection.recv(size - len(content))
        if not part:
            raise EOFError
        content += part
    return content


@cache
def _server() -> Server:
    """This process's server."""
    own, its = socket.socketpair()
    room = {"SIREN_TEST_ROOM": "." * _ROOM_BYTES}
    folder = str(Path(__file__).parent)
    path = os.pathsep.join((folder, *filter(None, [os.environ.get("PYTHONPATH")])))
    command = [sys.executable, "-c", _SERVE, str(its.fileno()), "." * _ROOM_BYTES]
    process = subprocess.Popen(
        command,
        env={**os.environ, "PYTHONPATH": path, **_WITHOUT_THREAD, **room},
        pass_fds=(its.fileno(),),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )
    its.close()

    def end() -> None:
        own.close()
        process.wait()

    atexit.register(end)
    return Server(own)


class PreloadedProgram(subprocess.Popen[Any]):
    """A ``Popen`` for ``[sys.executable, ...]`` with a module (``-m``), a text (``-c``) or a file."""

    server: Server | None = None
    """Forks the programs; None: this process's own server."""

    def _execute_child(self, *arguments: Any) -> None:
        """As ``Popen``'s, which makes the pipes before and closes what is the program's after."""
        command, cwd, env, ends = arguments[0], arguments[5], arguments[6], arguments[10:16]
        request = {
            "command": list(map(str, command)),
            "cwd": str(cwd or Path.cwd()),
            "variables": dict(os.environ if env is None else env),
            "new_session": arguments[21],
        }
        streams = [given if given >= 0 else own for own, given in enumerate(ends[place] for place in (0, 3, 5))]
        self.pid = (self.server or _server()).start(request, streams)
        self._child_created = True
        self._close_pipe_fds(*ends)  # type: ignore[attr-defined] # subprocess's own


PRELOADING: Final = SimpleNamespace(**{**vars(subprocess), "Popen": PreloadedProgram})
"""Stands for the module ``subprocess`` in a module that is to start its programs so."""


def main() -> None:
    """The server; in its copies the programs."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threshold = gc.get_threshold()
    for name in LOADED:
        import_module(name)
    gc.set_threshold(*threshold)  # a study's processes have their own
    if len(os.listdir("/proc/self/task")) > 1:  # noqa: PTH208 - a count
        raise RuntimeError("a module has started a thread: its copies would lack it")
    gc.collect()
    gc.freeze()
    run = serve(socket.socket(fileno=int(sys.argv[1])))
    if run is not None and _IN_PROCESSES in run:
        run = _beside_a_server(run)
    if run is not None:
        run_program(run)


def _beside_a_server(command: list[str]) -> list[str] | None:
    """Gives an episode a server of its own for its nodes; returns what this process is to run, None in that server."""
    own, its = socket.socketpair()
    if not os.fork():
        own.close()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        return serve(its)
    its.close()
    PreloadedProgram.server = Server(own)
    import_module("siren_ros.running.ros.programs.composition").subprocess = PRELOADING  # type: ignore[attr-defined]
    return command


def serve(connection: socket.socket) -> list[str] | None:
    """Waits for requests; returns a program's command in its own process, None in the server when nobody is left."""
    while True:
        try:
            header, descriptors = _header(connection)
            request = json.loads(_received(connection, int.from_bytes(header, "big")))
        except (EOFError, ConnectionError):
            return None
        way = os.pipe()
        between = os.fork()
        if not between:
            between = os.getpid()
            if child := os.fork():
                os.write(way[1], child.to_bytes(8, "big"))
                os._exit(0)
            _become(request, descriptors, (connection.detach(), *way))
            while os.getppid() == between:
                time.sleep(_SHORT_S)
            return list(request["command"])
        os.waitpid(between, 0)
        connection.sendall(os.read(way[0], 8))
        for descriptor in (*way, *descriptors):
            os.close(descriptor)


def _header(connection: socket.socket) -> tuple[bytes, list[int]]:
    header, ancillary, _, _ = connection.recvmsg(8, socket.CMSG_SPACE(3 * array.array("i").itemsize))
    if not header:
        raise EOFError
    descriptors = array.array("i")
    for _, _, content in ancillary:
        descriptors.frombytes(content)
    return header, list(descriptors)


def _become(request: Mapping[str, Any], streams: Sequence[int], unneeded: Sequence[int]) -> None:
    """Takes a program's streams, folder, variables and session; ``/proc`` shows its command and variables."""
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    for descriptor in (*streams, *unneeded):
        os.close(descriptor)
    if request["new_session"]:
        os.setsid()
    os.chdir(request["cwd"])
    os.environ.clear()  # the variables that the C library has lie elsewhere in memory from now on
    os.environ.update(request["variables"])
    signal.signal(signal.SIGINT, signal.default_int_handler)
    fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    places = [int(field) for field in fields[_ARGUMENTS_BEGIN - 2 :][:4]]
    variables = [f"{name}={value}" for name, value in request["variables"].items()]
    for begin, end, parts in ((*places[:2], request["command"]), (*places[2:], variables)):
        content = "".join(f"{part}\0" for part in parts).encode()[: end - begin - 1]
        ctypes.memmove(begin, content.ljust(end - begin, b"\0"), end - begin)


def run_program(command: Sequence[str]) -> None:
    """Runs what ``python`` would run, in this process; its errors and its exit are Python's own."""
    if command[1] == "-m":
        sys.argv = list(command[2:])
        sys.path[0] = str(Path.cwd())
        sys.modules.pop(command[2], None)
        runpy.run_module(command[2], run_name="__main__", alter_sys=True)
    elif command[1] == "-c":
        sys.argv = ["-c", *command[3:]]
        sys.path[0] = ""
        names = {"__name__": "__main__", "__builtins__": __builtins__}
        sys.modules["__main__"].__dict__.update(names)
        exec(compile(command[2], "<string>", "exec"), sys.modules["__main__"].__dict__)  # noqa: S102 - a test's own text
    else:
        sys.argv = list(command[1:])
        sys.path[0] = str(Path(command[1]).parent)
        runpy.run_path(command[1], run_name="__main__")
