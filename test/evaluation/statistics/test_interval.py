"""When a table of text says that it lacks intervals."""

from siren_ros.evaluation.statistics.interval import BLOCKS_MIN, NOTHING, Interval, lack_of_bounds


def test_what_a_dash_stands_for_is_told_once_and_where_there_is_one() -> None:
    sure = Interval(1.0, 0.5, 1.5, BLOCKS_MIN)
    few = Interval(1.0, 0.5, 1.5, 4)
    assert lack_of_bounds([sure, NOTHING]) == []
    assert lack_of_bounds([few, sure, few]) == [
        "[-] is no interval: it takes 5 episodes, 2 of each template, and values that are not all the same"
    ]
