"""A function is called again where its process dies, and nowhere else."""

from typing import Any

import pytest

from siren_ros.errors import EpisodeError, InputError
from siren_ros.studies.own_process import Died, Refused, Returned
from siren_ros.studies.risk_set import retried
from siren_ros.studies.risk_set.retried import in_own_process


def added(first: int, second: int) -> int:
    return first + second


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the processes answer, one after the other; without an answer they return what the function does."""
    given: list[Any] = []

    def call(function: Any, *arguments: Any, timeout_s: float) -> Any:
        assert timeout_s == pytest.approx(15.0 * 60.0)
        return given.pop(0) if given else Returned(function(*arguments))

    monkeypatch.setattr(retried, "call_in_own_process", call)
    return given


@pytest.mark.parametrize("deaths", [0, 1, 2])
def test_an_answer_counts_after_as_many_deaths_as_may_be(answers: list[Any], deaths: int) -> None:
    answers.extend([Died("killed")] * deaths)
    assert in_own_process(2, added, 3, 4) == 7
    assert not answers


@pytest.mark.parametrize("retries", [0, 2])
def test_one_death_more_is_an_error_that_tells_all_of_them(answers: list[Any], retries: int) -> None:
    answers.extend(Died(f"signal {number}") for number in range(5))
    told = "; ".join(f"signal {number}" for number in range(retries + 1))
    with pytest.raises(EpisodeError, match=rf"added: {told}$"):
        in_own_process(retries, added, 3, 4)
    assert len(answers) == 4 - retries


@pytest.mark.parametrize(("exit_code", "error"), [(2, InputError), (3, EpisodeError), (1, EpisodeError)])
def test_what_the_function_refuses_is_not_tried_again(
    answers: list[Any], exit_code: int, error: type[Exception]
) -> None:
    answers.extend([Died("killed"), Refused("no such map", exit_code)])
    with pytest.raises(error, match="no such map"):
        in_own_process(5, added, 3, 4)
    assert not answers
