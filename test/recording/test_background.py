"""The worker keeps the order, raises the first error in its caller, and ends."""

import threading

import pytest

from siren_ros.recording.background import BackgroundWorker


def test_items_are_worked_on_in_order_and_in_another_thread() -> None:
    done: list[tuple[int, str]] = []
    worker = BackgroundWorker(lambda item: done.append((item, threading.current_thread().name)), 2, "own")
    for number in range(20):
        worker.put(number)
    worker.close()
    assert done == [(number, "own") for number in range(20)]
    worker.close()


def test_the_first_error_is_raised_and_what_comes_after_it_is_dropped() -> None:
    done: list[int] = []
    gate = threading.Event()

    def work(item: int) -> None:
        gate.wait(10.0)
        if item in {1, 2}:
            raise ValueError(item)
        done.append(item)

    worker = BackgroundWorker(work, 8, "own")
    for number in range(4):
        worker.put(number)
    gate.set()
    with pytest.raises(ValueError, match="1"):
        worker.close()
    assert done == [0]
    with pytest.raises(ValueError, match="1"):
        worker.put(5)


def test_a_full_queue_makes_the_caller_wait() -> None:
    """One item is under way and two wait: the fourth is not taken until there is space."""
    gate, taken = threading.Event(), []
    worker = BackgroundWorker(lambda _: gate.wait(10.0), 2, "own")

    def fill() -> None:
        for number in range(4):
            worker.put(number)
            taken.append(number)

    caller = threading.Thread(target=fill)
    caller.start()
    caller.join(0.3)
    assert caller.is_alive()
    assert len(taken) <= 3
    gate.set()
    caller.join(10.0)
    worker.close()
    assert taken == [0, 1, 2, 3]
