"""A command line that loads its arguments when somebody asks for them."""

import argparse
import sys
from collections.abc import Iterator
from importlib import import_module
from typing import Any, Final, NoReturn, Self, TextIO

from siren_ros.errors import shown_text

_LONGEST: Final = 20_000
"""Most characters of a complaint. Errors list what is allowed and can get long."""


def complain(text: str) -> None:
    """Prints one line on stderr, without the control characters that another program's text in it may have."""
    print(shown_text(text, _LONGEST), file=sys.stderr)


class PrintableOutput:
    """Standard output without the control characters that other programs' text may contain, for all verbs.

    Put in the place of a stream, it hands on what is printable, and line breaks; the rest as ``shown_text`` shows it.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Writes text, as a stream does."""
        self._stream.write("\n".join(shown_text(line, len(line)) for line in text.split("\n")))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class Command(argparse.ArgumentParser):
    """A command line whose arguments are added when somebody asks for them: some commands load much."""

    def __init__(self, *, add: str = "", **options: Any) -> None:
        """Takes the options of its base.

        ``add`` names a module of this package and its function that adds the arguments.
        """
        super().__init__(**options)
        self._add = add
        self.variants: dict[str, Command] = {}
        """Commands by the word that may stand where the first argument of this one does; argparse knows no such."""

    def loaded(self) -> Self:
        """This command with its arguments."""
        module, _, function = self._add.rpartition(".")
        self._add = ""
        if module:
            getattr(import_module(f"{__package__}.{module}"), function)(self)
        return self

    def add_variant(self, word: str, add: str) -> None:
        """Adds another command that is called by a word after this one."""
        self.variants[word] = Command(prog=f"{self.prog} {word}", add=add)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parses as its base does, after it has loaded the arguments."""
        self.loaded()
        variant = self.variants.get(args[0]) if args else None
        if variant is not None:
            return variant.parse_known_args(args[1:], namespace)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Ends as its base does.

        The message may contain words of the command line, such as names of other people's files.
        """
        super().error(shown_text(message, _LONGEST))

    def below(self) -> Iterator["Command"]:
        """The commands right below this one."""
        for action in self.loaded()._actions:  # noqa: SLF001 - its own
            if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - argparse has no other way to ask
                yield from action.choices.values()
        yield from self.variants.values()

    def arguments(self) -> Iterator[argparse.Action]:
        """Its options and arguments, also those that its help does not show; commands below it are none."""
        commands = argparse._SubParsersAction  # noqa: SLF001 - as above
        return (action for action in self.loaded()._actions if not isinstance(action, commands))  # noqa: SLF001 - its own
