"""``ros2 pkg executables [PACKAGE]`` and ``ros2 pkg prefix PACKAGE``."""

import argparse
import importlib.util

from small_ros2.index import BUILT_IN, built_in, executables, packages, prefix_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the verbs."""
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    listing = verbs.add_parser("executables", help="list executables, of one package or of all")
    listing.add_argument("package", nargs="?", help="name of the package")
    listing.add_argument("--full-path", action="store_true", help="print paths instead of names")
    listing.set_defaults(main=list_executables)
    prefix = verbs.add_parser("prefix", help="print where a package is installed")
    prefix.add_argument("package", help="name of the package")
    prefix.set_defaults(main=print_prefix)


def list_executables(arguments: argparse.Namespace) -> int:
    """Prints one executable per line."""
    for package in [arguments.package] if arguments.package else sorted({*packages(), *BUILT_IN}):
        brought = built_in(package)
        for name, module in brought.items():
            spec = importlib.util.find_spec(module)
            print(spec.origin if arguments.full_path and spec else f"{package} {name}")
        for path in () if brought else executables(package):
            print(path if arguments.full_path else f"{package} {path.name}")
    return 0


def print_prefix(arguments: argparse.Namespace) -> int:
    """Prints the prefix of a package."""
    print(prefix_of(arguments.package))
    return 0
