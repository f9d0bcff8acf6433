"""Points, medians and curves of made yield scores."""

import numpy as np
import pytest
from matplotlib.axes import Axes

from siren_ros.evaluation.yielding.measure import Measure
from siren_ros.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.evaluation.yielding.scoring import DriverMarks, YieldScores
from siren_ros.evaluation.yielding.summary import ScoredEpisode
from siren_ros.study_report.charts.distributions import draw_drivers, draw_metric
from siren_ros.study_report.charts.style import LEVEL_COLOURS

(DELAY,) = (metric for metric in EPISODE_METRICS if metric.name == "emv_delay_s")


def episode(template: str, level: str, delay: Measure, drivers: tuple[tuple[Measure, bool], ...] = ()) -> ScoredEpisode:
    """An episode with a delay, and drivers with their response and whether they were in the way."""
    marks = tuple(
        DriverMarks(number, 0.0, in_the_way, True, False, {"response_time_s": mark})
        for number, (mark, in_the_way) in enumerate(drivers)
    )
    return ScoredEpisode("bag", template, level, 0, "town", "", "", YieldScores({"emv_delay_s": delay}, marks))


def median_bars(axes: Axes) -> list[tuple[float, float, float]]:
    """Left end, right end and height."""
    found = [np.asarray(part.get_segments()[0]) for part in axes.collections if hasattr(part, "get_segments")]
    return [(float(ends[0, 0]), float(ends[1, 0]), float(ends[0, 1])) for ends in found]


def test_points_of_episodes_and_a_bar_at_their_median() -> None:
    lacking = Measure.lacking("nothing")
    episodes = [
        *(episode("S1", "L0", Measure(value)) for value in (4.0, 1.0, 2.5)),
        episode("S1", "L3", Measure(7.0)),
        episode("S2", "L3", lacking),
        *(episode("S2", "L0", Measure(value)) for value in (3.0, 5.0)),
    ]
    (axes,) = draw_metric(episodes, DELAY).axes
    clouds = [np.asarray(part.get_offsets()) for part in axes.collections if not hasattr(part, "get_segments")]
    assert [cloud[:, 1].tolist() for cloud in clouds] == [[4.0, 1.0, 2.5], [7.0], [3.0, 5.0]]
    # L0 is 0.2 to the left of the template's place, L3 0.2 to the right; points are spread around it.
    middles = [float(cloud[:, 0].mean()) for cloud in clouds]
    assert middles[0] == pytest.approx(-0.2)
    assert middles[2] == pytest.approx(0.8)
    assert 0.0 < middles[1] <= 0.2
    assert np.ptp(clouds[0][:, 0]) < 0.4
    bars = median_bars(axes)
    assert [height for *_, height in bars] == [2.5, 7.0, 4.0]
    assert [0.5 * (left + right) for left, right, _ in bars] == pytest.approx([-0.2, 0.2, 0.8])
    assert all(right - left < 0.4 for left, right, _ in bars)
    assert axes.get_title(loc="left") == DELAY.meaning
    assert axes.get_xlim() == (-0.5, 1.5)
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["L0", "L3"]


def test_curves_are_shares_of_all_drivers_in_the_way() -> None:
    """Of four drivers in the way at L2 one has not responded by the end, and one says nothing; others do not count."""
    drivers = (
        (Measure(2.0), True),
        (Measure(1.0), True),
        (Measure(9.0, at_least=True), True),
        (Measure.lacking("did not respond"), True),
        (Measure(0.5), False),
    )
    episodes = [episode("S2", "L2", Measure(1.0), drivers), episode("S2", "L0", Measure(1.0))]
    (axes,) = draw_drivers(episodes, [("response_time_s", "how soon")]).axes
    (curve,) = axes.lines
    assert np.asarray(curve.get_xydata()) == pytest.approx(np.array([[1.0, 1 / 3], [2.0, 2 / 3]]))
    assert curve.get_drawstyle() == "steps-post"
    assert curve.get_color() == LEVEL_COLOURS["L2"]
    assert axes.get_title(loc="left") == "how soon"
    assert axes.get_xlim()[0] == 0.0
    assert axes.get_ylim() == pytest.approx((0.0, 1.0), abs=0.05)
