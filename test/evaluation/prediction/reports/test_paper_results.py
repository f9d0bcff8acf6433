import re

import numpy as np
import pytest
from repository import SHARED

from siren_ros.evaluation.prediction.reports.paper_results import PAPER, TEMPLATES, paper_value

PAPER_SOURCE = SHARED / "paper" / "siren.tex"


@pytest.mark.parametrize("key", PAPER, ids="-".join)
def test_the_printed_mean_is_that_of_the_templates(key: tuple[str, str]) -> None:
    row = PAPER[key]
    assert tuple(row.by_template) == TEMPLATES
    assert np.mean(list(row.by_template.values())) == pytest.approx(row.mean, abs=0.0101)


def test_values_that_the_paper_does_not_have() -> None:
    assert paper_value("cv", "ade_m", "S6") == 2.86
    assert paper_value("cv", "ade_m", "mine") is None
    assert paper_value("cv", "min_ade_6_m", "S6") is None


@pytest.mark.skipif(not PAPER_SOURCE.is_file(), reason="the paper's source is not here")
@pytest.mark.parametrize("model", ["cv", "idm"])
def test_the_values_are_the_papers(model: str) -> None:
    rows = re.findall(
        rf"^{model.upper()}\s*((?:&[^&\\]*)+)\\\\", PAPER_SOURCE.read_text(encoding="utf-8"), re.MULTILINE
    )
    cells = [[cell.strip() for cell in row.split("&")[1:]] for row in rows]
    (pairs,) = [row for row in cells if len(row) == 8 and "/" in row[0]]
    (singles,) = [row for row in cells if len(row) == 8 and re.fullmatch(r"[\d.]+", row[0])]
    expected = {
        "ade_m": [c.split("/")[0] for c in pairs],
        "fde_m": [c.split("/")[1] for c in pairs],
        "rmse_5s_m": singles,
    }
    for metric, values in expected.items():
        row = PAPER[model, metric]
        assert [*row.by_template.values(), row.mean] == [float(value) for value in values]
