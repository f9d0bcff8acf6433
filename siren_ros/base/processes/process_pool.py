"""Runs functions in processes: in parallel, with a time limit, with retries where a process dies.

Pebble starts, watches and ends the processes. This module adds progress, the order of the results, what the end of a
process means, and a new pool where the server of new processes was killed.
"""

import multiprocessing
import os
import resource
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from itertools import islice
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final, Self, TypeVar

import pebble

from siren_ros.base.processes.interrupts import children_without_ctrl_c, deferred_interrupts, leave
from siren_ros.errors import InputError, SirenError

Progress = Callable[[float], None]
"""Takes the simulated seconds completed since its last call."""
Item = TypeVar("Item")
Result = TypeVar("Result")
_LOOK_S: Final = 0.5
TIMEOUT_S: Final = 900.0
"""Wall time after which a call counts as hanging, unless its caller sets another limit."""
_NOTICE_S: Final = 0.5
_SERVER_GONE: Final = 255
"""Exit code that multiprocessing gives a process whose fork server was killed."""
_SERVER_ENDS_S: Final = 0.5
"""Wall time until a killed fork server is gone; before that, multiprocessing would still ask it for a process."""
_report: Progress | None = None
"""Function to which this process reports its simulated time."""


class CrashError(SirenError):
    """Raised when the process of a call ended without an answer."""


def simulated_time() -> Progress:
    """Make a function that takes the simulated time reached, and reports the increase to the pool."""
    reached = 0.0

    def reach(time_s: float) -> None:
        nonlocal reached
        if time_s - reached >= _NOTICE_S:
            if _report is not None:
                _report(time_s - reached)
            reached = time_s

    return reach


