"""The lockstep: its decisions, and what the receiving code does with messages of another program."""

from dataclasses import replace
from itertools import permutations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.data.interfaces.conversions import Phase, StepReport
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.lockstep import (
    Action,
    BeginStep,
    EndEpisode,
    Input,
    LockstepConfig,
    LockstepState,
    Stage,
    TickJoin,
    on_closed,
    on_departure,
    on_failure,
    on_interrupt,
    on_report,
    on_time,
    once,
    start_lockstep,
)
from siren_ros.errors import EpisodeError
from siren_ros.simulation.scenario.episode import EpisodeEnd

CONFIG = LockstepConfig(participants=("a", "b"), steps=2, step_timeout_s=5.0, start_timeout_s=60.0)


def report(state: LockstepState, name: str, phase: Phase, step: int = 0, error: str = "", now_s: float = 0.0):
    return on_report(state, StepReport(step, name, phase, error, busy_s=0.5), CONFIG, now_s)


def stepping() -> LockstepState:
    state, _ = report(start_lockstep(CONFIG, 0.0), "a", Phase.READY)
    state, action = report(state, "b", Phase.READY)
    assert action == BeginStep(0)
    return state


def stepped() -> LockstepState:
    """Both steps are done."""
    state = stepping()
    for step in range(2):
        for name in ("a", "b"):
            state, _ = report(state, name, Phase.STEP, step)
    return state


def test_a_whole_episode() -> None:
    state = stepping()
    for step in range(2):
        state, action = report(state, "b", Phase.STEP, step)
        assert action is None
        state, action = report(state, "a", Phase.STEP, step)
        assert action == (BeginStep(1) if step == 0 else EndEpisode(2, EpisodeEnd.COMPLETE, ""))
    for name in ("a", "b"):
        assert state.stage is Stage.CLOSING
        state, action = report(state, name, Phase.FINAL, 1)
        assert action is None
    assert state.stage is Stage.CLOSED
    assert state.end is EpisodeEnd.COMPLETE
    assert state.busy_s == {"a": 2.0, "b": 2.0}


@given(st.lists(st.tuples(st.sampled_from(["a", "stranger"]), st.sampled_from(Phase), st.integers(0, 3)), max_size=8))
def test_no_step_begins_while_a_participant_is_missing(reports: list[tuple[str, Phase, int]]) -> None:
    state = stepping()
    for name, phase, step in reports:
        state, action = report(state, name, phase, step)
        assert not isinstance(action, BeginStep)
    assert state.step == 0


@pytest.mark.parametrize(
    ("phase", "step", "reason"),
    [
        (Phase.STEP, 0, "a: reported step 0 twice"),
        (Phase.STEP, 1, "a: reported step 1 before it was due"),
        (Phase.READY, 0, "a: reported twice that it is ready"),
    ],
)
def test_a_report_that_nobody_owes_ends_the_episode(phase: Phase, step: int, reason: str) -> None:
    state, action = report(stepping(), "a", Phase.STEP, 0)
    assert action is None
    state, action = report(state, "a", phase, step)
    assert action == EndEpisode(0, EpisodeEnd.FAILED, reason)
    assert state.stage is Stage.CLOSING


def test_nobody_reports_for_another_program_or_before_the_beginning() -> None:
    _, action = report(stepping(), "stranger", Phase.STEP, 0)
    assert isinstance(action, EndEpisode)
    assert action.reason.startswith("stranger: reports on /siren/step_done, but takes no part")
    _, action = report(start_lockstep(CONFIG, 0.0), "a", Phase.STEP, 0)
    assert action == EndEpisode(0, EpisodeEnd.FAILED, "a: reported step 0 before it was due")
    ready, _ = report(start_lockstep(CONFIG, 0.0), "a", Phase.READY)
    _, action = report(ready, "a", Phase.READY)
    assert action == EndEpisode(0, EpisodeEnd.FAILED, "a: reported twice that it is ready")


OUTSIDE = replace(CONFIG, outside=("b",))


