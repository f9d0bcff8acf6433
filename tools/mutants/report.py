"""What a run prints: survivors, and the score of each folder."""

from collections.abc import Sequence
from dataclasses import dataclass

from mutants.mutations import changed_lines
from mutants.places import folder_of
from mutants.runner import Fate


@dataclass(frozen=True)
class Finding:
    """A fate, with the lines that differ."""

    fate: Fate
    was: str
    becomes: str

    def text(self) -> str:
        """File, line and difference."""
        mutant, fate = self.fate.mutant, self.fate
        return f"{mutant.file}:{mutant.line}: {fate.outcome}, {fate.tests} tests\n  - {self.was}\n  + {self.becomes}"

    def to_json(self) -> dict[str, object]:
        """For a file of results."""
        mutant, fate = self.fate.mutant, self.fate
        return {
            "file": mutant.file,
            "line": mutant.line,
            "operator": mutant.operator,
            "verdict": fate.outcome,
            "was": self.was,
            "becomes": self.becomes,
            "by": fate.by,
            "tests": fate.tests,
        }


def finding(fate: Fate, source: str) -> Finding:
    """A fate in the light of the file."""
    return Finding(fate, *changed_lines(fate.mutant, source))


def score_table(findings: Sequence[Finding]) -> str:
    """Caught changes per folder and in all."""
    rows = []
    folders = sorted({folder_of(finding.fate.mutant.file).package for finding in findings})
    for name in [*folders, "all"]:
        fates = [finding.fate for finding in findings]
        verdicts = [fate.outcome for fate in fates if name in {"all", folder_of(fate.mutant.file).package}]
        caught = verdicts.count("caught")
        score = f"{100 * caught / len(verdicts):.0f} %" if verdicts else "-"
        rows.append(f"{name:32} {caught:5} of {len(verdicts):4} caught  {score:>5}")
    return "\n".join(rows)