class ProcessPool:
    """Runs functions of modules in processes. Leaving the context ends all processes at once."""

    def __init__(
        self, processes: int, progress: Progress = lambda _: None, *, fresh: bool = False, preload: str = ""
    ) -> None:
        """Set up the pool; no process starts yet.

        Args:
            processes: How many run at once. A pool of one runs its functions in this process, unless it is fresh.
            progress: Called with the steps of ``simulated_time`` of all processes.
            fresh: Whether each call has a new process, so that a crash, a hang or a kill costs this call alone.
            preload: Module that fresh processes have loaded already, so that they start in hundredths of a second.
        """
        self._processes = processes
        self._progress = progress
        self._fresh = fresh
        self._preload = preload
        self._pool: pebble.ProcessPool | None = None
        self._starting = threading.Lock()
        self._left = False
        self._futures: set[Future[Any]] = set()
        self._reports: Connection | None = None

    def __enter__(self) -> Self:
        """Start the processes; InputError if this process must not have children."""
        global _report  # noqa: PLW0603 - functions that run in this process report here
        if not self._fresh and self._processes <= 1:
            _report = self._progress
            return self
        worker = multiprocessing.current_process()
        if worker.daemon:
            how = "set DASK_DISTRIBUTED__WORKER__DAEMON=False, or start it --no-nanny"
            raise InputError("worker", worker.name, f"a worker that may start processes: {how}")
        with suppress(BrokenProcessPool):  # the first call starts it again
            self._running_pool()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """End the processes; calls that wait, and later calls, raise ``CancelledError``."""
        self._left = True
        with self._starting:
            if self._pool is not None:
                self._pool.stop()  # type: ignore[no-untyped-call] # pebble annotates most
                self._pool.join()
        for future in tuple(self._futures):  # other threads may wait for them
            future.cancel()

    def _running_pool(self) -> pebble.ProcessPool:
        """The pool; a new one if the server of its processes was killed."""
        with self._starting:
            if self._left:
                raise CancelledError
            if self._pool is not None:
                if self._pool.active:
                    return self._pool
                self._pool.join()
                time.sleep(_SERVER_ENDS_S)
            context = multiprocessing.get_context("forkserver" if self._fresh else _start_method())
            if self._preload:
                context.set_forkserver_preload([self._preload])
            self._reports, writer = context.Pipe(duplex=False)
            pool = pebble.ProcessPool(self._processes, int(self._fresh), _start_worker, (writer,), context)
            try:
                self._start(pool, context)
            except BaseException as error:
                pool.stop()  # type: ignore[no-untyped-call] # as above
                pool.join()
                if isinstance(error, BrokenProcessPool):
                    time.sleep(_SERVER_ENDS_S)
                raise
            self._pool = pool
            return pool

    def _start(self, pool: pebble.ProcessPool, context: Any) -> None:
        """Start the processes; forked ones before this process has threads. Only this process receives Ctrl-C."""
        resource_tracker.ensure_running()  # its start unblocks SIGINT
        with children_without_ctrl_c():
            if context.get_start_method() != "fork":
                forkserver.ensure_running()
        if self._preload:
            # The server loads modules for seconds before it starts this process.
            first = context.Process(target=os.getpid)
            try:
                first.start()
            except (OSError, EOFError) as error:
                raise BrokenProcessPool from error
            first.join()
        with deferred_interrupts():  # an interrupt would leave a partly started pool
            try:
                pool.active  # noqa: B018 - starts them
            except BrokenProcessPool:
                raise
            except RuntimeError as error:  # raised for threads without memory, or for too many
                raise CrashError(f"its processes cannot be started ({error})") from error

    def _submit(self, function: Callable[..., Any], arguments: tuple[Any, ...], timeout_s: float | None) -> Future[Any]:
        if self._fresh:
            function, arguments = _guarded, (function, *arguments)
        future: Future[Any]
        try:
            future = self._running_pool().schedule(function, arguments, timeout=timeout_s)
        except BrokenProcessPool as error:
            future = Future()
            future.set_exception(error)
        self._futures.add(future)
        future.add_done_callback(self._futures.discard)
        return future

    def map(
        self, function: Callable[..., Result], calls: Iterable[tuple[Any, ...]], done: Callable[[], None] = lambda: None
    ) -> list[Result]:
        """Call a function of a module many times; the results are in the order of the calls.

        The arguments can be pickled. ``done`` is called after each call.

        Raises:
            Exception: What a call raises; the others are ended.
            CrashError: A process died.
        """
        results: dict[int, Result] = {}
        if self._pool is None:
            for number, arguments in enumerate(calls):
                results[number] = function(*arguments)
                done()
            return list(results.values())
        finished = as_ready(
            lambda call: self._submit(function, call[1], None), enumerate(calls), 2 * self._processes, self._tell
        )
        for (number, _), future in finished:
            results[number] = self._answer(future)
            done()
        return [results[number] for number in sorted(results)]

    def _tell(self) -> None:
        while self._reports is not None and self._reports.poll():
            self._progress(self._reports.recv())

    def _answer(self, future: Future[Any]) -> Any:
        """Result of a call; the end of its process raises ``CrashError``."""
        try:
            return future.result()
        except BrokenProcessPool as error:
            if self._left:  # pebble may see the closed pipe before it cancels the calls
                raise CancelledError from error
            if error.args and error.__cause__ is None:  # pebble found a dead process whose call it did not know yet
                raise CrashError("a process ended as it began a call") from error
            cause = type(error.__cause__ or error).__name__
            raise CrashError(f"the server of new processes is gone ({cause})") from error
        except SystemExit as error:
            raise CrashError("its process was ended by SIGTERM") from error
        except pebble.ProcessExpired as error:
            if error.exitcode == _SERVER_GONE:
                with suppress(ProcessLookupError):  # no other code watches this process any more
                    os.kill(error.pid, signal.SIGKILL)
                raise CrashError("the server of its process was killed") from error
            if error.exitcode < 0:
                name = signal.Signals(-error.exitcode).name
                cause = ", as where memory runs out" if name == "SIGKILL" else ""
                raise CrashError(f"its process was killed by {name}{cause}") from error
            raise CrashError(f"its process ended with exit code {error.exitcode}") from error

    def call(self, function: Callable[..., Result], *arguments: Any, timeout_s: float = TIMEOUT_S) -> Result:
        """Call a function of a module in a process and wait for its answer. Several threads may call at the same time.

        The arguments can be pickled. The process is killed after the wall time ``timeout_s``.

        Raises:
            SirenError: What the function raises; another attempt would raise it again.
            CrashError: The function raised another error, or its process died or hung.
            CancelledError: The pool was stopped before there was an answer.
        """
        try:
            result: Result = self._answer(self._submit(function, arguments, timeout_s))
        except TimeoutError as error:
            raise CrashError(f"its process gave no answer for {timeout_s:g} s") from error
        return result

    def call_with_retries(self, retries: int, function: Callable[..., Result], *arguments: Any) -> Result:
        """Like ``call``, with another attempt if the process dies or hangs.

        Raises:
            CrashError: It did so more often than ``retries``; the message tells all reasons.
        """
        reasons: list[str] = []
        while True:
            try:
                return self.call(function, *arguments)
            except CrashError as error:
                reasons.append(str(error))
                if len(reasons) > retries:
                    raise CrashError(f"{function.__name__}: {'; '.join(reasons)}") from error


