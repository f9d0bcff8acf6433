"""Calls of functions in processes of their own, again where a process dies."""

from collections.abc import Callable
from typing import Any, Final, TypeVar

from siren_ros.errors import EpisodeError, InputError
from siren_ros.studies.own_process import Died, Refused, call_in_own_process

_TIMEOUT_S: Final = 900.0
Result = TypeVar("Result")


def in_own_process(retries: int, function: Callable[..., Result], *arguments: Any) -> Result:
    """Calls a function in a process of its own, again where that process dies.

    Raises:
        InputError: The function refuses its input.
        EpisodeError: It fails, or its process died more often than may be.
    """
    reasons: list[str] = []
    while True:
        answer = call_in_own_process(function, *arguments, timeout_s=_TIMEOUT_S)
        if isinstance(answer, Refused):
            if answer.exit_code == InputError.exit_code:
                raise InputError(function.__name__, answer.reason, "input that can be used")
            raise EpisodeError(answer.reason)
        if not isinstance(answer, Died):
            return answer.value
        reasons.append(answer.reason)
        if len(reasons) > retries:
            raise EpisodeError(f"{function.__name__}: {'; '.join(reasons)}")
