"""What is drawn of a sample: past, truth and hypotheses where they are, in a square around them."""

import numpy as np
import pytest
from made_records import moving, record_with
from matplotlib.axes import Axes

from siren_ros.evaluation.prediction.charts.chart import new_figure
from siren_ros.evaluation.prediction.charts.sample_choice import ChosenSample
from siren_ros.evaluation.prediction.charts.sample_panel import PAST, TRUTH, SamplePanel, draw_sample
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.protocol.samples import Population, samples_of
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow
from siren_ros.roads.road_network import RoadNetwork

COLOUR = "#123456"


def panel_of(network: RoadNetwork, is_emv: bool = False) -> SamplePanel:
    """A vehicle at 6 m/s to the east at 3 s; one hypothesis goes straight on at 5 m/s, the other to the north."""
    record = record_with({7: moving(10.0, -5.25, 6.0, is_emv=is_emv)}, network)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    time = 0.2 * np.arange(1, 26)
    here = samples.batch.xy_m[0]
    paths = np.stack(
        (here + np.stack((5.0 * time, 0.0 * time), axis=-1), here + np.stack((0.0 * time, 2.0 * time), axis=-1))
    )
    chosen = ChosenSample("cv", "S2", "median", 0, 60, 7, 2.345)
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
    record = record_with({7: moving(10.0, -5.25, 1.0)}, straight_road)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    still = Hypotheses.certain(np.repeat(samples.batch.xy_m[:1, None], 25, axis=1))
    draw_sample(axes, SamplePanel(ChosenSample("cv", "S2", "best", 0, 60, 7, 1.0), record, samples, still), COLOUR)
    assert axes.get_xlim() == pytest.approx((14.0 - 20.0, 14.0 + 20.0))


@pytest.mark.parametrize(("is_emv", "who"), [(True, "EMV"), (False, "vehicle 7")])
def test_the_title_says_who_when_and_how_far_off(
    straight_road: RoadNetwork, axes: Axes, is_emv: bool, who: str
) -> None:
    draw_sample(axes, panel_of(straight_road, is_emv), COLOUR)
    assert axes.get_title(loc="left") == f"median: ADE 2.35 m, {who} at 3.0 s"
