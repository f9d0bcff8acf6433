"""``siren``: verbs on recorded episodes. Exit codes: 0 all is well, 1 a check failed, 2 input that cannot be used."""

import argparse
import os
import sys
from collections.abc import Sequence

import siren_ros
from siren_ros.cli import evaluate, export, info, plot, recover, replay, sense, verify, video
from siren_ros.world.errors import EXIT_FAILED, SirenError

_VERBS = (info, verify, recover, export, plot, sense, video, replay, evaluate)


def parser() -> argparse.ArgumentParser:
    """The command line, with help for every verb."""
    top = argparse.ArgumentParser(
        prog="siren",
        description="Works with recorded SIREN episodes: look into them, check them, export them, draw them.",
        epilog="Exit codes: 0 all is well, 1 the check failed, 2 the input cannot be used.",
    )
    top.add_argument("--version", action="version", version=f"siren {siren_ros.__version__}")
    verbs = top.add_subparsers(title="commands", dest="verb", metavar="COMMAND", required=True)
    for module in _VERBS:
        module.add_to(verbs)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit code; an error is one line on stderr."""
    arguments = parser().parse_args(argv)
    try:
        return int(arguments.run(arguments))
    except SirenError as error:
        print(f"siren {arguments.verb}: {error}", file=sys.stderr)
        return error.exit_code
    except BrokenPipeError:
        # The reader of our output has gone, as `siren info BAG | head -1` does; nothing is left to say.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FAILED
    except KeyboardInterrupt:
        print(f"siren {arguments.verb}: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
