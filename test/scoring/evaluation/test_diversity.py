"""Profiles of episodes and their distances; what a set of profiles covers."""

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from busy_record import busy_record
from hypothesis import given
from hypothesis import strategies as st
from known_outputs import assert_known
from made_profiles import profile
from made_records import Track, moving, record_with

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.diversity import (
    DrawnRange,
    distance_matrix,
    diversity,
    diversity_as_json,
    diversity_tables,
    drawn_ranges,
    event_distance,
    expected_kinds,
    expected_nearest,
    kind_coverage,
    parameter_coverage,
    profile_of,
    way_distance_m,
)
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import Event, EventKind


def test_a_record_gives_the_way_each_second_and_the_order_of_events(record_of: Callable[..., EpisodeRecord]) -> None:
    record = record_of(duration_s=16.0)
    found = profile_of("bag", record)
    assert found.group == ("S2", "L2", "straight")
    assert found.way_m.shape == (16, 2)
    assert found.way_m[0].tolist() == [0.0, 0.0]
    assert (np.diff(found.way_m[:, 0]) > 0.0).all(), "x points ahead"
    assert "civilian yield_started" in found.happenings
    assert all(one != other for one, other in zip(found.happenings, found.happenings[1:], strict=False))
    assert ("begin", found.happenings[0]) in found.transitions
    assert (found.happenings[-1], "end") in found.transitions


def test_a_record_without_emv_is_refused(straight_road: RoadNetwork) -> None:
    record = record_with({1: moving(0.0, -1.75, 10.0, steps=20)}, straight_road)
    with pytest.raises(InputError, match="EMV"):
        profile_of("bag", record)


def test_groups_are_compared_within_themselves() -> None:
    profiles = [
        profile(1, "a", way=((0.0, 0.0), (4.0, 0.0)), x=0.5),
        profile(0, "a", "b", way=((0.0, 0.0), (0.0, 0.0)), x=0.5),
        profile(5, "c", way=((90.0, 0.0), (90.0, 0.0)), level="L3", x=0.1),
    ]
    first, second = diversity(profiles, {"S2": {"x": DrawnRange(0.0, 1.0, whole=False)}})
    assert [one.seed for one in first.profiles] == [0, 1]
    assert first.ways.mean == pytest.approx(2.0)
    assert first.ways.nearest.tolist() == [2.0, 2.0]
    assert first.events.mean == pytest.approx(0.5)
    assert first.transitions.seen == 4
    assert first.parameter_share == pytest.approx(0.1)
    assert np.isnan(second.ways.nearest).all()
    written = json.loads(json.dumps([diversity_as_json(one) for one in (first, second)], allow_nan=False))
    assert written[0]["novelty"][0] == {"bag": "bag0", "seed": 0, "draw": "", "way_m": 2.0, "events": 0.5}
    assert written[1]["ways_m"] == {"mean": None, "nearest_by_episodes": []}


def test_ranges_are_those_that_seeds_draw_from() -> None:
    ranges = drawn_ranges([profile(0)])["S2"]
    assert ranges["emv.speed_mps"] == DrawnRange(12.5, 15.3, whole=False)
    assert "demand.platoon.vehicles" not in ranges, "seeds do not draw it"
    drawn = replace(profile(0), draw="emv.speed_mps=12")
    whole_ranges = drawn_ranges([drawn])["S2"]
    assert whole_ranges["emv.speed_mps"] == DrawnRange(11.0, 16.7, whole=False)
    assert whole_ranges["demand.platoon.vehicles"].whole
    assert not {"duration_s", "emv.count"} & set(whole_ranges), "studies do not draw these by themselves"


def test_the_way_is_ahead_and_to_the_left_of_the_first_pose(straight_road: RoadNetwork) -> None:
    """It looks in the direction 2.0 at first, and drives a circle to the left from the first step on."""
    rate, speed, first = 0.25, 5.0, 2.0
    heading = first + rate * STEP_S * np.arange(101)
    radius = speed / rate
    place = 30.0 + radius * np.sin(heading), 20.0 - radius * np.cos(heading)
    states = np.stack((*place, speed * np.cos(heading), speed * np.sin(heading), heading), axis=1)
    way = profile_of("bag", record_with({1: Track(states, is_emv=True)}, straight_road)).way_m
    turned = rate * np.arange(6.0)
    assert way == pytest.approx(np.stack((radius * np.sin(turned), radius * (1.0 - np.cos(turned))), axis=1))


def test_happenings_are_the_emvs_the_civilians_and_collisions(straight_road: RoadNetwork) -> None:
    record = record_with(
        {1: moving(0.0, -1.75, 10.0, is_emv=True, steps=20), 2: moving(30.0, -1.75, 5.0, steps=20)}, straight_road
    )
    events = (
        Event(1, EventKind.SIREN_ON, 1),
        Event(2, EventKind.STOP_LINE_CROSSED, 1),
        Event(3, EventKind.STOP_LINE_CROSSED, 2),
        Event(4, EventKind.YIELD_STARTED, 2),
        Event(5, EventKind.YIELD_STARTED, 3),
        Event(6, EventKind.COLLISION, 1, 2),
        Event(7, EventKind.YIELD_STARTED, 2),
    )
    started = f"civilian {EventKind.YIELD_STARTED}"
    found = profile_of("bag", replace(record, events=events)).happenings
    assert found == (f"emv {EventKind.STOP_LINE_CROSSED}", started, str(EventKind.COLLISION), started)


