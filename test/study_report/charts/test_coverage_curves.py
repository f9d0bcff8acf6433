"""Four panels, a line for each group."""

import numpy as np
import pytest
from evaluation.diversity.made_profiles import profile

from siren_ros.evaluation.diversity.parameter_coverage import DrawnRange
from siren_ros.evaluation.diversity.summary import diversity
from siren_ros.study_report.charts.coverage_curves import draw_coverage


def test_each_panel_has_its_curve_of_each_group() -> None:
    """L2 has three episodes with two parameters, L3 two without any."""
    ranges = {"S2": {"x": DrawnRange(0.0, 1.0, whole=False), "y": DrawnRange(0.0, 1.0, whole=False)}}
    profiles = [
        *(profile(seed, "a", "b"[: seed % 2], way=((float(seed), 0.0),), x=0.05, y=0.3 * seed) for seed in range(3)),
        *(profile(seed, "c", way=((5.0 * seed, 0.0),), level="L3") for seed in range(2)),
    ]
    first, second = diversity(profiles, ranges)
    figure = draw_coverage((first, second), ("#112233", "#445566"))
    panels = figure.axes
    assert len(panels) == 4
    curves = [[np.asarray(line.get_xydata()) for line in axes.lines] for axes in panels]
    both = np.mean([one.curve for one in first.parameters], axis=0)
    expected = (both, first.transitions.curve, first.ways.curve, first.events.curve)
    for (one, _), known in zip(curves, expected, strict=True):
        assert one[:, 0].tolist() == list(range(1, len(known) + 1))
        assert one[:, 1] == pytest.approx(known)
    assert len(curves[0][1]) == 0, "no parameter was drawn"
    assert curves[2][1] == pytest.approx(np.array([[1.0, 5.0]]))
    assert panels[0].get_ylim() == (0.0, 1.0)
    assert all(axes.get_ylim()[0] == 0.0 for axes in panels)
    assert [line.get_color() for line in panels[1].lines] == ["#112233", "#445566"]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["S2 L2", "S2 L3"]
