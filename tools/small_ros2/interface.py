"""``ros2 interface show`` and ``ros2 interface list``."""

import argparse
from collections.abc import Iterator
from pathlib import Path

from rosidl_runtime_py import get_interface_path, get_interfaces

from small_ros2.errors import CommandError

SUFFIXES = (".msg", ".srv", ".action")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the verbs."""
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    show = verbs.add_parser("show", help="print the definition of a type, with the types in it")
    show.add_argument("type", help="for example std_msgs/msg/Header")
    show.set_defaults(main=show_interface)
    listing = verbs.add_parser("list", help="list the types of all packages, or of one")
    listing.add_argument("package", nargs="?", help="name of the package")
    listing.set_defaults(main=list_interfaces)


def definition_of(type_name: str) -> Path:
    """The file that defines a type.

    Raises:
        CommandError: The name has another form, or the type is not installed.
    """
    parts = type_name.split("/")
    if len(parts) != 3 or not all(parts):
        raise CommandError(f"'{type_name}' is not a type such as std_msgs/msg/String")
    try:
        path = Path(get_interface_path(parts))
    except LookupError:
        raise CommandError(f"type '{type_name}' is not installed") from None
    return path


def expanded(type_name: str, depth: int = 0) -> Iterator[str]:
    """Lines of a definition. Each field of another package's or this package's type is followed by its definition."""
    package = type_name.split("/", maxsplit=1)[0]
    for line in definition_of(type_name).read_text(encoding="utf-8").splitlines():
        bare = line.split("#")[0].strip()
        if depth and not bare:
            continue
        yield "\t" * depth + (line if not depth else bare)
        inner = nested_type(bare, package)
        if inner:
            yield from expanded(inner, depth + 1)


def nested_type(line: str, package: str) -> str:
    """The message type of a field; empty for a primitive one, a constant, and lines that declare no field."""
    words = line.split()
    kind = words[0].split("[")[0] if len(words) > 1 else ""
    if "/" in kind:
        owner, *_, name = kind.split("/")
        return f"{owner}/msg/{name}"
    return f"{package}/msg/{kind}" if kind[:1].isupper() else ""


def show_interface(arguments: argparse.Namespace) -> int:
    """Prints a definition."""
    print("\n".join(expanded(arguments.type)))
    return 0


def list_interfaces(arguments: argparse.Namespace) -> int:
    """Prints the names of types, one per line."""
    try:
        interfaces = get_interfaces([arguments.package] if arguments.package else [])
    except LookupError:
        raise CommandError(f"package '{arguments.package}' has no types, or is not installed") from None
    for package, names in interfaces.items():
        for name in names:
            print(f"{package}/{name}")
    return 0