def test_another_program_may_be_started_again_until_the_first_step() -> None:
    state = start_lockstep(OUTSIDE, 0.0)
    for again in range(2):
        state, action = on_report(state, StepReport(0, "b", Phase.READY), OUTSIDE, 0.0)
        assert (state.waiting, action) == ({"a"}, None)
        if not again:
            state, action = on_departure(state, OUTSIDE, 0.0, frozenset({"b"}), "b: gone")
            assert (state.waiting, action) == ({"a", "b"}, None)
    state, action = on_report(state, StepReport(0, "a", Phase.READY), OUTSIDE, 0.0)
    assert action == BeginStep(0)
    state, action = on_departure(state, OUTSIDE, 0.0, frozenset({"b"}), "b: gone")
    assert action == EndEpisode(0, EpisodeEnd.FAILED, "b: gone")
    assert state.waiting == {"a"}, "nobody waits for a program that is gone"


def test_a_failed_episode_waits_for_no_report_of_a_participant_that_is_seen_to_have_closed() -> None:
    failed, _ = on_failure(stepping(), CONFIG, 1.0, "a stranger")
    assert on_closed(failed, frozenset()) == failed
    closing = on_closed(failed, frozenset({"a", "c"}))
    assert (closing.stage, closing.waiting) == (Stage.CLOSING, {"b"})
    both = on_closed(closing, frozenset({"a", "b"}))
    assert (both.stage, both.end, both.reason) == (Stage.CLOSED, EpisodeEnd.FAILED, "a stranger")
    assert on_closed(both, frozenset({"a"})) == both
    stopped, _ = on_interrupt(stepping(), CONFIG, 1.0, "Ctrl-C")
    assert on_closed(stopped, frozenset({"a", "b"})) == stopped, "a report may still bring an error"
    assert on_closed(stepping(), frozenset({"a"})) == stepping()


def test_a_stranger_that_comes_while_the_episode_closes_fails_it() -> None:
    state, action = on_failure(stepped(), CONFIG, 1.0, "a stranger")
    assert (state.stage, state.end, state.reason, action) == (Stage.CLOSING, EpisodeEnd.FAILED, "a stranger", None)


def test_an_error_a_failure_and_a_participant_that_closes_end_the_episode() -> None:
    state, action = report(stepping(), "b", Phase.STEP, 0, error="out of road")
    assert (state.stage, action) == (Stage.CLOSING, EndEpisode(0, EpisodeEnd.FAILED, "b: out of road"))
    _, action = on_failure(stepping(), CONFIG, 1.0, "a: killed")
    assert action == EndEpisode(0, EpisodeEnd.FAILED, "a: killed")
    _, action = report(stepping(), "a", Phase.FINAL, 0)
    assert isinstance(action, EndEpisode)
    assert action.end is EpisodeEnd.FAILED
    assert action.reason.startswith("a: left the episode")
    assert "/siren/episode_end" in action.reason


def test_a_participant_that_does_not_answer_is_named() -> None:
    state, _ = report(stepping(), "a", Phase.STEP, 0)
    assert on_time(state, CONFIG, 59.9) == (state, None), "it may compile loops, as it does while it starts"
    state, action = on_time(state, CONFIG, 60.0)
    assert action == EndEpisode(0, EpisodeEnd.FAILED, "b: did not finish step 0 within 60 s")
    state, action = report(state, "a", Phase.FINAL, 0, now_s=61.0)
    assert action is None
    state, action = on_time(state, CONFIG, 1000.0)
    assert (state.stage, action) == (Stage.CLOSED, None)
    assert state.reason == "b: did not finish step 0 within 60 s"


def test_before_the_first_step_those_alone_are_named_that_have_not_come() -> None:
    _, action = on_time(start_lockstep(CONFIG, 10.0), CONFIG, 70.0)
    assert action == EndEpisode(0, EpisodeEnd.FAILED, "a, b: was not ready within 60 s")
    config = LockstepConfig(("sumo_bridge", "sensor_sim", "recorder"), 5)
    state = start_lockstep(config, 0.0)
    _, action = on_time(state, config, 120.0, lambda: frozenset({"sensor_sim", "recorder", "somebody"}))
    assert action == EndEpisode(0, EpisodeEnd.FAILED, "recorder, sensor_sim: was not ready within 120 s")
    _, action = on_time(state, config, 120.0, lambda: frozenset({"somebody"}))
    assert action == EndEpisode(0, EpisodeEnd.FAILED, "sumo_bridge: was not ready within 120 s"), "all have come"
    names = ("vehicle_dynamics", "recorder", "av_controller")
    config = LockstepConfig(names, 5, display_names={"av_controller": "av_controller (node mine)"})
    _, action = on_time(start_lockstep(config, 0.0), config, 200.0)
    mine = EndEpisode(0, EpisodeEnd.FAILED, "av_controller (node mine): was not ready within 120 s")
    assert action == mine, "the others wait for it"
    _, action = on_report(start_lockstep(config, 0.0), StepReport(0, "av_controller", Phase.STEP), config, 0.0)
    assert action == replace(mine, reason="av_controller (node mine): reported step 0 before it was due")


