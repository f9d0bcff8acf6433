"""``siren``: verbs on recorded episodes. Exit codes: 0 all is well, 1 a check failed, 2 input that cannot be used."""

import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from typing import Any, Final

import siren_ros
from siren_ros.base.processes.interrupts import deferred_interrupts
from siren_ros.cli.command import Command, PrintableOutput, complain
from siren_ros.errors import EXIT_FAILED, SirenError

_TASKS: Final = {
    "prediction": ("trajectory prediction: 5 s ahead, ADE and FDE", "prediction.add_arguments"),
    "yield": (
        "how traffic made way: the EMV's delay, corridor, drivers' responses, wake, safety",
        "yielding.add_yield",
    ),
    "counterfactual": (
        "the effect of siren and level: the same seeds at several levels",
        "yielding.add_counterfactual",
    ),
    "sim-agents": ("models that simulate the civilians again, by the terms of WOSAC", "realism.add_sim_agents"),
    "realism": ("how near traffic is to what was measured on streets", "realism.add_arguments"),
    "diversity": ("how different episodes are, and what more seeds would add", "yielding.add_diversity"),
    "detection": ("3-D detection: the nuScenes score of a detector's boxes", "detection.add_arguments"),
    "risk": (
        "vision-language risk understanding: normal scenes, near-misses and collisions in videos",
        "risk.add_arguments",
    ),
}
"""What the tasks are, and which function of the folder ``evaluation`` adds their arguments."""


def add_evaluate(verb: Command) -> None:
    """Adds the description and the options of the command."""
    verb.description = "Scores models on recorded episodes."
    tasks = verb.add_subparsers(title="tasks", metavar="TASK", required=True)
    for name, (summary, add) in _TASKS.items():
        tasks.add_parser(name, help=summary, add=f"evaluation.{add}")


VERBS: Final = {
    "episode": ("make one episode", "episode.add_arguments"),
    "generate": (
        "make the episodes of a study: templates, levels, seeds, maps and parameters",
        "generate.add_arguments",
    ),
    "sites": ("list the places of a map at which the templates can happen", "generate.add_sites"),
    "info": ("show what an episode is and what its bag contains", "bags.add_info"),
    "verify": ("check that the interaction happened and that the record is sound", "bags.add_verify"),
    "recover": ("complete a bag whose writer was killed", "bags.add_recover"),
    "export": ("write episodes as a dataset in another format", "export.add_arguments"),
    "pack": ("write samples for training as one file", "export.add_pack"),
    "check": ("check a copy of a dataset against its hashes", "export.add_check"),
    "view": ("open an episode in the browser, in 3-D with a timeline", "view.add_view"),
    "plot": ("draw an episode from above", "view.add_plot"),
    "sense": ("draw what sensors see at one time of an episode", "view.add_sense"),
    "video": ("make a video of an episode, from above or from its cameras", "view.add_video"),
    "replay": ("play an episode on its topics, or simulate it again and compare", "episode.add_replay"),
    "carla": ("play an episode in a CARLA server, or examine the server", "carla.add_arguments"),
    "label": ("derive the labels of risk videos again, with other thresholds", "generate_risk.add_label"),
    "rate": ("write a page on which a person labels risk videos", "evaluation.risk.add_rate"),
    "evaluate": ("score models, traffic and AVs on episodes", "main.add_evaluate"),
    "leaderboard": ("rank the submissions in a folder, with paired tests", "leaderboard.add_arguments"),
    "round": ("hold a benchmark on sealed episodes: make, score, publish, verify", "round.add_arguments"),
    "exam": ("grade how a driver makes way, by a rulebook", "exam.add_arguments"),
    "report": (
        "write a study as one HTML page: episodes, measurements, and the commands that repeat them",
        "report.add_arguments",
    ),
    "compare-paper": ("print the numbers of the paper's tables next to ours", "report.add_paper"),
    "calibrate": ("fit the EMV's parameters to trajectories", "train.add_calibration"),
    "fit-drivers": ("fit a preset of drivers to half of the published figures", "fit_drivers.add_arguments"),
    "train": ("train the models that ship with the project", "train.add_arguments"),
    "reproduce": ("make the measured figures, pictures and films of the documents again", "report.add_reproduction"),
}
"""What the verbs do, and which function of this package adds their arguments."""


def parser() -> Command:
    """The command line; each verb loads its arguments when it is parsed or printed."""
    top = Command(
        prog="siren",
        description="Makes, shows, checks, draws and exports SIREN episodes, and scores models on them.",
        epilog="Exit codes: 0 success, 1 an episode or a check failed, 2 the input cannot be used.",
    )
    top.add_argument("--version", action="version", version=f"siren {siren_ros.__version__}")
    verbs = top.add_subparsers(title="commands", dest="verb", metavar="COMMAND", required=True)
    for name, (summary, add) in VERBS.items():
        verbs.add_parser(name, help=summary, add=add)
    return top


def command_lines(line: Command | None = None) -> Iterator[Command]:
    """The command itself, then each of its verbs, tasks and formats: everything that ``--help`` describes."""
    line = line or parser()
    yield line.loaded()
    for below in line.below():
        yield from command_lines(below)


class _TerminatedError(KeyboardInterrupt):
    """Raised by SIGTERM, so that the work under way ends and cleans up as with Ctrl-C."""


_AGAIN: Final[dict[int, tuple[type[BaseException], Any]]] = {
    signal.SIGINT: (KeyboardInterrupt, signal.default_int_handler),
    signal.SIGTERM: (_TerminatedError, signal.SIG_DFL),  # a second SIGTERM ends the process at once
}
"""What a signal raises, and how a second one is handled."""


@contextmanager
def _interruptible() -> Iterator[None]:
    """Makes SIGINT and SIGTERM exceptions of the main thread; SIGTERM ends forked children at once, as without it.

    An ignored SIGINT stays ignored. An error that a library makes of the exception becomes the exception again.
    """
    here = os.getpid()
    came: list[type[BaseException]] = []

    def end(number: int, _frame: object) -> None:
        error, again = _AGAIN[number]
        signal.signal(number, again)
        if os.getpid() != here:
            os.kill(os.getpid(), number)
        came.append(error)
        raise error

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _AGAIN}
    for number, handler in before.items():
        if handler in _AGAIN[number]:
            signal.signal(number, end)
    try:
        yield
    except Exception as error:
        if came:
            raise came[0] from error
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit code; an error is one line on stderr."""
    name = "siren"
    try:
        with _interruptible():
            # An interrupt waits until everything that a verb needs is loaded, because a half-loaded module cannot be
            # used.
            with deferred_interrupts():
                arguments = parser().parse_args(argv)
            name = f"siren {arguments.verb}"
            with redirect_stdout(PrintableOutput(sys.stdout)):
                return int(arguments.run(arguments))
    except SirenError as error:
        complain(f"{name}: {error}")
        return error.exit_code
    except MemoryError as error:  # the memory of this process or of a worker is exhausted
        complain(f"{name}: the memory is not enough" + (f" ({error})" if str(error) else ""))
        return EXIT_FAILED
    except BrokenPipeError:
        # The program that read our output has ended, as in `siren info BAG | head -1`, so later output is discarded.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FAILED
    except _TerminatedError:
        complain(f"{name}: terminated")
        return 128 + signal.SIGTERM
    except KeyboardInterrupt:
        complain(f"{name}: interrupted")
        return 130


if __name__ == "__main__":
    sys.exit(main())
