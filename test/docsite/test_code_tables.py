import re

import pytest
from repository import REPOSITORY

import siren_ros
from docsite.code_tables import TABLES, node_table
from docsite.topic_tables import texts_of
from siren_ros.scoring.evaluation.yielding.metrics import DRIVER_METRICS, EPISODE_METRICS
from siren_ros.scoring.judging.physics import VerifyLimits
from siren_ros.simulation.scenario.driver_parameters import DRIVER_PARAMETERS


def rows(table: str) -> list[list[str]]:
    """The cells of the rows that begin with a name in backticks."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if "| `" in line]


def test_the_table_of_drivers_has_every_parameter_with_its_range() -> None:
    table = rows(TABLES["drivers"]())
    assert [row[0].strip("`") for row in table] == list(DRIVER_PARAMETERS)
    assert ["`emv_driver.driving.comfort_accel_mps2`", "2", "0.8 to 4", "acceleration"] in table


def test_the_table_of_yielding_has_every_metric_of_episodes_then_of_drivers() -> None:
    names = [row[0].strip("`") for row in rows(TABLES["yield"]())]
    assert names == [metric.name for metric in (*EPISODE_METRICS, *DRIVER_METRICS)]


def test_a_node_that_does_not_exist_has_no_table() -> None:
    with pytest.raises(KeyError):
        node_table("no_such_node")


def test_the_table_of_nodes_has_every_node_that_a_user_can_start() -> None:
    nodes = {path.stem for path in (REPOSITORY / "nodes").glob("[!_]*.py")}
    assert {row[0].strip("`") for row in rows(TABLES["nodes"]())} == nodes
    assert all(row[1] for row in rows(TABLES["nodes"]()))


def test_the_table_of_limits_has_every_limit_with_its_value_and_meaning() -> None:
    table = {row[0].strip("`"): row[1:] for row in rows(TABLES["check_limits"]())}
    assert {name: float(row[0]) for name, row in table.items()} == vars(VerifyLimits())
    assert all(row[1] for row in table.values())


def test_the_table_of_the_library_has_every_public_name() -> None:
    assert sorted(row[0].strip("`") for row in rows(TABLES["library"]())) == siren_ros.__all__


def test_the_text_of_a_topic_is_the_one_below_it() -> None:
    source = 'A: int = 1\n"""One."""\nB: int = 2\nC: int = 3\n"""Three."""\n'
    assert texts_of(source) == {"A": "One.", "C": "Three."}


def test_every_table_stands_in_a_document_and_documents_ask_for_no_other() -> None:
    pages = [path.read_text(encoding="utf-8") for path in (REPOSITORY / "docs").rglob("*.md")]
    assert sorted(re.findall(r"<!-- table of (\w+) -->", "\n".join(pages))) == sorted(TABLES)
