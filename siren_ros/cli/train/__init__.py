"""``siren train``: models that ship with the project; each task is a module of this package."""

import argparse
from importlib import import_module
from typing import Final

_TASKS: Final = {
    "prediction": "the trajectory predictor siren",
    "detection": "the LiDAR detector pillars",
    "risk": "the sequence model of risk videos",
}


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = "Trains models that ship with the project."
    tasks = verb.add_subparsers(title="tasks", metavar="TASK", required=True)
    for name, summary in _TASKS.items():
        import_module(f"{__package__}.{name}").add_arguments(tasks.add_parser(name, help=summary))
