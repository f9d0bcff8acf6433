"""``siren evaluate TASK``: how well models do on recorded episodes."""

from typing import Final

from siren_ros.cli.command import Command

_TASKS: Final = {
    "prediction": ("trajectory prediction: 5 s ahead, ADE and FDE", "prediction.add_arguments"),
    "yield": (
        "how traffic made way: the EMV's delay, corridor, drivers' responses, wake, safety",
        "yielding.add_yield",
    ),
    "counterfactual": (
        "the effect of siren and level: the same seeds at several levels",
        "yielding.add_counterfactual",
    ),
    "diversity": ("how different episodes are, and what more seeds would add", "yielding.add_diversity"),
    "detection": ("3-D detection: the nuScenes score of a detector's boxes", "detection.add_arguments"),
    "risk": (
        "vision-language risk understanding: normal scenes, near-misses and collisions in videos",
        "risk.add_arguments",
    ),
}
"""What the tasks are, and which function of the folder ``evaluation`` adds their arguments."""


def add_arguments(verb: Command) -> None:
    """Adds the description and the options of the command."""
    verb.description = "Scores models on recorded episodes."
    tasks = verb.add_subparsers(title="tasks", metavar="TASK", required=True)
    for name, (summary, add) in _TASKS.items():
        tasks.add_parser(name, help=summary, add=f"evaluation.{add}")
