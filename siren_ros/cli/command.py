"""A command line that loads its arguments when somebody asks for them."""

import argparse
from collections.abc import Iterator
from importlib import import_module
from typing import Any, Self


class Command(argparse.ArgumentParser):
    """A command line whose arguments are added when somebody asks for them: some commands load much."""

    def __init__(self, *, add: str = "", **options: Any) -> None:
        """As its base; ``add`` names a module of this package and its function that adds the arguments."""
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
        """Another command behind a word after this one."""
        self.variants[word] = Command(prog=f"{self.prog} {word}", add=add)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As its base."""
        self.loaded()
        variant = self.variants.get(args[0]) if args else None
        if variant is not None:
            return variant.parse_known_args(args[1:], namespace)
        return super().parse_known_args(args, namespace)

    def below(self) -> Iterator["Command"]:
        """The commands right below this one."""
        for action in self.loaded()._actions:  # noqa: SLF001 - its own
            if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - argparse has no other way to ask
                yield from action.choices.values()
        yield from self.variants.values()
