"""All mutants of a file, and the sample of them that a seed draws."""

import difflib
import random
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code

from mutants.operators import is_of_interest, operators


@dataclass(frozen=True)
class Mutant:
    """One small change of one file."""

    file: str
    """Relative to the repository."""
    line: int
    operator: str
    occurrence: int
    """Which of the places in the file that the operator can change, counted from 0."""

    def text(self, source: str) -> str:
        """The changed file."""
        changed = mutate_code(source, operators()[self.operator](), self.occurrence)
        if changed is None:
            raise ValueError(f"{self.file}: {self.operator} has no place number {self.occurrence}")
        return str(changed)


def mutants_of(file: str, source: str, lines: Collection[int] | None = None) -> list[Mutant]:
    """All mutants of a file, in a fixed order.

    Args:
        file: Its name.
        source: Its text.
        lines: Only changes that begin in these lines, counted from 1; all where None.
    """
    nodes = list(ast_nodes(get_ast(source)))
    mutants = []
    for name, operator in operators().items():
        occurrence = -1
        for node in nodes:
            for start, _end in operator().mutation_positions(node):
                occurrence += 1
                if (lines is None or start[0] in lines) and is_of_interest(name, node):
                    mutants.append(Mutant(file, start[0], name, occurrence))
    return mutants


def sample(mutants: Sequence[Mutant], size: int | None, seed: int) -> list[Mutant]:
    """A random sample without repetition, sorted by file and line; all where there are no more than ``size``."""
    if size is not None and size < len(mutants):
        mutants = random.Random(seed).sample(mutants, size)  # noqa: S311 - a sample for statistics
    return sorted(mutants, key=lambda mutant: (mutant.file, mutant.line, mutant.operator, mutant.occurrence))


def mutants_below(root: Path, places: Iterable[tuple[str, Collection[int] | None]]) -> list[Mutant]:
    """The mutants of several files, each with the lines that count (None for all)."""
    return [
        mutant
        for file, lines in places
        for mutant in mutants_of(file, (root / file).read_text(encoding="utf-8"), lines)
    ]


def changed_lines(mutant: Mutant, source: str) -> tuple[str, str]:
    """The lines that differ, before and after the change, stripped and joined."""
    before, after = source.splitlines(), mutant.text(source).splitlines()
    parts: tuple[list[str], list[str]] = ([], [])
    for line in difflib.ndiff(before, after):
        if line[:2] in {"- ", "+ "}:
            parts[line[0] == "+"].append(line[2:].strip())
    return " ".join(parts[0]), " ".join(parts[1])
