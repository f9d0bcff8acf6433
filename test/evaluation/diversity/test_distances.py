import math

import pytest
from made_profiles import profile

from siren_ros.evaluation.diversity.distances import distance_matrix, event_distance, way_distance_m


@pytest.mark.parametrize(
    ("one", "other", "edits"),
    [("abc", "abc", 0), ("abc", "", 3), ("kitten", "sitting", 3), ("ab", "ba", 2), ("abcd", "acd", 1)],
)
def test_event_distance_is_the_share_of_edits(one: str, other: str, edits: int) -> None:
    assert event_distance(profile(0, *one), profile(1, *other)) == pytest.approx(edits / max(len(one), len(other)))
    assert event_distance(profile(0, *other), profile(1, *one)) == pytest.approx(edits / max(len(one), len(other)))


def test_two_episodes_without_events_are_alike() -> None:
    assert event_distance(profile(0), profile(1)) == 0.0


def test_way_distance_is_the_mean_over_the_common_time() -> None:
    one = profile(0, way=((0.0, 0.0), (10.0, 0.0), (20.0, 0.0)))
    other = profile(1, way=((0.0, 0.0), (10.0, 6.0)))
    assert way_distance_m(one, other) == pytest.approx(3.0)


def test_the_matrix_is_symmetric_with_zeros() -> None:
    places = [profile(seed, way=((3.0 * seed, 4.0 * seed),)) for seed in range(3)]
    matrix = distance_matrix(places, way_distance_m)
    assert matrix.tolist() == [[0, 5, 10], [5, 0, 5], [10, 5, 0]]
    assert math.isclose(matrix.trace(), 0.0)
