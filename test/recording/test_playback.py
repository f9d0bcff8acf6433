from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.interfaces import topics
from siren_ros.recording.bag_reader import open_bag
from siren_ros.recording.playback import MAX_BURST_NS, Playhead, messages_from

STEP_NS = 50_000_000


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "bag", duration_s=1.0)


def test_the_playhead_keeps_the_rate() -> None:
    head = Playhead(0, 10.0, 2.0)
    for tick in range(1, 101):
        head = head.advance(10.0 + tick * 0.01)
    assert head.position_ns == pytest.approx(2e9, abs=100)


@given(st.lists(st.floats(0.0, 10.0), min_size=1), st.floats(0.01, 100.0))
def test_the_playhead_never_runs_back_and_never_jumps(pauses_s: list[float], rate: float) -> None:
    head, now_s = Playhead(0, 0.0, rate), 0.0
    for pause_s in pauses_s:
        now_s += pause_s
        before, head = head.position_ns, head.advance(now_s)
        assert 0 <= head.position_ns - before <= MAX_BURST_NS


def test_a_paused_playhead_stands_still_and_goes_on_from_there() -> None:
    head = Playhead(0, 0.0, 1.0).pause(0.1, paused=True)
    assert head.position_ns == 100_000_000
    head = head.advance(50.0)
    assert head.position_ns == 100_000_000
    assert head.pause(60.0, paused=False).advance(60.05).position_ns == 150_000_000


def test_held_at_a_message_that_cannot_go_out_it_goes_on_from_there() -> None:
    head = Playhead(0, 0.0, 1.0).advance(0.1).held_at(50_000_000)
    assert head.position_ns == 50_000_000
    assert head.advance(0.15).position_ns == pytest.approx(100_000_000, abs=1)
    assert head.held_at(90_000_000) == head


def test_from_the_start_every_message_comes_in_the_order_of_the_bag(bag: Path) -> None:
    with open_bag(bag) as opened:
        assert [item.cdr for item in messages_from(opened, 0)] == [item.cdr for item in opened.messages()]


def test_from_the_middle_what_is_latched_comes_first(bag: Path) -> None:
    with open_bag(bag) as opened:
        played = list(messages_from(opened, 10 * STEP_NS))
        latched = [item.topic for item in played if item.time_ns < 10 * STEP_NS]
        assert set(latched) == {topics.EPISODE.name, topics.MAP.name}
        assert len(latched) == 2
        rest = [item for item in played if item.time_ns >= 10 * STEP_NS]
        assert played[2:] == rest
        assert [item.cdr for item in rest] == [item.cdr for item in opened.messages() if item.time_ns >= 10 * STEP_NS]
        assert [item.topic for item in messages_from(opened, 10**12)] == [
            item.topic for item in opened.messages() if item.topic in opened.latched
        ]


def test_of_a_latched_topic_the_last_message_before_the_start_comes() -> None:
    messages = [SimpleNamespace(topic="/latched", time_ns=10 * place, cdr=bytes([place])) for place in range(4)]
    messages.insert(2, SimpleNamespace(topic="/other", time_ns=15, cdr=b"other"))
    bag: Any = SimpleNamespace(latched=frozenset({"/latched"}), messages=lambda: iter(messages))
    for start_ns, expected in ((20, [b"\1", b"\2", b"\3"]), (35, [b"\3"]), (15, [b"\1", b"other", b"\2", b"\3"])):
        assert [item.cdr for item in messages_from(bag, start_ns)] == expected
