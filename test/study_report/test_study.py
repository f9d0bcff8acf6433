import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from siren_ros.errors import InputError
from siren_ros.study_report.study import stored_tables
from siren_ros.tables.table import Table


def tables(content: Mapping[str, Any]) -> Iterator[Table]:
    yield Table("one", "One", ("value",), ((str(content["value"]),),))


def test_the_tables_are_made_from_the_stored_scores(tmp_path: Path) -> None:
    assert stored_tables("risk", tmp_path, tables) is None
    (tmp_path / "scores.json").write_text(json.dumps({"value": 3}), encoding="utf-8")
    assert stored_tables("risk", tmp_path, tables) == (Table("one", "One", ("value",), (("3",),)),)


def test_scores_of_something_else_are_refused(tmp_path: Path) -> None:
    (tmp_path / "scores.json").write_text(json.dumps({"other": 3}), encoding="utf-8")
    with pytest.raises(InputError, match=r"risk.*siren evaluate risk.*value"):
        stored_tables("risk", tmp_path, tables)