@pytest.mark.parametrize("begin", [lambda: start_lockstep(CONFIG, 0.0), stepping])
def test_while_a_participant_compiles_its_time_stands(begin) -> None:
    state = begin()
    for now_s in (59.0, 118.0, 177.0):
        state, action = report(state, "b", Phase.COMPILING, now_s=now_s)
        assert action is None
        assert on_time(state, CONFIG, now_s + 59.9) == (state, None)
    _, action = on_time(state, CONFIG, 237.0)
    assert isinstance(action, EndEpisode)
    assert state.busy_s == begin().busy_s


def test_nobody_holds_the_time_who_is_not_awaited() -> None:
    state, _ = report(stepping(), "a", Phase.STEP, 0)
    for name in ("a", "stranger"):
        assert report(state, name, Phase.COMPILING, now_s=30.0) == (state, None)
    closing, _ = on_interrupt(state, CONFIG, 1.0, "stop")
    assert report(closing, "b", Phase.COMPILING, now_s=30.0) == (closing, None)


def test_interruption_counts_finished_steps_only() -> None:
    state = stepping()
    state, _ = report(state, "a", Phase.STEP, 0)
    assert on_interrupt(state, CONFIG, 1.0, "Ctrl-C")[1] == EndEpisode(0, EpisodeEnd.INTERRUPTED, "Ctrl-C")
    closing, _ = on_interrupt(state, CONFIG, 1.0, "Ctrl-C")
    assert (closing.late, closing.waiting, closing.owing) == (frozenset(), {"a", "b"}, frozenset()), "all were ready"
    state, _ = report(state, "b", Phase.STEP, 0)
    closing, action = on_interrupt(state, CONFIG, 1.0, "Ctrl-C")
    assert action == EndEpisode(1, EpisodeEnd.INTERRUPTED, "Ctrl-C")
    assert on_interrupt(closing, CONFIG, 2.0, "again") == (closing, None)
    assert on_failure(closing, CONFIG, 2.0, "again") == (closing, None)


def test_only_the_first_in_the_chain_is_blamed() -> None:
    config = LockstepConfig(("sumo_bridge", "emv_controller", "vehicle_dynamics", "recorder"), 5, 5.0, 5.0)
    state = start_lockstep(config, 0.0)
    for name in config.participants:
        state, _ = on_report(state, StepReport(0, name, Phase.READY), config, 0.0)
    state, _ = on_report(state, StepReport(0, "sumo_bridge", Phase.STEP), config, 0.0)
    _, action = on_time(state, config, 6.0)
    assert action == EndEpisode(0, EpisodeEnd.FAILED, "emv_controller: did not finish step 0 within 5 s")


def test_nobody_waits_long_for_a_participant_that_was_late_already() -> None:
    state, _ = report(stepping(), "a", Phase.STEP, 0)
    state, _ = on_time(state, CONFIG, 60.0)
    assert on_time(state, CONFIG, 60.0 + CONFIG.late_close_timeout_s) == (state, None), "a is not late and may close"
    state, _ = report(state, "a", Phase.FINAL, 0, now_s=61.0)
    state, _ = on_time(state, CONFIG, 60.0 + CONFIG.late_close_timeout_s)
    assert state.stage is Stage.CLOSED
    assert state.reason == "b: did not finish step 0 within 60 s"


def test_nobody_waits_for_a_participant_that_is_gone() -> None:
    state, action = on_failure(stepping(), CONFIG, 1.0, "b: killed", frozenset({"b"}))
    assert action == EndEpisode(0, EpisodeEnd.FAILED, "b: killed")
    assert state.waiting == {"a"}
    state, _ = report(state, "a", Phase.FINAL, 0, now_s=1.1)
    assert (state.stage, state.end, state.reason) == (Stage.CLOSED, EpisodeEnd.FAILED, "b: killed")


