"""A loop that several threads share runs completely, each part once."""

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.sensors.lidar.thread_pool import ThreadPool, shared_pool


@given(size=st.integers(0, 4), count=st.integers(0, 200), grain=st.integers(1, 50))
@settings(max_examples=40, deadline=None)
def test_every_index_is_done_once(size: int, count: int, grain: int) -> None:
    done = np.zeros(count, np.int64)
    workers = set()

    def work(worker: int, first: int, end: int) -> None:
        assert end - first <= grain
        done[first:end] += 1
        workers.add(worker)

    ThreadPool(size).run(work, count, grain)
    assert (done == 1).all()
    assert workers <= set(range(max(1, size)))


def test_each_worker_has_a_thread_of_its_own_and_the_caller_is_one() -> None:
    all_started = threading.Barrier(3)
    threads: dict[int, str] = {}

    def work(worker: int, first: int, end: int) -> None:
        assert end == first + 1
        threads[worker] = threading.current_thread().name
        all_started.wait(10.0)

    ThreadPool(3).run(work, 3, 1)
    assert sorted(threads) == [0, 1, 2]
    assert len(set(threads.values())) == 3
    assert threads[0] == threading.current_thread().name


def test_a_loop_of_one_part_stays_in_the_calling_thread() -> None:
    threads = []
    ThreadPool(4).run(lambda _worker, _first, _end: threads.append(threading.current_thread()), 10, 10)
    assert threads == [threading.current_thread()]


@pytest.mark.parametrize("failing", [0, 1])
def test_an_error_of_any_worker_reaches_the_caller(failing: int) -> None:
    both = threading.Barrier(2)

    def work(worker: int, first: int, end: int) -> None:
        assert end == first + 1
        both.wait(10.0)
        if worker == failing:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        ThreadPool(2).run(work, 2, 1)


def test_there_is_one_crew_for_shared_pool() -> None:
    assert shared_pool() is shared_pool()
    assert shared_pool().size >= 1
