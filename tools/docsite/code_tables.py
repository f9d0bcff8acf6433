"""Tables of documents whose texts the code has: nodes and their parameters, templates, formats, metrics of yielding."""

import ast
import inspect
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields
from functools import partial
from pathlib import Path
from typing import Any, Final

import siren_ros
from docsite.house import sizes_table
from docsite.template_tables import entries, template_table
from docsite.topic_tables import SECTIONS, texts_of, topic_table
from siren_ros.data.datasets.formats import FORMATS
from siren_ros.lab.learning.options import TERMS, EnvOptions
from siren_ros.lab.learning.rollout import Seat
from siren_ros.lab.reproduction.make import read_parts, shown_minutes
from siren_ros.lab.reproduction.results import PartResult, read_results
from siren_ros.reports.exam.monitors import MONITORS
from siren_ros.running.seat.policy import EMV, NEIGHBOUR, NEIGHBOURS, OWN
from siren_ros.scoring.evaluation.prediction.predictors import PREDICTORS
from siren_ros.scoring.evaluation.prediction.reported_tracks import TrackNoise
from siren_ros.scoring.evaluation.yielding.encounters import YieldThresholds
from siren_ros.scoring.evaluation.yielding.metrics import DRIVER_METRICS, EPISODE_METRICS
from siren_ros.scoring.judging.verify import CHECKS, VerifyLimits
from siren_ros.simulation.scenario import paper
from siren_ros.simulation.scenario.driver_parameters import DRIVER_PARAMETERS
from siren_ros.simulation.scenario.episode import Split
from siren_ros.simulation.scenario.paper import PAPER_CONSTANTS, PAPER_SPEEDS, TEMPLATES
from siren_ros.simulation.scenario.templates import available_templates, load_template

_PLAIN_TYPES: Final = re.compile(r" Allowed: (a string|a list of strings|true or false)\.$")
_NODES_FILE: Final = Path(__file__).resolve().parents[2] / "params" / "nodes.yaml"
_TEMPLATES: Final = _NODES_FILE.with_name("templates")


def node_table(node: str) -> str:
    """The parameters of a node as Markdown, from ``params/nodes.yaml``: name, default, meaning.

    Raises:
        KeyError: The file has no such node.
    """
    head = f"{node}.ros__parameters."
    parameters = [entry for entry in entries(_NODES_FILE.read_text(encoding="utf-8")) if entry.path.startswith(head)]
    if not parameters:
        raise KeyError(node)
    rows = [
        f"| `{entry.path.removeprefix(head)}` | {_shown(entry.value)} | {_PLAIN_TYPES.sub('', entry.comment)} |"
        for entry in parameters
    ]
    return "\n".join(["| parameter | default | meaning |", "|---|---|---|", *rows])


def _shown(default: object) -> str:
    if default in ("", []):
        return ""
    return f"`{str(default).lower()}`" if isinstance(default, bool) else f"`{default}`"