def test_a_participant_that_dies_while_it_closes_fails_the_episode() -> None:
    state = stepped()
    state, _ = report(state, "a", Phase.FINAL, 1)
    unmoved, _ = on_failure(state, CONFIG, 1.0, "a: killed", frozenset({"a"}))
    assert unmoved == state, "a has closed already"
    state, action = on_failure(state, CONFIG, 1.0, "b: killed", frozenset({"b"}))
    assert action is None
    assert (state.stage, state.end, state.reason) == (Stage.CLOSED, EpisodeEnd.FAILED, "b: killed")


TRAILING = replace(CONFIG, steps=3, trailing=frozenset({"b"}))


def trailing(state: LockstepState, name: str, step: int, now_s: float = 0.0) -> tuple[LockstepState, Action]:
    return on_report(state, StepReport(step, name, Phase.STEP), TRAILING, now_s)


def test_the_next_step_does_not_wait_for_who_trails_but_the_one_after_it_does() -> None:
    state, action = trailing(stepping(), "a", 0)
    assert (action, state.owing, state.steps_done) == (BeginStep(1), {"b"}, 0)
    state, action = trailing(state, "a", 1)
    assert action is None
    _, late = on_time(state, TRAILING, 60.0)
    assert late == EndEpisode(0, EpisodeEnd.FAILED, "b: did not finish step 0 within 60 s"), "its own step"
    state, action = trailing(state, "b", 0)
    assert (action, state.owing, state.steps_done) == (BeginStep(2), {"b"}, 1)
    state, _ = trailing(state, "a", 2)
    state, action = trailing(state, "b", 1)
    assert action is None
    state, action = trailing(state, "b", 2)
    assert action == EndEpisode(3, EpisodeEnd.COMPLETE, "")


@given(st.lists(st.tuples(st.sampled_from("ab"), st.integers(0, 2)), max_size=40))
def test_nobody_is_ever_two_steps_behind(reports: list[tuple[str, int]]) -> None:
    state, done = stepping(), {"a": 0, "b": 0}
    for name, step in reports:
        if state.stage is not Stage.STEPPING:
            break
        state, action = trailing(state, name, step)
        done[name] += step == done[name] and step <= state.step
        if isinstance(action, BeginStep):
            assert done["a"] >= action.step
            assert done["b"] >= action.step - 1


def test_each_step_has_its_own_time() -> None:
    """The second one begins at 4 s; 5 s are allowed for each."""
    state, _ = report(stepping(), "a", Phase.STEP, 0, now_s=3.0)
    state, action = report(state, "b", Phase.STEP, 0, now_s=4.0)
    assert action == BeginStep(1)
    assert on_time(state, CONFIG, 8.9) == (state, None)
    _, action = on_time(state, CONFIG, 9.0)
    assert action == EndEpisode(1, EpisodeEnd.FAILED, "a, b: did not finish step 1 within 5 s")


def test_who_does_not_close_in_time_fails_the_episode_and_who_was_never_ready_is_not_waited_for() -> None:
    state = stepping()
    for step in range(2):
        for name in ("a", "b"):
            state, _ = report(state, name, Phase.STEP, step, now_s=10.0)
    state, _ = report(state, "a", Phase.FINAL, 1, now_s=11.0)
    assert on_time(state, CONFIG, 69.9) == (state, None)
    state, action = on_time(state, CONFIG, 70.0)
    assert action is None
    expected = (Stage.CLOSED, EpisodeEnd.FAILED, "b: did not close within 60 s")
    assert (state.stage, state.end, state.reason) == expected
    assert on_time(state, CONFIG, 1e9) == (state, None)
    unready, _ = report(start_lockstep(CONFIG, 0.0), "a", Phase.READY)
    unready, _ = on_interrupt(unready, CONFIG, 5.0, "Ctrl-C")
    assert unready.late == {"b"}
    assert on_time(unready, CONFIG, 7.0) == (unready, None), "a was ready and may close"
    unready, _ = report(unready, "a", Phase.FINAL, now_s=6.0)
    assert on_time(unready, CONFIG, 6.9) == (unready, None)
    unready, _ = on_time(unready, CONFIG, 7.0)
    assert (unready.stage, unready.end, unready.reason) == (Stage.CLOSED, EpisodeEnd.INTERRUPTED, "Ctrl-C")


