from itertools import permutations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import EpisodeError
from siren_ros.interfaces.topics import Topic
from siren_ros.lockstep.tick_join import Input, TickJoin

FAST = Topic("/fast", "std_msgs/msg/String", "a")
LAGGED = Topic("/lagged", "std_msgs/msg/String", "b")
SLOW = Topic("/slow", "std_msgs/msg/String", "c", period_steps=2)
INPUTS = (Input(FAST), Input(LAGGED, lag_steps=1), Input(SLOW))

MESSAGES = [("/fast", 0), ("/slow", 0), ("/fast", 1), ("/lagged", 0), ("/fast", 2), ("/lagged", 1), ("/slow", 2)]
EXPECTED = [
    (0, {"/fast": ("/fast", 0), "/slow": ("/slow", 0)}),
    (1, {"/fast": ("/fast", 1), "/lagged": ("/lagged", 0)}),
    (2, {"/fast": ("/fast", 2), "/lagged": ("/lagged", 1), "/slow": ("/slow", 2)}),
]


@given(st.permutations(MESSAGES))
def test_order_of_arrival_changes_nothing(messages: list[tuple[str, int]]) -> None:
    join = TickJoin(INPUTS)
    steps = [item for name, step in messages for item in join.offer(name, step, (name, step))]
    assert steps == EXPECTED


def test_a_step_waits_for_its_last_input() -> None:
    for first, second in permutations((("/fast", 0), ("/slow", 0))):
        join = TickJoin(INPUTS)
        assert list(join.offer(*first, "x")) == []
        assert join.missing() == (second[0],)
        assert [step for step, _ in join.offer(*second, "y")] == [0]
        assert join.missing() == ("/fast", "/lagged")


def test_a_message_for_a_step_far_ahead_is_refused() -> None:
    join = TickJoin(INPUTS)
    with pytest.raises(EpisodeError, match="/fast: a message for step 900, which has not begun"):
        list(join.offer("/fast", 900, "x"))


def test_a_second_message_for_a_step_is_refused() -> None:
    join = TickJoin(INPUTS)
    list(join.offer("/fast", 0, "x"))
    with pytest.raises(EpisodeError, match="/fast: a second message for step 0"):
        list(join.offer("/fast", 0, "x"))
    list(join.offer("/slow", 0, "x"))
    with pytest.raises(EpisodeError, match="/slow: a second message for step 0"):
        list(join.offer("/slow", 0, "x"))
