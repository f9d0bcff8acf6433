"""The parts of the trainings that need torch, which an extra installs: loaded when a training begins."""

from importlib import import_module
from typing import Any

from siren_ros.errors import InputError


def torch_part(task: str, module: str, name: str) -> Any:
    """A function by the names of its module and itself.

    Args:
        task: The word after ``siren train``, for the message.
        module: Imports torch.
        name: Of the function.

    Raises:
        InputError: The extra is not installed.
    """
    try:
        return getattr(import_module(module), name)
    except ModuleNotFoundError as error:
        runs = f"./env --with models siren train {task} …"
        raise InputError("environment", f"no {error.name}", f"the extra models, as {runs} brings it") from error