@pytest.mark.parametrize(
    ("one", "other", "edits"),
    [("abc", "abc", 0), ("abc", "", 3), ("kitten", "sitting", 3), ("ab", "ba", 2), ("abcd", "acd", 1), ("", "", 0)],
)
def test_event_distance_is_the_share_of_edits(one: str, other: str, edits: int) -> None:
    share = pytest.approx(edits / max(len(one), len(other), 1))
    assert event_distance(profile(0, *one), profile(1, *other)) == share
    assert event_distance(profile(0, *other), profile(1, *one)) == share
    assert profile().transitions == {("begin", "end")}


def test_way_distance_is_the_mean_over_the_common_time() -> None:
    one = profile(0, way=((0.0, 0.0), (10.0, 0.0), (20.0, 0.0)))
    other = profile(1, way=((0.0, 0.0), (10.0, 6.0)))
    assert way_distance_m(one, other) == pytest.approx(3.0)
    places = [profile(seed, way=((3.0 * seed, 4.0 * seed),)) for seed in range(3)]
    assert distance_matrix(places, way_distance_m).tolist() == [[0, 5, 10], [5, 0, 5], [10, 5, 0]]


@given(st.lists(st.sets(st.integers(0, 5), min_size=1), min_size=1, max_size=5))
def test_expected_kinds_are_the_mean_over_all_choices(episodes: list[set[int]]) -> None:
    kinds = sorted(set().union(*episodes))
    incidences = [sum(kind in episode for episode in episodes) for kind in kinds]
    tried = [
        np.mean([len(set().union(*chosen)) for chosen in combinations(episodes, count)])
        for count in range(1, len(episodes) + 1)
    ]
    assert expected_kinds(incidences, len(episodes)) == pytest.approx(tried)
    assert kind_coverage(episodes).curve == pytest.approx(tried)


@given(st.lists(st.floats(0.0, 100.0), min_size=2, max_size=6))
def test_the_expected_nearest_is_the_mean_over_all_choices_of_others(places: list[float]) -> None:
    matrix = np.abs(np.subtract.outer(places, places))
    count = len(places)
    tried = [
        np.mean(
            [
                min(matrix[one, other] for other in chosen)
                for one in range(count)
                for chosen in combinations([k for k in range(count) if k != one], size)
            ]
        )
        for size in range(1, count)
    ]
    assert expected_nearest(matrix) == pytest.approx(tried, abs=1e-9)
    assert expected_nearest(np.zeros((1, 1))).shape == (0,)


@pytest.mark.parametrize(
    ("episodes", "coverage"),
    [
        # Chao and Jost 2012, eq. 10 for incidences: U = 8, T = 4, Q1 = 2, Q2 = 1; then without kinds of two episodes.
        (["ab", "ac", "abd", "a"], 1.0 - 2 / 8 * (3 * 2 / (3 * 2 + 2 * 1))),
        (["abc", "a", "ad"], 1.0 - 3 / 6 * (2 * 2 / (2 * 2 + 2))),
        (["ab", "ab"], 1.0),
        (["ab"], 0.0),
    ],
)
def test_coverage_of_kinds(episodes: list[str], coverage: float) -> None:
    """What one more episode adds is what single episodes have alone; of one episode nothing is known."""
    found = kind_coverage([set(kinds) for kinds in episodes])
    kinds = "".join(episodes)
    once = sum(kinds.count(kind) == 1 for kind in set(kinds))
    assert (found.seen, found.once) == (len(set(kinds)), once)
    assert found.next_adds == pytest.approx(once / len(episodes))
    assert found.coverage == pytest.approx(coverage)


def test_a_range_has_ten_parts_and_a_short_whole_one_a_part_for_each_value() -> None:
    drawn = DrawnRange(10.0, 20.0, whole=False)
    assert drawn.parts == 10
    assert drawn.part_of(np.array([9.0, 10.0, 10.99, 11.0, 20.0, 30.0])).tolist() == [0, 0, 0, 1, 9, 9]
    short = DrawnRange(4.0, 6.0, whole=True)
    assert short.parts == 3
    assert short.part_of(np.array([4.0, 5.0, 6.0])).tolist() == [0, 1, 2]
    long = DrawnRange(1.0, 20.0, whole=True)
    assert long.parts == 10
    assert long.part_of(np.array([1.0, 2.0, 3.0, 20.0])).tolist() == [0, 0, 1, 9]


def test_coverage_counts_the_parts_that_episodes_reach() -> None:
    episodes = [{"a": 0.05, "b": 1.0}, {"a": 0.07, "b": 2.0}, {"a": 0.95, "b": 3.0}]
    ranges = {"a": DrawnRange(0.0, 1.0, whole=False), "fixed": DrawnRange(2.0, 2.0, whole=False)}
    (found,) = parameter_coverage(episodes, ranges)
    assert found.path == "a"
    assert found.counts == (2, *(0,) * 8, 1)
    assert found.share == pytest.approx(0.2)
    # One episode reaches one part of ten; two reach two parts in two of the three choices.
    assert found.curve == pytest.approx([0.1, 0.1 * 5 / 3, 0.2])
    assert parameter_coverage([{"a": 0.5}, {}], ranges) == (), "an episode lacks it"


def test_everything_of_four_busy_episodes_of_two_levels() -> None:
    records = [seen for level in ("L1", "L2") for seen in busy_record(level=level).by_emv()]
    profiles = [
        replace(profile_of(f"bag{number}", one), seed=number, parameters={"emv.speed_mps": 12.5 + 0.5 * number})
        for number, one in enumerate(records[:5])
    ]
    groups = diversity(profiles, drawn_ranges(profiles))
    found = [diversity_as_json(group) for group in groups], [table.text() for table in diversity_tables(groups)]
    assert_known(Path(__file__).parent / "known" / "diversity.json", found)
