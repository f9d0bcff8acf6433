"""Charts of scores and what charts share; pictures of a bag: which files there are, and what the panels show."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from busy_record import busy_record
from drawn_figures import shown
from known_outputs import assert_known
from made_records import moving, record_with
from made_scores import episode_scores, model_scores, reported_scores
from matplotlib.axes import Axes
from PIL import Image

from siren_ros.cli.main import main
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction import charts
from siren_ros.scoring.evaluation.prediction.charts import (
    DPI,
    PAST,
    TRUTH,
    ChosenSample,
    SamplePanel,
    chosen_samples,
    colour_of_model,
    draw_horizon,
    draw_reliability,
    draw_sample,
    new_figure,
    save,
)
from siren_ros.scoring.evaluation.prediction.metrics import reliability_of
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses, predictors_named
from siren_ros.scoring.evaluation.prediction.reports.score_table import score_table
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.scoring.evaluation.prediction.scoring import score_episode


def test_models_differ_in_their_colours_until_there_are_many() -> None:
    models = [f"model{number}" for number in range(11)]
    colours = [colour_of_model(models, model) for model in models]
    assert len(set(colours[:9])) == 9
    assert colours[9:] == colours[:2]


@pytest.fixture
def axes() -> Axes:
    return new_figure(3.0, 3.0).add_subplot()


def test_a_figure_has_its_size_in_the_file(tmp_path) -> None:
    save(new_figure(3.0, 2.0), tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (3 * DPI, 2 * DPI)
    with pytest.raises(InputError, match="deep"):
        save(new_figure(3.0, 2.0), tmp_path / "deep" / "a.png")


def test_a_line_for_each_model_with_samples_is_their_mean_from_the_present_on() -> None:
    """Every sample is off by 0, 1, 2 … m at the points of the grid."""
    (axes,) = draw_horizon(score_table(reported_scores())).axes
    for line in axes.lines:
        x, y = np.asarray(line.get_xydata()).T
        assert x == pytest.approx(0.2 * np.arange(26))
        assert y == pytest.approx([0.0, *range(25)])
    assert [line.get_label() for line in axes.lines] == ["cv", "net:v_1"]
    none = score_table([episode_scores("S1", {"net": model_scores(np.array([]))})])
    assert not draw_horizon(none).axes[0].lines


def test_models_that_state_probabilities_are_drawn() -> None:
    paths = np.zeros((4, 2, 25, 2))
    paths[:3, 1] = 5.0
    paths[3:, 0] = 5.0
    stated = reliability_of(Hypotheses(paths, np.tile([0.9, 0.1], (4, 1))), np.zeros((4, 25, 2)))
    models = {"cv": model_scores(np.ones(4)), "net": replace(model_scores(np.ones(4)), reliability=stated)}
    (axes,) = draw_reliability(score_table([episode_scores("S1", models)])).axes
    diagonal, line = axes.lines
    assert diagonal.get_xydata().tolist() == [[0.0, 0.0], [1.0, 1.0]]
    assert line.get_xydata() == pytest.approx(np.array([[0.1, 0.25], [0.9, 0.75]]))
    assert line.get_label() == "net (error 0.15)"
    (dots,) = axes.collections
    assert np.asarray(dots.get_offsets()) == pytest.approx(line.get_xydata())
    assert dots.get_sizes() == pytest.approx(np.full(2, 8.0 + 90.0 * np.sqrt(0.5))), "half of the hypotheses each"
    assert draw_reliability(score_table([episode_scores("S1", {"cv": model_scores(np.ones(4))})])) is None


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


COLOUR = "#123456"


def drawn(axes: Axes, colour: str) -> list[np.ndarray]:
    return [np.asarray(line.get_xydata()) for line in axes.lines if line.get_color() == colour]


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


def panel_of(network, speed_mps=6.0, *, model="cv", rank="median", ahead_mps=5.0, aside_mps=2.0):
    """A vehicle to the east at 3 s; one hypothesis goes straight on, the other to the north."""
    record = record_with({7: moving(10.0, -5.25, speed_mps)}, network)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    velocity_mps = np.array([(ahead_mps, 0.0), (0.0, aside_mps)])
    paths = samples.batch.xy_m[0] + 0.2 * np.arange(1, 26)[:, None] * velocity_mps[:, None]
    chosen = ChosenSample(model, "S2", rank, 0, 60, 7, 2.345)
    return SamplePanel(chosen, record, samples, Hypotheses(paths[None], np.array([[0.8, 0.2]])))


def test_lines_are_the_past_the_truth_and_the_hypotheses(straight_road, axes) -> None:
    draw_sample(axes, panel_of(straight_road), COLOUR)
    (past,), (truth,) = drawn(axes, PAST), drawn(axes, TRUTH)
    # 3 s at 6 m/s before 28 m, and 5 s after it.
    assert past[:, 0] == pytest.approx(28.0 + 6.0 * 0.2 * np.arange(-15, 1))
    assert truth[:, 0] == pytest.approx(28.0 + 6.0 * 0.2 * np.arange(26))
    assert set(np.round(truth[:, 1], 6)) == {-5.25}
    aside, ahead = drawn(axes, COLOUR)
    assert ahead[:, 0] == pytest.approx(28.0 + 0.2 * 5.0 * np.arange(26)), "the most probable one lies on top"
    assert aside[:, 1] == pytest.approx(-5.25 + 0.2 * 2.0 * np.arange(26))
    assert [line.get_alpha() for line in axes.lines if line.get_color() == COLOUR] == pytest.approx([0.25, 1.0])
    ends = [np.asarray(dots.get_offsets())[0].tolist() for dots in axes.collections if len(dots.get_offsets()) == 1]
    for end_m in ([58.0, -5.25], [53.0, -5.25], [28.0, 4.75]):
        assert any(end == pytest.approx(end_m) for end in ends), "the truth's, the first hypothesis', the second's"


def test_the_frame_is_a_square_around_past_truth_and_first_hypothesis(straight_road, axes) -> None:
    """From 10 to 58 m, and 8 m on each side; a short way with forty metres around it."""
    draw_sample(axes, panel_of(straight_road), COLOUR)
    assert axes.get_xlim() == pytest.approx((2.0, 66.0))
    assert axes.get_ylim() == pytest.approx((-5.25 - 32.0, -5.25 + 32.0))
    draw_sample(axes, panel_of(straight_road, 1.0, ahead_mps=0.0, aside_mps=0.0), COLOUR)
    assert axes.get_xlim() == pytest.approx((14.0 - 20.0, 14.0 + 20.0))


MODELS = ("cv", "none", "net")
"""The second has no sample."""


def test_a_row_for_each_model_and_a_column_for_each_rank(straight_road, monkeypatch) -> None:
    order = [("cv", "best"), ("cv", "median"), ("cv", "worst"), ("net", "median")]
    panels = [panel_of(straight_road, model=model, rank=rank) for model, rank in order]
    drawn: list[tuple[Axes, SamplePanel, str]] = []
    monkeypatch.setattr(charts, "draw_sample", lambda *given: drawn.append(given))
    figure = charts.draw_template("S2", panels, MODELS)

    assert [panel.chosen for _, panel, _ in drawn] == [panel.chosen for panel in panels]
    assert [colour for *_, colour in drawn] == [colour_of_model(MODELS, model) for model, _ in order]
    places = [axes.get_subplotspec() for axes, *_ in drawn]
    assert [(place.rowspan.start, place.colspan.start) for place in places] == [(0, 0), (0, 1), (0, 2), (1, 1)]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["past", "truth", "cv", "net"]


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
