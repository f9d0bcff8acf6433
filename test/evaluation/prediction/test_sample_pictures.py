"""Pictures of a bag: which files there are, and what the panels show."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_records import moving, record_with
from made_scores import episode_scores, model_scores
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from PIL import Image

from siren_ros.cli.main import main
from siren_ros.evaluation.prediction import sample_pictures
from siren_ros.evaluation.prediction.charts import colour_of_model, new_figure
from siren_ros.evaluation.prediction.predictors import Hypotheses
from siren_ros.evaluation.prediction.reports.score_table import score_table
from siren_ros.evaluation.prediction.sample_pictures import (
    PAST,
    TRUTH,
    ChosenSample,
    SamplePanel,
    chosen_samples,
    draw_sample,
)
from siren_ros.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.road_network import RoadNetwork


def test_a_report_has_its_pictures(
    tmp_path: Path, write_bag: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
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


def test_a_panel_shows_the_truth_and_every_hypothesis(record_of: Callable[..., EpisodeRecord]) -> None:
    record = record_of(duration_s=9.0)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([3]))
    batch = samples.batch
    truth = samples.future_xy_m
    paths = np.stack((truth, truth + 1.0, truth - 2.0), axis=1)
    hypotheses = Hypotheses.ranked(paths, np.array([[0.2, 0.7, 0.1]]))
    chosen = ChosenSample("net", "S2", "best", 0, int(batch.sample_step[0]), int(batch.actor_id[0]), 1.0)
    axes = new_figure(4.0, 4.0).add_subplot()
    draw_sample(axes, SamplePanel(chosen, record, samples, hypotheses), "#1a86b8")
    (true,) = [line for line in axes.lines if to_hex(line.get_color()) == TRUTH]
    assert np.allclose(true.get_xydata()[1:], truth[0])
    assert np.allclose(true.get_xydata()[0], batch.xy_m[0])
    drawn = [line for line in axes.lines if to_hex(line.get_color()) == "#1a86b8"]
    assert [round(line.get_alpha(), 3) for line in drawn] == [0.15, 0.286, 1.0], "the most probable on top"
    assert np.allclose(drawn[-1].get_xydata()[1:], truth[0] + 1.0)
    low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
    assert (np.vstack((truth[0], batch.xy_m)) > low).all()
    assert (np.vstack((truth[0], batch.xy_m)) < high).all()


def test_best_median_and_worst_of_all_episodes_of_a_template() -> None:
    first, second = model_scores(np.array([5.0, 1.0, 3.0])), model_scores(np.array([2.0, 9.0]))
    table = score_table([episode_scores("S1", {"cv": first}), episode_scores("S1", {"cv": second}, 1)])
    found = list(chosen_samples(table))
    assert [(one.rank, one.ade_m, one.episode, one.step) for one in found] == [
        ("best", 1.0, 0, 2),
        ("median", 3.0, 0, 4),
        ("worst", 9.0, 1, 2),
    ]
    assert {one.actor_id for one in found} == {1}


def test_vehicles_that_stand_are_not_drawn() -> None:
    scores = replace(model_scores(np.array([0.0, 4.0, 6.0])), moved_m=np.array([0.0, 5.0, 30.0]))
    still = replace(model_scores(np.array([0.0])), moved_m=np.array([4.9]))
    table = score_table([episode_scores("S1", {"cv": scores}), episode_scores("S2", {"cv": still})])
    assert [(one.template, one.rank, one.ade_m) for one in chosen_samples(table)] == [
        ("S1", "best", 4.0),
        ("S1", "median", 6.0),
        ("S1", "worst", 6.0),
    ]


COLOUR = "#123456"


def panel_of(
    network: RoadNetwork,
    speed_mps: float = 6.0,
    *,
    model: str = "cv",
    rank: str = "median",
    is_emv: bool = False,
    ahead_mps: float = 5.0,
    aside_mps: float = 2.0,
) -> SamplePanel:
    """A vehicle to the east at 3 s; one hypothesis goes straight on, the other to the north."""
    record = record_with({7: moving(10.0, -5.25, speed_mps, is_emv=is_emv)}, network)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    velocity_mps = np.array([(ahead_mps, 0.0), (0.0, aside_mps)])
    paths = samples.batch.xy_m[0] + 0.2 * np.arange(1, 26)[:, None] * velocity_mps[:, None]
    chosen = ChosenSample(model, "S2", rank, 0, 60, 7, 2.345)
    return SamplePanel(chosen, record, samples, Hypotheses(paths[None], np.array([[0.8, 0.2]])))


@pytest.fixture
def axes() -> Axes:
    return new_figure(3.0, 3.0).add_subplot()


def drawn(axes: Axes, colour: str) -> list[np.ndarray]:
    return [np.asarray(line.get_xydata()) for line in axes.lines if line.get_color() == colour]


def test_lines_are_the_past_the_truth_and_the_hypotheses(straight_road: RoadNetwork, axes: Axes) -> None:
    panel = panel_of(straight_road)
    draw_sample(axes, panel, COLOUR)
    (past,), (truth,) = drawn(axes, PAST), drawn(axes, TRUTH)
    # 3 s at 6 m/s before 28 m, and 5 s after it.
    assert past[:, 0] == pytest.approx(28.0 + 6.0 * 0.2 * np.arange(-15, 1))
    assert truth[:, 0] == pytest.approx(28.0 + 6.0 * 0.2 * np.arange(26))
    assert set(np.round(truth[:, 1], 6)) == {-5.25}
    aside, ahead = drawn(axes, COLOUR)
    assert ahead[:, 0] == pytest.approx(28.0 + 0.2 * 5.0 * np.arange(26)), "the most probable one lies on top"
    assert aside[:, 1] == pytest.approx(-5.25 + 0.2 * 2.0 * np.arange(26))
    alphas = [line.get_alpha() for line in axes.lines if line.get_color() == COLOUR]
    assert alphas == pytest.approx([0.25, 1.0])
    layers = {colour: max(line.get_zorder() for line in axes.lines if line.get_color() == colour)
              for colour in (PAST, TRUTH, COLOUR)}  # fmt: skip
    assert layers[PAST] < layers[TRUTH] < layers[COLOUR], "hypotheses lie over the truth"
    ends = [np.asarray(one.get_offsets())[0].tolist() for one in axes.collections if len(one.get_offsets()) == 1]
    assert any(end == pytest.approx([58.0, -5.25]) for end in ends), "the truth's end"
    assert any(end == pytest.approx([53.0, -5.25]) for end in ends), "the first hypothesis' end"
    assert any(end == pytest.approx([28.0, 4.75]) for end in ends), "the second one's"


def test_the_frame_is_a_square_around_past_truth_and_first_hypothesis(straight_road: RoadNetwork, axes: Axes) -> None:
    draw_sample(axes, panel_of(straight_road), COLOUR)
    # From 10 to 58 m, and 8 m on each side.
    assert axes.get_xlim() == pytest.approx((2.0, 66.0))
    assert axes.get_ylim() == pytest.approx((-5.25 - 32.0, -5.25 + 32.0))


def test_a_short_way_is_shown_with_forty_metres_around_it(straight_road: RoadNetwork, axes: Axes) -> None:
    draw_sample(axes, panel_of(straight_road, 1.0, ahead_mps=0.0, aside_mps=0.0), COLOUR)
    assert axes.get_xlim() == pytest.approx((14.0 - 20.0, 14.0 + 20.0))


@pytest.mark.parametrize(("is_emv", "who"), [(True, "EMV"), (False, "vehicle 7")])
def test_the_title_says_who_when_and_how_far_off(
    straight_road: RoadNetwork, axes: Axes, is_emv: bool, who: str
) -> None:
    draw_sample(axes, panel_of(straight_road, is_emv=is_emv), COLOUR)
    assert axes.get_title(loc="left") == f"median: ADE 2.35 m, {who} at 3.0 s"


MODELS = ("cv", "none", "net")
"""The second has no sample."""


def test_a_row_for_each_model_and_a_column_for_each_rank(
    straight_road: RoadNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = [("cv", "best"), ("cv", "median"), ("cv", "worst"), ("net", "median")]
    panels = [panel_of(straight_road, model=model, rank=rank) for model, rank in order]
    drawn: list[tuple[Axes, SamplePanel, str]] = []
    monkeypatch.setattr(sample_pictures, "draw_sample", lambda *given: drawn.append(given))
    figure = sample_pictures.draw_template("S2", panels, MODELS)

    assert [panel.chosen for _, panel, _ in drawn] == [panel.chosen for panel in panels]
    assert [colour for *_, colour in drawn] == [colour_of_model(MODELS, model) for model, _ in order]
    places = [axes.get_subplotspec() for axes, *_ in drawn]
    found = [(place.rowspan.start, place.colspan.start) for place in places if place is not None]
    assert found == [(0, 0), (0, 1), (0, 2), (1, 1)]
    assert [axes.get_ylabel() for axes, *_ in drawn] == ["cv", "", "", ""], "at the first of a row"
    assert figure.get_suptitle() == "S2: samples by ADE, of vehicles that move"
    width, height = figure.get_size_inches()
    assert height < width, "two rows, and three columns"
    tops = [axes.get_position().y1 for axes, *_ in drawn]
    assert max(tops) * height == pytest.approx(height - 0.6), "below the heading, however many rows there are"
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["past", "truth", "cv", "net"]
    colours = [to_hex(line.get_color()) for line in legend.get_lines()]
    assert colours == [PAST, TRUTH, colour_of_model(MODELS, "cv"), colour_of_model(MODELS, "net")]
