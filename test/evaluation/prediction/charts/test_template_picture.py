"""Which panel stands where, and what the heading and the legend say."""

import numpy as np
import pytest
from made_records import moving, record_with
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from siren_ros.evaluation.prediction.charts import template_picture
from siren_ros.evaluation.prediction.charts.chart import colour_of_model
from siren_ros.evaluation.prediction.charts.sample_choice import ChosenSample
from siren_ros.evaluation.prediction.charts.sample_panel import PAST, TRUTH, SamplePanel
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.protocol.samples import Population, samples_of
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow
from siren_ros.roads.road_network import RoadNetwork

MODELS = ("cv", "none", "net")
"""The second has no sample."""


def test_a_row_for_each_model_and_a_column_for_each_rank(
    straight_road: RoadNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = record_with({7: moving(10.0, -5.25, 6.0)}, straight_road)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    still = Hypotheses.certain(np.repeat(samples.batch.xy_m[:1, None], 25, axis=1))
    order = [("cv", "best"), ("cv", "median"), ("cv", "worst"), ("net", "median")]
    panels = [SamplePanel(ChosenSample(model, "S2", rank, 0, 60, 7, 1.0), record, samples, still)
              for model, rank in order]  # fmt: skip
    drawn: list[tuple[Axes, SamplePanel, str]] = []
    monkeypatch.setattr(template_picture, "draw_sample", lambda *given: drawn.append(given))
    figure = template_picture.draw_template("S2", panels, MODELS)

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
