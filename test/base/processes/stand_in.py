"""Processes that are stood in for: what a test hands in answers their calls, here and now."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from types import SimpleNamespace
from typing import Any


def processes_of(answer: Callable[..., Any]) -> Callable[[int], AbstractContextManager[SimpleNamespace]]:
    """Takes the place of ``attempt_processes``.

    Args:
        answer: Is called as ``ProcessPool.call_with_retries``.
    """
    return lambda _: nullcontext(SimpleNamespace(call_with_retries=answer, stop=lambda: None))
