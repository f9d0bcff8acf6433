"""Dataclass fields that are also parameters: a default with a description and what is allowed."""

import dataclasses
from collections.abc import Sequence
from typing import Any


def parameter(
    default: Any,
    description: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Sequence[str] = (),
) -> Any:
    """A dataclass field whose metadata say what a user has to know to set it.

    Args:
        default: Its value unless the user sets it; a list is copied for every instance.
        description: One sentence.
        minimum: Least number, if there is one.
        maximum: Largest number, if there is one.
        choices: All allowed values, if they can be counted.
    """
    metadata = {"description": description, "minimum": minimum, "maximum": maximum, "choices": tuple(choices)}
    if isinstance(default, list):
        return dataclasses.field(default_factory=lambda: list(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)
