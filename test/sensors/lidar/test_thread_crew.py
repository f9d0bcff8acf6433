"""A loop that several threads share is done wholly, each part once."""

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.sensors.lidar.thread_crew import Crew, everybody


@given(size=st.integers(0, 4), count=st.integers(0, 200), grain=st.integers(1, 50))
@settings(max_examples=40, deadline=None)
def test_every_index_is_done_once(size: int, count: int, grain: int) -> None:
    done = np.zeros(count, np.int64)
    members = set()

    def work(member: int, first: int, end: int) -> None:
        assert end - first <= grain
        done[first:end] += 1
        members.add(member)

    Crew(size).share(work, count, grain)
    assert (done == 1).all()
    assert members <= set(range(max(1, size)))


def test_members_have_threads_of_their_own_and_the_caller_takes_part() -> None:
    everybody_is_here = threading.Barrier(3)
    threads: dict[int, str] = {}

    def work(member: int, first: int, end: int) -> None:
        assert end == first + 1
        threads[member] = threading.current_thread().name
        everybody_is_here.wait(10.0)

    Crew(3).share(work, 3, 1)
    assert sorted(threads) == [0, 1, 2]
    assert len(set(threads.values())) == 3
    assert threads[0] == threading.current_thread().name


def test_what_is_no_longer_than_a_part_stays_with_the_caller() -> None:
    threads = []
    Crew(4).share(lambda _member, _first, _end: threads.append(threading.current_thread()), 10, 10)
    assert threads == [threading.current_thread()]


@pytest.mark.parametrize("failing", [0, 1])
def test_an_error_of_any_member_reaches_the_caller(failing: int) -> None:
    both = threading.Barrier(2)

    def work(member: int, first: int, end: int) -> None:
        assert end == first + 1
        both.wait(10.0)
        if member == failing:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        Crew(2).share(work, 2, 1)


def test_there_is_one_crew_for_everybody() -> None:
    assert everybody() is everybody()
    assert everybody().size >= 1
