"""Steps of a progress bar, for library code that tells them by calling a function."""

from collections.abc import Callable
from typing import Any

from tqdm import tqdm


def steps_of(bar: "tqdm[Any]") -> Callable[[], None]:
    """What moves a bar on by one each time it is called."""

    def step() -> None:
        bar.update()

    return step
