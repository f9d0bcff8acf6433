from itertools import permutations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import EpisodeError
from siren_ros.interfaces.topics import Topic
from siren_ros.lockstep.tick_join import MAX_STEPS_AHEAD, Input, TickJoin

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


@pytest.mark.parametrize(("name", "lag_steps"), [("/fast", 0), ("/lagged", 1)])
def test_a_message_is_taken_up_to_64_steps_before_it_is_used(name: str, lag_steps: int) -> None:
    join = TickJoin(INPUTS)
    assert list(join.offer(name, MAX_STEPS_AHEAD - lag_steps, "x")) == []
    with pytest.raises(EpisodeError, match="which has not begun"):
        list(join.offer(name, MAX_STEPS_AHEAD - lag_steps + 1, "x"))


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


@pytest.mark.parametrize(("name", "lag"), [("/fast", 0), ("/lagged", 1)])
@pytest.mark.parametrize(("ahead", "kept"), [(64, True), (65, False)])
def test_messages_for_up_to_64_steps_ahead_are_kept(name: str, lag: int, ahead: int, kept: bool) -> None:
    """Counted from the step that is next, and with the lag of the topic."""
    join = TickJoin(INPUTS)
    assert [step for item in MESSAGES[:4] for step, _ in join.offer(*item, "x")] == [0, 1]
    assert join.next_step == 2
    if kept:
        assert list(join.offer(name, 2 + ahead - lag, "x")) == []
    else:
        with pytest.raises(EpisodeError, match="which has not begun"):
            list(join.offer(name, 2 + ahead - lag, "x"))


def test_topics_that_are_added_later_are_waited_for_too() -> None:
    join = TickJoin((Input(FAST),))
    join.add((Input(SLOW),))
    assert join.missing() == ("/fast", "/slow")
    assert list(join.offer("/fast", 0, "x")) == []
    assert [step for step, _ in join.offer("/slow", 0, "y")] == [0]
    assert [step for step, _ in join.offer("/fast", 1, "x")] == [1]


@pytest.mark.parametrize(("lag", "needed"), [(0, [True, False, False, True]), (1, [False, True, False, False])])
def test_a_topic_is_needed_at_the_steps_of_its_period_after_its_lag(lag: int, needed: list[bool]) -> None:
    topic = Topic("/third", "std_msgs/msg/String", "c", period_steps=3)
    assert [Input(topic, lag).needed_at(step) for step in range(4)] == needed
