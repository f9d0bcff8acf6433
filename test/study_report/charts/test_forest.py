"""A panel for each pair of levels, a row for each template."""

import numpy as np
import pytest

from siren_ros.evaluation.statistics.interval import Interval
from siren_ros.evaluation.statistics.paired_difference import PairedDifference
from siren_ros.evaluation.yielding.counterfactual import ALL, Effect
from siren_ros.pictures.palette import TEXT
from siren_ros.study_report.charts.forest import draw_forest


def effect(template: str, first: str, second: str, value: float, blocks: int = 5) -> Effect:
    interval = Interval(value, value - 1.0, value + 2.0, blocks)
    return Effect(template, "emv_delay_s", first, second, PairedDifference(interval, 0.1), 0, 0.2)


def test_effects_stand_in_the_rows_of_their_templates() -> None:
    found = [
        effect("S2", "L1", "L0", -3.0),
        effect("S1", "L1", "L0", 5.0, blocks=1),
        effect(ALL, "L1", "L0", 1.0),
        effect("S1", "L3", "L1", 2.0),
        effect("S2", "L3", "L1", 7.0, blocks=0),
    ]
    figure = draw_forest(found, "emv_delay_s")
    one, other = figure.axes
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["L1 − L0", "L3 − L1"]
    assert [text.get_text() for text in one.get_yticklabels()] == ["S1", "S2", ALL]
    assert one.get_ylim() == (2.5, -0.5), "the first template is at the top"
    none, *points = one.lines
    assert np.asarray(none.get_xdata()).tolist() == [0.0, 0.0]
    assert [tuple(np.asarray(line.get_xydata())[0]) for line in points] == [(-3.0, 1.0), (5.0, 0.0), (1.0, 2.0)]
    assert points[0].get_color() == points[1].get_color() == TEXT
    assert points[2].get_color() != TEXT, "all templates together stand out"
    # Of a single pair there is no interval, and of none no effect.
    bounds = [np.asarray(part.get_segments()[0]) for part in one.collections]
    assert bounds == [
        pytest.approx(np.array([[-4.0, 1.0], [-1.0, 1.0]])),
        pytest.approx(np.array([[0, 2.0], [3, 2.0]])),
    ]
    assert len(other.lines) == 2
    assert len(other.collections) == 1
    taller = draw_forest([*found, effect("S7", "L1", "L0", 1.0)], "emv_delay_s")
    assert taller.get_figheight() == pytest.approx(figure.get_figheight() + 0.2), "a row more"
    assert figure.get_supxlabel() == "effect on emv_delay_s"