def test_of_several_errors_while_closing_the_first_is_told() -> None:
    state = stepped()
    state, _ = report(state, "b", Phase.FINAL, 1, error="no space")
    assert (state.waiting, state.reason) == ({"a"}, "b: no space")
    assert report(state, "b", Phase.FINAL, 1, error="once more") == (state, None)
    state, _ = report(state, "a", Phase.FINAL, 1, error="no bag")
    assert (state.stage, state.end, state.reason) == (Stage.CLOSED, EpisodeEnd.FAILED, "b: no space")
    assert report(state, "a", Phase.FINAL, 1) == (state, None)
    named = replace(CONFIG, display_names={"b": "b (node mine)"})
    state, _ = on_report(stepped(), StepReport(1, "b", Phase.FINAL, "no space"), named, 0.0)
    assert state.reason == "b (node mine): no space"


def test_work_on_a_step_before_counts_as_work_too() -> None:
    def did(state: LockstepState, name: str, step: int, busy_s: float) -> LockstepState:
        return on_report(state, StepReport(step, name, Phase.STEP, busy_s=busy_s), TRAILING, 0.0)[0]

    state = did(did(did(did(stepping(), "a", 0, 1.0), "a", 1, 2.0), "b", 0, 10.0), "b", 1, 20.0)
    assert state.busy_s == {"a": 3.5, "b": 30.5}
    assert (state.step, state.waiting, state.owing) == (2, {"a", "b"}, frozenset())


def test_the_last_step_waits_for_everybody_and_a_failure_counts_what_all_have_done() -> None:
    state = stepping()
    for name, step in (("a", 0), ("a", 1), ("b", 0)):
        state, _ = trailing(state, name, step)
    assert (state.step, state.owing, state.steps_done) == (2, {"b"}, 1)
    _, action = on_failure(state, TRAILING, 1.0, "a: killed")
    assert action == EndEpisode(1, EpisodeEnd.FAILED, "a: killed")
    state, _ = trailing(state, "b", 1)
    assert (state.owing, state.steps_done) == (frozenset(), 2)
    closing, action = on_failure(state, TRAILING, 1.0, "a: killed", frozenset({"a"}))
    assert action == EndEpisode(2, EpisodeEnd.FAILED, "a: killed")
    assert closing.steps_closed == 2


def test_an_interrupt_before_step_0_is_no_failure_of_those_that_are_not_ready() -> None:
    """They cannot close either, because they are not connected yet."""
    closing, action = on_interrupt(start_lockstep(CONFIG, 0.0), CONFIG, 1.0, "Ctrl-C")
    assert action == EndEpisode(0, EpisodeEnd.INTERRUPTED, "Ctrl-C")
    closed, _ = on_time(closing, CONFIG, 1.0 + CONFIG.late_close_timeout_s)
    assert (closed.stage, closed.end, closed.reason) == (Stage.CLOSED, EpisodeEnd.INTERRUPTED, "Ctrl-C")
    gone, _ = on_failure(closing, CONFIG, 1.1, "a: killed", frozenset({"a", "b"}))
    assert (gone.stage, gone.end, gone.reason) == (Stage.CLOSED, EpisodeEnd.INTERRUPTED, "Ctrl-C")


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


@pytest.mark.parametrize(("name", "lag"), [("/fast", 0), ("/lagged", 1)])
def test_messages_for_up_to_64_steps_ahead_are_kept(name: str, lag: int) -> None:
    """Counted from the step that is next, and with the lag of the topic."""
    join = TickJoin(INPUTS)
    assert [step for item in MESSAGES[:4] for step, _ in join.offer(*item, "x")] == [0, 1]
    assert join.next_step == 2
    assert list(join.offer(name, 2 + 64 - lag, "x")) == []
    with pytest.raises(EpisodeError, match="which has not begun"):
        list(join.offer(name, 2 + 65 - lag, "x"))


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


def test_second_messages_and_those_of_steps_that_are_over_are_refused() -> None:
    join = TickJoin((Input(FAST), Input(LAGGED, lag_steps=1)))
    assert [step for name in ("/fast", "/lagged") for step, _ in join.offer(name, 0, "x")] == [0]
    for due, steps in ((("/fast", 1), [1]), (("/fast", 2), [])):
        assert [step for step, _ in join.offer(*due, "x")] == steps
        for name, step in (("/fast", 0), due, ("/lagged", 0)):
            with pytest.raises(EpisodeError, match=f"{name}: a second message for step {step}"):
                list(join.offer(name, step, "x"))
    once(FAST, None)
    with pytest.raises(EpisodeError, match="/fast: a second message, although it is published once"):
        once(FAST, "x")
