"""Which steps are copied for programs that only watch, by a clock that the tests move."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces.topics import ACTORS, EVENTS, TRAFFIC
from siren_ros.running.ros.transport.copies import EARLY_PERIODS, PERIOD_S, StepCopies, happens

TOPICS = ("traffic", "actors", "events")
Sent = list[tuple[int, str]]


class Stream:
    """Steps of three topics that go through the choice."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.sent: Sent = []
        self.copies = StepCopies(clock_s=lambda: self.now_s)

    def step(self, number: int, happening: str = "") -> None:
        for topic in TOPICS:
            self.copies.take(number, topic == happening, lambda topic=topic: self.sent.append((number, topic)))

    def run(self, times_s: Sequence[float], happening: dict[int, str] | None = None) -> list[int]:
        """The steps that are copied, each of them whole."""
        for number, self.now_s in enumerate(times_s):
            self.step(number, (happening or {}).get(number, ""))
        steps = [number for number, _ in self.sent[:: len(TOPICS)]]
        assert self.sent == [(number, topic) for number in steps for topic in TOPICS]
        return steps


def test_a_fast_episode_has_a_copied_step_every_period() -> None:
    """At twelve times real time and 240 steps a second."""
    times_s = np.arange(2400) * STEP_S / 12.0
    steps = Stream().run(times_s.tolist())
    apart_s = np.diff(times_s[steps])[EARLY_PERIODS + 1 :]
    assert apart_s == pytest.approx(PERIOD_S, abs=STEP_S / 12.0 + 1e-9)
    assert len(steps) == pytest.approx(times_s[-1] / PERIOD_S, abs=EARLY_PERIODS + 1)
    assert 1.0 / apart_s.max() >= 10.0


@pytest.mark.parametrize("pace", [1.0, 0.5])
def test_at_real_time_and_slower_all_steps_are_copied(pace: float) -> None:
    """Each step is up to 45 ms later than its time, and once the program halts for a second."""
    late_s = np.random.default_rng(0).uniform(0.0, 0.045, 400)
    times_s = np.arange(400) * STEP_S / pace + late_s
    times_s[200:] += 1.0
    times_s[200:203] = times_s[200]
    assert Stream().run(np.sort(times_s).tolist()) == list(range(400))


def test_a_little_faster_than_real_time_some_are_left_out() -> None:
    """Otherwise the test before says nothing."""
    assert len(Stream().run((np.arange(400) * STEP_S / 1.2).tolist())) < 350


@pytest.mark.parametrize("topic", TOPICS)
def test_a_step_in_which_something_happens_is_copied_whole(topic: str) -> None:
    times_s = (np.arange(100) * 1e-3).tolist()
    assert 47 not in Stream().run(times_s)
    assert 47 in Stream().run(times_s, {47: topic})


def test_the_last_step_is_copied_once() -> None:
    stream = Stream()
    assert 99 not in stream.run((np.arange(100) * 1e-3).tolist())
    for _ in range(2):
        stream.copies.send_held()
    assert [number for number, _ in stream.sent].count(99) == len(TOPICS)
    assert stream.sent[-1] == (99, TOPICS[-1])


@given(
    st.lists(st.floats(0.0, 0.2), min_size=1, max_size=80),
    st.dictionaries(st.integers(0, 79), st.sampled_from(TOPICS)),
)
def test_whatever_the_times_nothing_that_happens_is_lost_and_order_stays(
    waits_s: list[float], happening: dict[int, str]
) -> None:
    steps = Stream().run(np.cumsum(waits_s).tolist(), happening)
    assert steps == sorted(set(steps))
    assert {number for number in happening if number < len(waits_s)} <= set(steps)


def traffic(spawned: tuple[int, ...] = (), signals: tuple[str, ...] = ("r",)) -> Any:
    return SimpleNamespace(spawned=spawned, signals=signals)


def test_events_new_actors_and_signals_that_change_are_happenings() -> None:
    assert happens(EVENTS.name, (3, 0, ("contact",)), (2, 0, ()))
    assert not happens(EVENTS.name, (3, 0, ()), (2, 0, ("contact",)))
    assert happens(TRAFFIC.name, traffic(), None)
    assert happens(TRAFFIC.name, traffic(spawned=(7,)), traffic())
    assert happens(TRAFFIC.name, traffic(signals=("g",)), traffic())
    assert not happens(TRAFFIC.name, traffic(), traffic(spawned=(7,)))
    assert not happens(ACTORS.name, None, None)