def _start_method() -> str:
    """Start method: ``fork`` if it is safe, which means that no other Python thread can hold a lock that is copied.

    A forked worker has all modules at once; another one loads them first, which takes half as long as the export of a
    short episode.
    """
    return "fork" if sys.platform == "linux" and threading.active_count() == 1 else "forkserver"


def _start_worker(reports: Connection) -> None:
    global _report  # noqa: PLW0603 - this is how a process of a pool gets its settings
    signal.signal(signal.SIGTERM, leave)
    # The pool ignores SIGINT; programs that calls start must not.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT,))
    _report = reports.send  # a message this short is one write and needs no lock, which a killed process could keep
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker when its program is gone. The kernel's signal would come only when the fork server ends."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGKILL)


def _guarded(function: Callable[..., Result], *arguments: Any) -> Result:
    """Call a function in a fresh process; an error that is not the project's own gets its place of origin."""
    try:
        return function(*arguments)
    except SirenError:
        raise
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        raise CrashError(f"{type(error).__name__}: {error} ({Path(last.filename).name}:{last.lineno})") from error


def limit_memory(more_bytes: int) -> None:
    """Limit the memory that this process may map beyond its present amount; larger requests raise MemoryError.

    For a fresh process that reads what somebody else has made. Where the system does not tell what a process has, there
    is no limit.
    """
    statm = Path("/proc/self/statm")
    if statm.exists():
        has = int(statm.read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        asked = has + more_bytes
        resource.setrlimit(resource.RLIMIT_AS, (asked if hard == resource.RLIM_INFINITY else min(asked, hard), hard))


def as_ready(
    submit: Callable[[Item], Future[Result]],
    items: Iterable[Item],
    at_once: int,
    look: Callable[[], None] = lambda: None,
) -> Generator[tuple[Item, Future[Result]], None, None]:
    """Yield items with their finished futures, in the order of completion. Closing the generator cancels running work.

    ``submit`` begins the work on an item, which is taken when its turn comes, so that there may be very many. ``look``
    is called twice a second while the work goes on.
    """
    waiting = iter(items)
    running: dict[Future[Result], Item] = {}
    try:
        while True:
            for item in islice(waiting, at_once - len(running)):
                running[submit(item)] = item
            if not running:
                return
            done, _ = wait(running, _LOOK_S, return_when=FIRST_COMPLETED)
            look()
            for future in done:
                yield running.pop(future), future
    finally:
        for future in running:
            future.cancel()


def side_by_side(
    tasks: Mapping[Item, Callable[[], Result]], workers: int, stop: Callable[[], None] = lambda: None
) -> dict[Item, Result]:
    """Run independent tasks in parallel; results by their keys. The first error cancels waiting tasks and is raised.

    The tasks run in threads, where they wait for processes or for servers. After an error ``stop`` ends what they wait
    for, before they are awaited.
    """
    with ThreadPoolExecutor(workers, "task") as threads:
        try:
            finished = as_ready(lambda name: threads.submit(tasks[name]), tasks, workers)
            results = {name: future.result() for name, future in finished}
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            stop()
            raise
    return {name: results[name] for name in tasks}
