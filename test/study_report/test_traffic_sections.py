"""Rows of made profiles."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from evaluation.diversity.made_profiles import profile

from siren_ros.study_report import traffic_sections as diversity
from siren_ros.study_report.study import StudyMeasures, StudyRows
from siren_ros.study_report.traffic_sections import diversity_section


def test_groups_and_the_novelty_of_their_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """At L2 three ways at 0, 3 and 10 m with two orders of events; at L3 one episode."""
    profiles = [
        profile(0, "a", "b", way=((0.0, 0.0),)),
        profile(1, "a", "b", way=((3.0, 0.0),)),
        profile(2, "a", way=((10.0, 0.0),)),
        profile(5, level="L3"),
    ]
    drawn: list[Any] = []
    monkeypatch.setattr(diversity, "figure_uri", lambda _: "data:")
    monkeypatch.setattr(diversity, "draw_coverage", lambda found, colours: drawn.append((found, colours)))
    bags: Any = tuple(SimpleNamespace(profile=one) for one in profiles)
    section = diversity_section(StudyRows(Path("s"), {}, (), ""), StudyMeasures(bags, ()))
    groups, novelty = section.tables
    several, single = groups.cells()
    # Ways: 3, 7 and 10 m apart, the nearest 3, 3 and 7 m; orders of events: 0, 1/2 and 1/2 apart.
    assert several[:4] == ("S2", "L2", "town", "3")
    assert several[4] == "–", "the made parameters are none of S2's"
    assert several[5:9] == ("6.7", "4.3", "0.33", "0.17")
    # begin a, a b, b end, a end: the last one is of a single episode.
    assert several[9:11] == ("4", "0.3")
    assert single == ("S2", "L3", "town", "1", "–", "–", "–", "–", "–", "1", "–", "–")
    assert [row[3:] for row in novelty.cells()] == [
        ("0", "", "3.0", "0.00"),
        ("1", "", "3.0", "0.00"),
        ("2", "", "7.0", "0.50"),
        ("5", "", "–", "–"),
    ]
    ((found, colours),) = drawn
    assert [one.group[1] for one in found] == ["L2"], "its own level"
    assert len(colours) == 1
