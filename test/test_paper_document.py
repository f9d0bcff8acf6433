"""``docs/paper.md`` held against the code: the symbols that it names exist, and its numbers are the code's."""

import ast
import re

import pytest
from repository import REPOSITORY
from test_architecture import names_defined_in

from siren_ros.scenario.paper_constants import PAPER_CONSTANTS, PAPER_SPEEDS

TEXT = re.sub(r"\s+", " ", (REPOSITORY / "docs" / "paper.md").read_text(encoding="utf-8"))
OWNERS = {
    "ControlConstants": PAPER_CONSTANTS,
    "GapEscapeConstants": PAPER_CONSTANTS.gap_escape,
    "TargetSpeeds": PAPER_SPEEDS,
}


@pytest.mark.parametrize(("path", "symbol"), sorted(set(re.findall(r"`(siren_ros/[\w/]+\.py)` `([\w.]+)`", TEXT))))
def test_symbols_are_where_the_document_says(path: str, symbol: str) -> None:
    inside = ast.parse((REPOSITORY / path).read_text(encoding="utf-8")).body
    for name in symbol.split("."):
        names = names_defined_in(inside)
        assert name in names
        inside = names[name]


def test_every_constant_has_its_row_with_its_value() -> None:
    found = {symbol: float(value) for value, symbol in re.findall(r"\| ([\d.]+) \| `([\w.]+)` \|", TEXT)}
    for symbol, value in found.items():
        owner, name = symbol.split(".")
        assert getattr(OWNERS[owner], name) == pytest.approx(value, rel=5e-4)
    for owner, constants in OWNERS.items():
        numbers = {f"{owner}.{name}" for name, value in vars(constants).items() if isinstance(value, float)}
        assert numbers == {symbol for symbol in found if symbol.startswith(f"{owner}.")}


@pytest.mark.parametrize("algorithm", ["Algorithm 1", "Algorithm 2"])
def test_every_line_of_an_algorithm_says_where_and_whether(algorithm: str) -> None:
    lines = (REPOSITORY / "docs" / "paper.md").read_text(encoding="utf-8").split(f"## {algorithm}")[1].split("\n## ")[0]
    rows = [[cell.strip() for cell in row.strip("|").split("|")] for row in lines.splitlines() if row.startswith("| ")]
    rows = rows[2:]
    assert len(rows) > 15
    for row in rows:
        assert re.search(r"`siren_ros/[\w/]+\.py`", row[1])
        if not row[0].startswith("**("):
            assert row[2] in {"same", "decided", "different", ""}
