"""On which maps our episodes are, next to the paper's."""

import re
from dataclasses import replace

import numpy as np
import pytest
from made_scores import episode_scores, model_scores
from repository import shared_file

from siren_ros.scoring.evaluation.prediction.reports.paper_results import (
    PAPER,
    PAPER_MAP,
    PAPER_NAMES,
    PAPER_SAMPLES,
    maps_next_to_the_papers,
    paper_row,
)
from siren_ros.simulation.scenario.paper import TEMPLATES


@pytest.mark.parametrize(
    ("maps", "text"),
    [
        (["town", "town"], "map: town (2); the paper's is Town10HD_Opt"),
        ([PAPER_MAP], "map: Town10HD_Opt, the paper's"),
        (["town", PAPER_MAP, "town"], "maps, pooled: Town10HD_Opt (1), town (2); the paper's is Town10HD_Opt"),
    ],
)
def test_the_maps_are_named_with_their_episodes(maps, text) -> None:
    episode = episode_scores("S1", {"cv": model_scores(np.ones(2))})
    assert maps_next_to_the_papers([replace(episode, map_name=name) for name in maps]) == text


@pytest.fixture(scope="module")
def paper_source() -> str:
    return shared_file("paper", "siren.tex").read_text(encoding="utf-8")


@pytest.mark.parametrize("key", PAPER, ids="-".join)
def test_the_printed_mean_is_that_of_the_templates(key) -> None:
    row = PAPER[key]
    assert tuple(row) == (*TEMPLATES, "all")
    assert np.mean([row[template] for template in TEMPLATES]) == pytest.approx(row["all"], abs=0.0101)


def test_values_that_the_paper_does_not_have() -> None:
    assert paper_row("cv", "ade_m")["S6"] == 2.86
    assert paper_row("csp:mine", "ade_m")["S6"] == 4.63
    assert "mine" not in paper_row("cv", "ade_m")
    assert paper_row("cv", "miss_rate_6") == {}
    assert paper_row("lstm", "ade_m") == {}
    assert PAPER["csp", "min_ade_6_m"] == PAPER["csp", "ade_m"], "one hypothesis"
    metrics = {"ade_m", "fde_m", "rmse_5s_m", "min_ade_6_m", "min_fde_6_m"}
    assert set(PAPER) == {(model, metric) for model in PAPER_NAMES for metric in metrics}


@pytest.mark.parametrize("model", PAPER_NAMES)
def test_the_values_are_the_papers(model, paper_source) -> None:
    name = re.escape(PAPER_NAMES[model])
    rows = re.findall(
        rf"^{name}(?:\$\^.*?\$)?\s*((?:&[^&\\]*(?:\\textbf{{[^}}]*}}[^&\\]*)?)+)\\\\", paper_source, re.MULTILINE
    )
    values = [[re.sub(r"\\textbf{(.*?)}", r"\1", cell).strip() for cell in row.split("&")[1:]] for row in rows]
    numbers = [row for row in values if len(row) == 8 and re.fullmatch(r"[\d./]+", row[0])]
    (pairs,) = [row for row in numbers if "/" in row[0]]
    singles = [[float(cell) for cell in row] for row in numbers if "/" not in row[0]]
    tables = [[float(cell.split("/")[place]) for cell in pairs] for place in (0, 1)] + singles
    names = ("ade_m", "fde_m", "rmse_5s_m", "min_ade_6_m", "min_fde_6_m")
    assert len(tables) in (3, 5)
    for metric, printed in zip(names, tables, strict=False):
        assert list(PAPER[model, metric].values()) == printed


def test_the_map_and_the_samples_are_the_papers(paper_source) -> None:
    assert rf"\texttt{{{PAPER_MAP}}}".replace("_", r"\_") in paper_source
    printed = "/".join(f"{count:,}".replace(",", "{,}") for count in PAPER_SAMPLES.values())
    assert f"({printed} for S1--S7)" in paper_source
