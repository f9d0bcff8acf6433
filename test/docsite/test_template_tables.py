from pathlib import Path

import pytest
from repository import REPOSITORY

from docsite.template_tables import Entry, entries, template_table
from siren_ros.simulation.scenario.scenario import PEOPLE, VARIETY
from siren_ros.simulation.scenario.templates import load_template

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


def test_comments_belong_to_the_key_below_and_to_the_number_after_a_word() -> None:
    by_path = {entry.path: entry for entry in entries(TEXT)}
    assert by_path["duration_s"] == Entry("duration_s", {"default": 40.0, "range": [25.0, 45.0]}, "s")
    assert by_path["emv"] == Entry("emv", None, "")
    assert by_path["emv.start_m"].comment == "m, from the line"
    assert by_path["demand.number"].comment == ""
    assert by_path["id"].comment == "heading of two lines"


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
