"""A panel for each pair of levels, a row for each template."""

import numpy as np
import pytest
from evaluation.made_profiles import profile
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from siren_ros.base.tables import Interval, Measure
from siren_ros.reports.study_report.charts import (
    LEVEL_COLOURS,
    draw_coverage,
    draw_drivers,
    draw_forest,
    draw_metric,
    draw_outcomes,
)
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import PlannedEpisode
from siren_ros.scoring.evaluation.diversity import DrawnRange, diversity
from siren_ros.scoring.evaluation.scores import ALL, Score
from siren_ros.scoring.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.scoring.evaluation.yielding.scoring import DriverMarks, ScoredEpisode, YieldScores
from siren_ros.simulation.scenario.episode import EpisodeRequest


def effect(template: str, first: str, second: str, value: float, blocks: int = 5) -> Score:
    interval = Interval(value, value - 1.0, value + 2.0, blocks)
    return Score(first, "template", template, "emv_delay_s", interval, blocks, second, 0.1, 0.2)


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
    assert [text.get_text() for text in one.get_yticklabels()] == ["S1", "S2", ALL]
    assert one.get_ylim() == (2.5, -0.5), "the first template is at the top"
    _, *points = one.lines
    assert [tuple(np.asarray(line.get_xydata())[0]) for line in points] == [(-3.0, 1.0), (5.0, 0.0), (1.0, 2.0)]
    # Of a single pair there is no interval, and of none no effect.
    bounds = [np.asarray(part.get_segments()[0]) for part in one.collections]
    assert bounds == [
        pytest.approx(np.array([[-4.0, 1.0], [-1.0, 1.0]])),
        pytest.approx(np.array([[0, 2.0], [3, 2.0]])),
    ]
    assert len(other.lines) == 2
    assert len(other.collections) == 1


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
        *(episode("S1", "L0", Measure(value)) for value in (4.0, 1.0, 2.0)),
        episode("S1", "L3", Measure(7.0)),
        episode("S2", "L3", lacking),
        *(episode("S2", "L0", Measure(value)) for value in (3.0, 5.0)),
    ]
    (axes,) = draw_metric(episodes, DELAY).axes
    clouds = [np.asarray(part.get_offsets()) for part in axes.collections if not hasattr(part, "get_segments")]
    assert [cloud[:, 1].tolist() for cloud in clouds] == [[4.0, 1.0, 2.0], [7.0], [3.0, 5.0]]
    # L0 is 0.2 to the left of the template's place, L3 0.2 to the right; points are spread around it.
    middles = [float(cloud[:, 0].mean()) for cloud in clouds]
    assert middles[0] == pytest.approx(-0.2)
    assert middles[2] == pytest.approx(0.8)
    assert 0.0 < middles[1] <= 0.2
    bars = median_bars(axes)
    assert [height for *_, height in bars] == [2.0, 7.0, 4.0]
    assert [0.5 * (left + right) for left, right, _ in bars] == pytest.approx([-0.2, 0.2, 0.8])
    assert all(right - left < 0.4 for left, right, _ in bars)


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
    (axes,) = draw_drivers(episodes, {"response_time_s": "how soon"}).axes
    (curve,) = axes.lines
    assert np.asarray(curve.get_xydata()) == pytest.approx(np.array([[1.0, 1 / 3], [2.0, 2 / 3]]))
    assert curve.get_drawstyle() == "steps-post"
    assert curve.get_color() == LEVEL_COLOURS["L2"]


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
    assert [(line.get_color(), line.get_label()) for line in panels[1].lines] == [
        ("#112233", "S2 L2"),
        ("#445566", "S2 L3"),
    ]


def row(template: str, level: str, *, holds: bool | None = None) -> EpisodeRow:
    """A complete episode; one that is missing where nothing is said of its predicate."""
    planned = PlannedEpisode("name", "group", EpisodeRequest(template, level, 0), -1, "ab" * 32)
    status = Status.COMPLETE if holds is not None else Status.FAILED
    return EpisodeRow.planned(planned, status, predicate_holds=holds)


def test_filled_bars_hold_and_outlines_are_complete() -> None:
    rows = [
        *(row("S1", "L3", holds=held) for held in (True, True, False)),
        row("S1", "L3"),
        row("S1", "L0", holds=False),
        *(row("S2", "L0", holds=held) for held in (True, False)),
    ]
    (axes,) = draw_outcomes(rows).axes
    assert [text.get_text() for text in axes.get_xticklabels()] == ["S1", "S2"]
    bars = [one for one in axes.patches if isinstance(one, Rectangle)]
    outlines = [(bar.get_x() + bar.get_width() / 2, bar.get_height()) for bar in bars if bar.get_facecolor()[3] == 0.0]
    filled = [(bar.get_x() + bar.get_width() / 2, bar.get_height()) for bar in bars if bar.get_facecolor()[3] == 1.0]
    # L0 stands to the left of L3 around each template's place.
    places = [(-0.2, 1), (0.8, 2), (0.2, 3), (1.2, 0)]
    assert outlines == [pytest.approx(place) for place in places]
    assert filled == [(pytest.approx(place), held) for (place, _), held in zip(places, (0, 1, 2, 0), strict=True)]
    assert all(0.3 < bar.get_width() < 0.4 for bar in bars), "bars of two levels do not overlap"
