import threading
import time
from functools import partial

import pytest

from siren_ros.base.processes.side_by_side import side_by_side
from siren_ros.errors import EpisodeError


@pytest.mark.parametrize("workers", [1, 3])
def test_results_have_the_names_of_their_tasks(workers: int) -> None:
    tasks = {f"{number} squared": partial(pow, number, 2) for number in range(7)}
    assert side_by_side(tasks, workers) == {f"{number} squared": number**2 for number in range(7)}


def test_two_workers_work_at_the_same_time() -> None:
    meeting = threading.Barrier(2)
    arrivals = side_by_side({name: partial(meeting.wait, 30.0) for name in "ab"}, 2)
    assert sorted(arrivals.values()) == [0, 1]


def test_the_first_error_is_raised_and_nothing_new_begins() -> None:
    begun = []

    def task(number: int) -> None:
        begun.append(number)
        if number == 1:
            raise EpisodeError("the second task")
        time.sleep(0.05)  # as work does, so that there is time to stop the others

    with pytest.raises(EpisodeError, match="the second task"):
        side_by_side({str(number): partial(task, number) for number in range(50)}, 1)
    assert begun[:2] == [0, 1]
    assert len(begun) < 50
