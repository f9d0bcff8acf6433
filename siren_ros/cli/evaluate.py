"""``siren evaluate TASK``: how well models do on recorded episodes."""

import argparse
from importlib import import_module
from typing import Final

_TASKS: Final = {
    "prediction": "trajectory prediction: 5 s ahead, ADE and FDE",
    "yield": "how traffic made way: the EMV's delay, corridor, drivers' responses, wake, safety",
    "counterfactual": "what siren and level are worth: the same seeds at several levels",
    "diversity": "how different episodes are, and what more seeds would still add",
    "detection": "3-D detection: the nuScenes score of boxes that a detector found",
    "risk": "vision-language risk understanding: normal scenes, near-misses and collisions in videos",
}
"""What the tasks are; each is a module ``evaluation/evaluate_TASK`` with ``add_arguments`` as a verb has."""


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = "Scores models on recorded episodes."
    tasks = verb.add_subparsers(title="tasks", metavar="TASK", required=True)
    for name, summary in _TASKS.items():
        import_module(f"{__package__}.evaluation.evaluate_{name}").add_arguments(tasks.add_parser(name, help=summary))
