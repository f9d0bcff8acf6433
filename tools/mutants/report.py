"""What a run prints: survivors, and the score of each folder; mutants that change nothing are known from a file."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from mutants.mutations import changed_lines
from mutants.places import folder_of
from mutants.runner import Fate


@dataclass(frozen=True)
class Equivalent:
    """A change that changes nothing that anybody could notice."""

    file: str
    was: str
    becomes: str
    why: str


def load_equivalents(path: Path) -> list[Equivalent]:
    """The file of equivalent mutants; none where there is no file."""
    if not path.exists():
        return []
    return [Equivalent(**entry) for entry in yaml.safe_load(path.read_text(encoding="utf-8")) or []]


@dataclass(frozen=True)
class Finding:
    """A fate, with the lines that differ and whether the change is known to be equivalent."""

    fate: Fate
    was: str
    becomes: str
    equivalent: bool

    @property
    def verdict(self) -> str:
        """``caught``, ``survived`` or ``equivalent``."""
        return "equivalent" if self.equivalent and self.fate.outcome == "survived" else self.fate.outcome

    def text(self) -> str:
        """File, line and difference."""
        mutant = self.fate.mutant
        return (
            f"{mutant.file}:{mutant.line}: {self.verdict}, {self.fate.tests} tests\n  - {self.was}\n  + {self.becomes}"
        )

    def to_json(self) -> dict[str, object]:
        """For a file of results."""
        mutant, fate = self.fate.mutant, self.fate
        return {
            "file": mutant.file,
            "line": mutant.line,
            "operator": mutant.operator,
            "verdict": self.verdict,
            "was": self.was,
            "becomes": self.becomes,
            "by": fate.by,
            "tests": fate.tests,
        }


def finding(fate: Fate, source: str, equivalents: Iterable[Equivalent]) -> Finding:
    """A fate in the light of the file and of the known equivalents."""
    was, becomes = changed_lines(fate.mutant, source)
    known = any((entry.file, entry.was, entry.becomes) == (fate.mutant.file, was, becomes) for entry in equivalents)
    return Finding(fate, was, becomes, known)


def score_table(findings: Sequence[Finding]) -> str:
    """Caught of those that are not equivalent, per folder and in all."""
    rows = []
    folders = sorted({folder_of(finding.fate.mutant.file).package for finding in findings})
    for name in [*folders, "all"]:
        verdicts = [
            finding.verdict for finding in findings if name in {"all", folder_of(finding.fate.mutant.file).package}
        ]
        caught, equivalent = verdicts.count("caught"), verdicts.count("equivalent")
        counted = len(verdicts) - equivalent
        score = f"{100 * caught / counted:.0f} %" if counted else "-"
        rows.append(f"{name:32} {caught:5} of {counted:4} caught  {score:>5}  ({equivalent} equivalent)")
    return "\n".join(rows)
