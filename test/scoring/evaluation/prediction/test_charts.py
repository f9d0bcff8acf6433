"""Charts of scores and what charts share; pictures of a bag: which files there are, and what the panels show."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from busy_record import busy_record
from drawn_figures import shown
from known_outputs import assert_known
from made_scores import episode_scores, model_scores
from PIL import Image

from siren_ros.cli.main import main
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction import charts
from siren_ros.scoring.evaluation.prediction.charts import (
    DPI,
    SamplePanel,
    chosen_samples,
    colour_of_model,
    draw_horizon,
    draw_reliability,
    new_figure,
    save,
)
from siren_ros.scoring.evaluation.prediction.predictors import predictors_named
from siren_ros.scoring.evaluation.prediction.reports.score_table import score_table
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.scoring.evaluation.prediction.scoring import score_episode


def test_models_differ_in_their_colours_until_there_are_many() -> None:
    models = [f"model{number}" for number in range(11)]
    colours = [colour_of_model(models, model) for model in models]
    assert len(set(colours[:9])) == 9
    assert colours[9:] == colours[:2]


def test_a_figure_has_its_size_in_the_file(tmp_path) -> None:
    save(new_figure(3.0, 2.0), tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (3 * DPI, 2 * DPI)
    with pytest.raises(InputError, match="deep"):
        save(new_figure(3.0, 2.0), tmp_path / "deep" / "a.png")


def test_a_report_has_its_pictures(tmp_path, write_bag, capsys) -> None:
    bag = write_bag(tmp_path / "S2_L2_seed0", duration_s=9.0)
    words = ["evaluate", "prediction", str(bag), "--models=cv,idm", "--population=all"]
    assert main([*words, "--pictures", "--out", str(tmp_path / "out")]) == 0
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {"horizon.png", "samples_S2.png"}
    picture = np.asarray(Image.open(tmp_path / "out" / "samples_S2.png").convert("RGB"))
    for model in ("cv", "idm"):
        colour = np.array([int(colour_of_model(["cv", "idm"], model)[at : at + 2], 16) for at in (1, 3, 5)])
        assert (np.abs(picture.astype(int) - colour).max(axis=-1) < 12).sum() > 300, "its paths are there"
    capsys.readouterr()
    assert main([*words, "--pictures"]) == 2
    assert "together with --out DIR" in capsys.readouterr().err


def test_best_median_and_worst_of_all_episodes_of_a_template() -> None:
    first, second = model_scores(np.array([5.0, 1.0, 3.0])), model_scores(np.array([2.0, 9.0]))
    table = score_table([episode_scores("S1", {"cv": first}), episode_scores("S1", {"cv": second}, 1)])
    chosen = [(sample.rank, sample.ade_m, sample.episode, sample.step) for sample in chosen_samples(table)]
    assert chosen == [("best", 1.0, 0, 2), ("median", 3.0, 0, 4), ("worst", 9.0, 1, 2)]
    assert {sample.actor_id for sample in chosen_samples(table)} == {1}


def test_vehicles_that_stand_are_not_drawn() -> None:
    scores = replace(model_scores(np.array([0.0, 4.0, 6.0])), moved_m=np.array([0.0, 5.0, 30.0]))
    still = replace(model_scores(np.array([0.0])), moved_m=np.array([4.9]))
    table = score_table([episode_scores("S1", {"cv": scores}), episode_scores("S2", {"cv": still})])
    chosen = [(sample.template, sample.rank, sample.ade_m) for sample in chosen_samples(table)]
    assert chosen == [("S1", "best", 4.0), ("S1", "median", 6.0), ("S1", "worst", 6.0)]


def test_everything_that_charts_and_samples_of_a_busy_episode_show() -> None:
    record, models = busy_record(), predictors_named(["cv", "imm"])
    table = score_table([score_episode("busy", record, models, Population.ALL)])
    samples, panels = samples_of(record, HistoryWindow(), Population.ALL), []
    for chosen in chosen_samples(table):
        batch = samples.batch
        row = np.flatnonzero((batch.sample_step == chosen.step) & (batch.actor_id == chosen.actor_id))
        answer = models[chosen.model].predict(batch).select(row)
        panels.append(SamplePanel(chosen, record, samples.select(row), answer))
    found = {
        "horizon": shown(draw_horizon(table)),
        "reliability": shown(draw_reliability(table)),
        "samples": shown(charts.draw_template("S3", panels[::3], table.models)),
    }
    assert_known(Path(__file__).parent / "known" / "charts.json", found, digits=4, decimals=2)
