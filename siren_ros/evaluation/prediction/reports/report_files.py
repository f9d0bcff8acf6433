"""Writes all files of a report into one folder."""

import json
from collections.abc import Sequence
from pathlib import Path

from siren_ros.errors import whole_file, writing
from siren_ros.evaluation.prediction.reports.csv_files import csv_files
from siren_ros.evaluation.prediction.reports.differences import Difference
from siren_ros.evaluation.prediction.reports.json_report import json_report
from siren_ros.evaluation.prediction.reports.latex_tables import latex_tables
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable


def new_folder(path: Path) -> None:
    """Makes the folder of a report; there may be an older report in it, which is replaced.

    Raises:
        InputError: It cannot be made.
    """
    with writing(path, "folder"):
        path.mkdir(parents=True, exist_ok=True)


def write_report(path: Path, table: ScoreTable, found: Sequence[Difference], text: str, compare_paper: bool) -> None:
    """Writes ``report.txt``, ``scores.json``, CSV files and LaTeX tables.

    Raises:
        InputError: The folder cannot be written.
    """
    files = {
        "report.txt": text + "\n",
        "scores.json": json.dumps(json_report(table, found), indent=2, allow_nan=False) + "\n",
        **csv_files(table, found),
        **latex_tables(table, compare_paper),
    }
    with writing(path, "folder"):
        for name, content in files.items():
            with whole_file(path / name) as file:
                file.write_text(content, encoding="utf-8")
