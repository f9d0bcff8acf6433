"""Tables of documents whose texts the code has: parameters of nodes and of the calibration, metrics of yielding."""

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from docsite.template_tables import entries
from docsite.topic_tables import SECTIONS, texts_of, topic_table
from siren_ros.calibration.parameters import PARAMETERS
from siren_ros.evaluation.yielding.metrics import DRIVER_METRICS, EPISODE_METRICS
from siren_ros.reproduction.parts import read_parts, shown_minutes
from siren_ros.reproduction.results import read_results
from siren_ros.scenario import paper
from siren_ros.scenario.paper import PAPER_CONSTANTS, PAPER_SPEEDS

_PLAIN_TYPES: Final = re.compile(r" Allowed: (a string|a list of strings|true or false)\.$")
_NODES_FILE: Final = Path(__file__).resolve().parents[2] / "params" / "nodes.yaml"


def node_table(node: str) -> str:
    """The parameters of a node as Markdown, from ``params/nodes.yaml``: name, default, meaning.

    Raises:
        KeyError: The file has no such node.
    """
    head = f"{node}.ros__parameters."
    found = [entry for entry in entries(_NODES_FILE.read_text(encoding="utf-8")) if entry.path.startswith(head)]
    if not found:
        raise KeyError(node)
    rows = [
        f"| `{entry.path.removeprefix(head)}` | {_shown(entry.value)} | {_PLAIN_TYPES.sub('', entry.comment)} |"
        for entry in found
    ]
    return "\n".join(["| parameter | default | meaning |", "|---|---|---|", *rows])


def _shown(default: object) -> str:
    if default in ("", []):
        return ""
    return f"`{str(default).lower()}`" if isinstance(default, bool) else f"`{default}`"


def calibration_table() -> str:
    """The parameters that can be fitted as Markdown: name, range, meaning."""
    rows = [f"| `{name}` | {part.low:g} to {part.high:g} | {part.meaning} |" for name, part in PARAMETERS.items()]
    return "\n".join(["| parameter | range | meaning |", "|---|---|---|", *rows])


def yield_table() -> str:
    """The metrics of yielding as Markdown, of an episode and then of one driver."""
    rows = [f"| `{metric.name}` | {metric.meaning} |" for metric in EPISODE_METRICS]
    driver_rows = [f"| `{metric.name}` | {metric.meaning} |" for metric in DRIVER_METRICS]
    heads = [["| of an episode | |", "|---|---|"], ["", "| of a driver | |", "|---|---|"]]
    return "\n".join([*heads[0], *rows, *heads[1], *driver_rows])


def paper_table() -> str:
    """The constants and target speeds of the paper as Markdown: meaning, value, name in the code."""
    source = Path(paper.__file__).read_text(encoding="utf-8")
    rows = [
        f"| {text.replace('``', '`').removesuffix('.')} | {getattr(constants, name):.5g} | `{owner}.{name}` |"
        for constants in (PAPER_CONSTANTS, PAPER_CONSTANTS.gap_escape, PAPER_SPEEDS)
        for owner in [type(constants).__name__]
        for name, text in texts_of(source, owner).items()
    ]
    return "\n".join(["| constant | value | in the code |", "|---|---|---|", *rows])


def reproduction_table() -> str:
    """The parts of ``siren reproduce`` as Markdown: what each is, how long it takes, what made the figures shown."""
    repository = _NODES_FILE.parents[1]
    parts = read_parts(repository / "params" / "reproduction.yaml", repository)
    results = read_results(repository / "docs" / "results.json")
    rows = []
    for part in parts.values():
        made = results.get(part.name)
        card = made.machine if made is not None else {}
        sha = made.inputs_sha256[:8] if made is not None else ""
        load = f"{card['load']} on {card['cores']} cores" if "load" in card else ""
        rows.append(f"| `{part.name}` | {part.about} | {shown_minutes(part.minutes)} | {sha} | {load} |")
    total = shown_minutes(sum(part.minutes for part in parts.values()))
    head = ["| part | what | time, two cores | hash | load |", "|---|---|---|---|---|"]
    return "\n".join([*head, *rows, f"| all | | {total} | | |"])


TABLES: Final[Mapping[str, Callable[[], str]]] = {
    "cosim": partial(node_table, "cosim"),
    "calibrate": calibration_table,
    "yield": yield_table,
    "paper": paper_table,
    "reproduction": reproduction_table,
    **{f"{section}_topics": partial(topic_table, section) for section in SECTIONS},
}
"""What stands for ``<!-- table of NAME -->`` in a document, by name."""
_MARK: Final = re.compile(r"<!-- table of (\w+) -->")


def with_tables(markdown: str) -> str:
    """A document with its tables filled in.

    Raises:
        KeyError: It asks for a table that does not exist.
    """
    return _MARK.sub(lambda mark: TABLES[mark[1]](), markdown)
