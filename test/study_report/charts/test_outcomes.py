"""Bars by template and level."""

import pytest
from matplotlib.patches import Rectangle

from siren_ros.scenario.request import EpisodeRequest
from siren_ros.studies.episode_row import EpisodeRow, Status
from siren_ros.studies.matrix import PlannedEpisode
from siren_ros.study_report.charts.outcomes import draw_outcomes


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
    widths = {round(bar.get_width(), 6) for bar in bars}
    assert len(widths) == 1
    assert 0.3 < widths.pop() < 0.4, "bars of two levels do not overlap"
