"""``siren``: verbs on recorded episodes. Exit codes: 0 all is well, 1 a check failed, 2 input that cannot be used."""

import argparse
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Final

import siren_ros
from siren_ros.errors import EXIT_FAILED, SirenError

_VERBS: Final = {
    "generate": "make many episodes: a matrix of templates, levels, seeds, maps and parameters",
    "info": "show what an episode is and what its bag holds",
    "verify": "check that the interaction happened and that the record is sound",
    "recover": "complete a bag whose writer was killed",
    "export": "write episodes as a dataset in another format",
    "plot": "draw an episode from above",
    "sense": "draw what sensors see at an instant of an episode",
    "video": "make a video of an episode, from above or through its cameras",
    "replay": "play an episode on its topics, or simulate it again and compare",
    "label": "derive the labels of risk videos again, with other thresholds",
    "evaluate": "score models, traffic and AVs on episodes",
    "report": "write a study as one HTML page: what was made, what was measured, how to make it again",
    "compare-paper": "put every number of the paper's tables next to ours",
    "calibrate": "fit the EMV's parameters to trajectories",
    "train": "train the models that ship with the project",
}
"""What the verbs do; each is a module of this package, loaded when it is asked for: some bring much with them."""


_SETS: Final = {"generate": {"risk": "a set of front-camera videos with risk labels"}}
"""Words after a verb that make another command of it; each is a module ``generation/VERB_WORD``."""


def parser(verb: str, word: str = "") -> argparse.ArgumentParser:
    """The command line, with the arguments of one verb, or of the command that the word after it makes."""
    top = argparse.ArgumentParser(
        prog="siren",
        description="Makes SIREN episodes, looks into them, checks, draws and exports them, and scores models on them.",
        epilog="Exit codes: 0 all is well, 1 the check failed, 2 the input cannot be used.",
    )
    top.add_argument("--version", action="version", version=f"siren {siren_ros.__version__}")
    verbs = top.add_subparsers(title="commands", dest="verb", metavar="COMMAND", required=True)
    for name, summary in _VERBS.items():
        added = verbs.add_parser(name, help=summary)
        sets = _SETS.get(name, {})
        if name == verb and word in sets:
            below = added.add_subparsers(required=True).add_parser(word)
            import_module(f"siren_ros.cli.generation.{name}_{word}").add_arguments(below)
        elif name == verb:
            import_module(f"siren_ros.cli.{name.replace('-', '_')}").add_arguments(added)
            if sets:
                also = (f"`siren {name} {word}` makes {made}; --help has its options" for word, made in sets.items())
                added.epilog = f"{'; '.join(also)}."
    return top


def command_lines() -> Iterator[argparse.ArgumentParser]:
    """The command itself, then each of its verbs, tasks and formats: everything that ``--help`` describes."""
    yield parser("")
    for verb in _VERBS:
        yield from _with_tasks(_verbs_of(parser(verb))[verb])
        for word in _SETS.get(verb, {}):
            yield from _with_tasks(_verbs_of(_verbs_of(parser(verb, word))[verb])[word])


def _verbs_of(line: argparse.ArgumentParser) -> Mapping[str, argparse.ArgumentParser]:
    """The commands below a command, by name."""
    return {
        name: below
        for action in line._actions  # noqa: SLF001 - argparse has no other way to ask
        if isinstance(action, argparse._SubParsersAction)  # noqa: SLF001
        for name, below in action.choices.items()
    }


def _with_tasks(line: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    yield line
    for below in _verbs_of(line).values():
        yield from _with_tasks(below)


class _TerminatedError(KeyboardInterrupt):
    """SIGTERM: what is under way ends and cleans up as with Ctrl-C."""


@contextmanager
def _terminable() -> Iterator[None]:
    """Makes SIGTERM an exception of the main thread; children that are forked end at once, as without it."""
    here = os.getpid()

    def end(number: int, _frame: object) -> None:
        signal.signal(number, signal.SIG_DFL)  # a second one forces the end
        if os.getpid() != here:
            os.kill(os.getpid(), number)
        raise _TerminatedError

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit code; an error is one line on stderr."""
    words = sys.argv[1:] if argv is None else argv
    verb, word, *_ = [*(word for word in words if not word.startswith("-")), "", ""]
    arguments = parser(verb, word).parse_args(words)
    try:
        with _terminable():
            return int(arguments.run(arguments))
    except SirenError as error:
        print(f"siren {arguments.verb}: {error}", file=sys.stderr)
        return error.exit_code
    except BrokenPipeError:
        # The reader of our output has gone, as `siren info BAG | head -1` does; nothing is left to say.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FAILED
    except _TerminatedError:
        print(f"siren {arguments.verb}: terminated", file=sys.stderr)
        return 128 + signal.SIGTERM
    except KeyboardInterrupt:
        print(f"siren {arguments.verb}: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
