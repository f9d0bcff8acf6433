"""Tables from scores that a command has written."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from siren_ros.errors import InputError
from siren_ros.evaluation.paper_comparison.stored_scores import stored
from siren_ros.study_report.content import Table


def stored_tables(
    task: str, folder: Path, tables: Callable[[Mapping[str, Any]], Iterable[Table]]
) -> tuple[Table, ...] | None:
    """The tables of the scores in a folder; None where there are none.

    Args:
        task: As ``siren evaluate`` names it.
        folder: With ``scores.json``.
        tables: Made from its content.

    Raises:
        InputError: The scores are those of something else.
    """
    content = stored(folder)
    if content is None:
        return None
    try:
        return tuple(tables(content))
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(task, str(folder), f"scores of `siren evaluate {task}` ({error!r})") from error