def nodes_table() -> str:
    """The nodes as Markdown, from the first lines of their files: name, task."""
    nodes = sorted((_NODES_FILE.parents[1] / "nodes").glob("[!_]*.py"))
    lines = [(ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").splitlines()[0] for path in nodes]
    rows = [f"| {line.replace('``', '`').replace(': ', ' | ', 1).removesuffix('.')} |" for line in lines]
    return "\n".join(["| node | task |", "|---|---|", *rows])


def formats_table() -> str:
    """The formats of datasets as Markdown: name with a link to its section, content, what a bag must hold."""
    rows = [f"| [{name}](#{name}) | {entry.summary} | {', '.join(entry.needs)} |" for name, entry in FORMATS.items()]
    return "\n".join(["| format | content | a bag needs |", "|---|---|---|", *rows])


def templates_table() -> str:
    """The templates as Markdown: name with a link to its page, level, interaction, kind of site."""
    templates = map(load_template, available_templates())
    rows = [
        f"| [{t.template_id}]({t.template_id}.md) | {t.level.name} | {t.title} | `{t.site_kind.name}` |"
        for t in templates
    ]
    return "\n".join(["| template | level | interaction | site |", "|---|---|---|---|", *rows])


def drivers_table() -> str:
    """The parameters of drivers as Markdown: name, default, range, meaning."""
    rows = [
        f"| `{name}` | {'' if part.default is None else f'{part.default:.5g}'} | {part.minimum:g} to {part.maximum:g} "
        f"| {part.meaning} |"
        for name, part in DRIVER_PARAMETERS.items()
    ]
    return "\n".join(["| parameter | default | range | meaning |", "|---|---|---|---|", *rows])


def yield_table() -> str:
    """The metrics of yielding as Markdown, of an episode and then of one driver."""
    rows = [f"| `{metric.name}` | {metric.meaning} |" for metric in EPISODE_METRICS]
    driver_rows = [f"| `{metric.name}` | {metric.meaning} |" for metric in DRIVER_METRICS]
    heads = [["| of an episode | |", "|---|---|"], ["", "| of a driver | |", "|---|---|"]]
    return "\n".join([*heads[0], *rows, *heads[1], *driver_rows])


def monitors_table() -> str:
    """The monitors of the exam as Markdown: name, the first sentence of what they do, unit, and a clause's numbers."""
    rows = [
        f"| `{name}` | {_sentences(monitor.find)} | {monitor.unit} | {', '.join(map('`{}`'.format, monitor.numbers))} |"
        for name, monitor in MONITORS.items()
    ]
    return "\n".join(["| monitor | value | unit | numbers |", "|---|---|---|---|", *rows])


def rewards_table() -> str:
    """The terms of the reward of the learning environments as Markdown: name, meaning, unit, weights, clause."""
    rows = [
        f"| `{name}` | {term.meaning} | {term.unit} | {' | '.join(f'{term.weights[seat]:g}' for seat in Seat)} "
        f"| {f'`{term.clause}`' if term.clause else ''} |"
        for name, term in TERMS.items()
    ]
    head = f"| term | meaning | unit | {' | '.join(f'weight, {seat}' for seat in Seat)} | clause |"
    return "\n".join([head, "|---|---|---|---|---|---|", *rows])


def features_table() -> str:
    """The numbers of the vector that the learning environments give as Markdown: place, name, meaning, scale."""
    rows, begin = [], 0
    for part, times in ((OWN, 1), (EMV, 1), (NEIGHBOUR, NEIGHBOURS)):
        for number, feature in enumerate(part, begin):
            places = f"{number}" if times == 1 else f"{number} + {len(part)}k"
            scale = f"{feature.scale:.4g} {feature.unit}".strip()
            rows.append(f"| {places} | `{feature.name}` | {feature.meaning} | {scale} |")
        begin += times * len(part)
    return "\n".join(["| number | name | meaning | 1 stands for |", "|---|---|---|---|", *rows])


def _sentences(function: Callable[..., object]) -> str:
    """The docstring of a function in one line."""
    return " ".join(str(inspect.getdoc(function)).split()).replace("``", "`")


def values_table(parameters: object) -> str:
    """The fields of a dataclass as Markdown: name, value, meaning, with the unit in the name."""
    kind = type(parameters)
    texts = texts_of(inspect.getsource(sys.modules[kind.__module__]), kind.__name__)
    rows = [f"| `{name}` | {getattr(parameters, name):g} | {text.replace('``', '`')} |" for name, text in texts.items()]
    return "\n".join(["| name | value | meaning |", "|---|---|---|", *rows])


def options_table(kind: type) -> str:
    """The options of a dataclass as Markdown: name, default, meaning."""
    texts = texts_of(inspect.getsource(sys.modules[kind.__module__]), kind.__name__)
    rows = [
        f"| `{one.name}` | {_shown(_default(one))} | {texts.get(one.name, '').replace('``', '`')} |"
        for one in fields(kind)
    ]
    return "\n".join(["| option | default | meaning |", "|---|---|---|", *rows])


def _default(field: Field[Any]) -> object:
    return "" if field.default in (None, MISSING) else field.default


def checks_table() -> str:
    """The checks of a recorded episode as Markdown: name, what holds."""
    rows = [f"| `{name}` | {text} |" for name, text in CHECKS.items()]
    return "\n".join(["| check | holds when |", "|---|---|", *rows])


def library_table() -> str:
    """The public names of the library as Markdown, functions first: name, first line of its text."""
    texts = {name: inspect.getdoc(getattr(siren_ros, name)) or "" for name in siren_ros.__all__}
    rows = [f"| `{name}` | {texts[name].splitlines()[0].replace('``', '`')} |" for name in sorted(texts, key=_is_class)]
    return "\n".join(["| name | what it is |", "|---|---|", *rows])


def _is_class(name: str) -> bool:
    return name[0].isupper()


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


def _results() -> dict[str, PartResult]:
    return read_results(_NODES_FILE.parents[1] / "docs" / "results.json")


def reproduction_table() -> str:
    """The parts of ``siren reproduce`` as Markdown: what each is, how long it takes, what made the figures shown."""
    repository = _NODES_FILE.parents[1]
    parts = read_parts(repository / "params" / "reproduction.yaml", repository)
    results = _results()
    rows: list[str] = []
    for part in parts.values():
        result = results.get(part.name)
        card = result.machine if result is not None else {}
        sha = result.inputs_sha256[:8] if result is not None else ""
        load = f"{card['load']} on {card['cores']} cores" if "load" in card else ""
        rows.append(f"| `{part.name}` | {part.about} | {shown_minutes(part.minutes)} | {sha} | {load} |")
    total = shown_minutes(sum(part.minutes for part in parts.values()))
    head = ["| part | what | time, two cores | hash | load |", "|---|---|---|---|---|"]
    return "\n".join([*head, *rows, f"| all | | {total} | | |"])


_MODEL_FIGURES: Final = {
    "ADE": "{}.ade_m",
    "with a tracker's errors": "tracker.{}.ade_m",
    "EMV": "{}.emv.ade_m",
    "civilians": "{}.civilians.ade_m",
    "moving": "{}.moving_civilians.ade_m",
    "yield or hold": "{}.yield_or_hold.ade_m",
    "manoeuvre begins": "{}.manoeuvre_begins.ade_m",
    "world minFDE₆": "{}.world_min_fde_6_m",
    "off road": "{}.off_road_rate",
    "wrong way": "{}.wrong_way_rate",
    "infeasible": "{}.infeasible_rate",
}
"""Columns of the table of predictors, and the figures of the part ``prediction`` in them."""


def prediction_table() -> str:
    """The predictors that the part ``prediction`` has scored as Markdown; a figure that it has not made is empty."""
    figures = _results()["prediction"].figures
    models = [name for name in PREDICTORS if f"{name}.ade_m" in figures]
    rows = []
    for model in models:
        values = [figures.get(name.format(model)) for name in _MODEL_FIGURES.values()]
        cells = ["" if value is None else f"{value:.2f}" for value in values]
        rows.append(f"| `{model}` | {' | '.join(cells)} |")
    return "\n".join([f"| | {' | '.join(_MODEL_FIGURES)} |", "|---" * (1 + len(_MODEL_FIGURES)) + "|", *rows])


_CLAIMS: Final = {**{name: f"claims.siren.{name}.ade_m" for name in TEMPLATES}, "mean": "claims.siren.ade_m"}
"""Beginnings of the figures that compare ``siren`` with the best simple baseline, by template."""


def claims_table() -> str:
    """``siren`` against the best simple baseline of each template as Markdown; without rows until it has been made."""
    figures = _results()["prediction"].figures
    rows = []
    for name, head in _CLAIMS.items():
        if head in figures:
            best, error, share, chance = (figures[f"{head}.{key}"] for key in _CLAIM)
            rows.append(f"| {name} | `{best}` | {error:.2f} | {figures[head]:+.2f} | {share:+.0%} | {chance:.2g} |")
    return "\n".join(
        ["| | best simple | its ADE | siren minus it | share | p (Holm) |", "|---|---|---|---|---|---|", *rows]
    )


_COMPARED: Final = {"town": "prediction", "Town07": "prediction_unseen_map", "Town10HD_Opt": "prediction_paper_map"}
"""Maps on which ``siren`` is compared with simple baselines, and the parts that do it."""


def shares_table() -> str:
    """Error of ``siren`` minus that of the best simple baseline, over the latter, by template and map as Markdown."""
    results = _results()
    columns = {
        name + suffix: (results[part].figures, prefix)
        for name, part in _COMPARED.items()
        if part in results
        for suffix, prefix in (("", ""), (", with a tracker's errors", "tracker."))
    }
    rows = []
    for label, head in _CLAIMS.items():
        shares = [figures.get(f"{prefix}{head}.share") for figures, prefix in columns.values()]
        if any(share is not None for share in shares):
            rows.append(f"| {label} | {' | '.join('' if share is None else f'{share:+.0%}' for share in shares)} |")
    return "\n".join([f"| | {' | '.join(columns)} |", "|---" * (1 + len(columns)) + "|", *rows])


_CLAIM: Final = ("against", "against_value", "share", "p_holm")


def train_prediction_table() -> str:
    """Errors by map when the predictor was trained as Markdown, from the part ``train_prediction``."""
    figures = _results()["train_prediction"].figures
    rows = []
    for split in (Split.TEST_SEED, Split.TEST_MAP):
        for name in sorted(figures):
            if name.startswith(f"{split.value}.") and name.endswith(".cv"):
                head = name.removesuffix("cv")
                errors = " | ".join(f"{figures[head + model]:.2f}" for model in ("cv", "idm", "siren", "siren_min6"))
                place = head.split(".")[1]
                rows.append(f"| `{place}` | {split.value} | {figures[head + 'episodes']:.0f} | {errors} |")
    return "\n".join(["| | | episodes | cv | idm | siren | minADE₆ |", "|---|---|---|---|---|---|---|", *rows])


def predictors_table() -> str:
    """The table of predictors as Markdown: name, what it is, whether it needs weights."""
    rows = [f"| `{name}` | {kind.summary} | {kind.checkpoint.value} |" for name, kind in PREDICTORS.items()]
    return "\n".join(["| model | what it is | checkpoint |", "|---|---|---|", *rows])


TABLES: Final[Mapping[str, Callable[[], str]]] = {
    "nodes": nodes_table,
    "cosim": partial(node_table, "cosim"),
    "sizes": partial(sizes_table, _NODES_FILE.parents[1] / "docs" / "sizes.json"),
    "templates": templates_table,
    "formats": formats_table,
    "drivers": drivers_table,
    "yield": yield_table,
    "yield_thresholds": partial(values_table, YieldThresholds()),
    "monitors": monitors_table,
    "rewards": rewards_table,
    "features": features_table,
    "learning_options": partial(options_table, EnvOptions),
    "checks": checks_table,
    "check_limits": partial(values_table, VerifyLimits()),
    "library": library_table,
    "paper": paper_table,
    "reproduction": reproduction_table,
    "prediction_models": prediction_table,
    "prediction_claims": claims_table,
    "prediction_shares": shares_table,
    "train_prediction": train_prediction_table,
    "predictors": predictors_table,
    "track_noise": partial(values_table, TrackNoise()),
    **{f"{section}_topics": partial(topic_table, section) for section in SECTIONS},
    **{f"{file.stem}_parameters": partial(template_table, file) for file in sorted(_TEMPLATES.glob("*.yaml"))},
}
"""What stands behind ``<!-- table of NAME -->`` in a document, by name."""
