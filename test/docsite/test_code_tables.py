"""Tables of documents that come from the code, from parameter files and from templates."""

import re
from pathlib import Path

import pytest
from repository import REPOSITORY

import siren_ros
from docsite.code_tables import TABLES
from docsite.template_tables import template_table
from docsite.topic_tables import texts_of
from siren_ros.scoring.evaluation.yielding.metrics import DRIVER_METRICS, EPISODE_METRICS
from siren_ros.scoring.judging.verify import VerifyLimits
from siren_ros.simulation.scenario.driver_parameters import DRIVER_PARAMETERS
from siren_ros.simulation.scenario.scenario import PEOPLE, VARIETY
from siren_ros.simulation.scenario.templates import load_template


def rows(table: str) -> list[list[str]]:
    """The cells of the rows that begin with a name in backticks."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if "| `" in line]


def test_tables_have_every_parameter_metric_and_public_name() -> None:
    table = rows(TABLES["drivers"]())
    names = {kind: [row[0].strip("`") for row in rows(TABLES[kind]())] for kind in ("drivers", "yield", "library")}
    assert names["drivers"] == list(DRIVER_PARAMETERS)
    assert names["yield"] == [metric.name for metric in (*EPISODE_METRICS, *DRIVER_METRICS)]
    assert sorted(names["library"]) == siren_ros.__all__
    assert ["`emv_driver.driving.comfort_accel_mps2`", "2", "0.8 to 4", "acceleration"] in table


def test_the_tables_of_nodes_and_limits_have_all_with_their_meaning() -> None:
    nodes = {path.stem for path in (REPOSITORY / "nodes").glob("[!_]*.py")}
    assert {row[0].strip("`") for row in rows(TABLES["nodes"]())} == nodes
    assert all(row[1] for row in rows(TABLES["nodes"]()))
    table = {row[0].strip("`"): row[1:] for row in rows(TABLES["check_limits"]())}
    assert {name: float(row[0]) for name, row in table.items()} == vars(VerifyLimits())
    assert all(row[1] for row in table.values())


def test_the_text_of_a_topic_is_the_one_below_it() -> None:
    source = 'A: int = 1\n"""One."""\nB: int = 2\nC: int = 3\n"""Three."""\n'
    assert texts_of(source) == {"A": "One.", "C": "Three."}


def test_every_table_stands_in_a_document_and_documents_ask_for_no_other() -> None:
    pages = [path.read_text(encoding="utf-8") for path in (REPOSITORY / "docs").rglob("*.md")]
    assert sorted(re.findall(r"<!-- table of (\w+) -->", "\n".join(pages))) == sorted(TABLES)


TEXT = """# heading
# of two lines
id: X
# s
duration_s: {default: 40.0, range: [25.0, 45.0]}
emv:
  # m, from the line
  start_from: stop_line
  start_m: {default: -1.5, range: [-3.0, 0.0], draw: [-2.0, -1.0]}
demand:
  number: {default: 2, range: [0, 3]}
  groups:
    # those ahead
    ahead:
      vehicles: {default: 4, range: [2, 8]}
predicate:
  name: shoulder_turn
  # s on the shoulder
  shoulder_min_s: 2.0
"""


def test_the_tables_hold_every_parameter_and_threshold(tmp_path: Path) -> None:
    (tmp_path / "X.yaml").write_text(TEXT)
    assert template_table(tmp_path / "X.yaml").splitlines() == [
        "| parameter | default | range of studies | drawn by every seed | meaning |",
        "|---|---|---|---|---|",
        "| `duration_s` | 40 | 25 to 45 |  | s |",
        "| `emv.start_m` | -1.5 | -3 to 0 | -2 to -1 | m, from the line |",
        "| `demand.number` | 2 | 0 to 3 |  |  |",
        "| `demand.ahead` | | | | *those ahead* |",
        "| `demand.ahead.vehicles` | 4 | 2 to 8 |  |  |",
        "",
        "| threshold | value | meaning |",
        "|---|---|---|",
        "| `predicate.shoulder_min_s` | 2.0 | s on the shoulder |",
    ]


@pytest.mark.parametrize("name", ["S1", "S4", "S7"])
def test_a_templates_table_has_the_parameters_that_the_library_reads(name: str) -> None:
    table = template_table(REPOSITORY / "params" / "templates" / f"{name}.yaml")
    template = load_template(name)
    assert {row.split("`")[1] for row in table.splitlines() if row.startswith("| `") and row.split("|")[2].strip()} == {
        *(template.ranges.keys() - {*PEOPLE, *VARIETY}),
        *(f"predicate.{threshold}" for threshold in template.predicate.thresholds),
    }
