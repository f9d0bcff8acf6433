"""``siren evaluate counterfactual BAG…``: what siren and level are worth, from the same seeds at several levels."""

import argparse
import json
from pathlib import Path

from siren_ros.cli.evaluation.evaluate_yield import scored_episodes
from siren_ros.cli.options import add_processes, processes_of
from siren_ros.errors import EXIT_FAILED, whole_file, writing
from siren_ros.evaluation.yielding.counterfactual import OUTCOMES, Effect, effect_tables, effects
from siren_ros.recording.bag_reader import bags_among
from siren_ros.tables.table import text_of


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = (
        "Compares levels on the same seeds: map, demand, route, drivers and draws are the same, so that the difference "
        "is the effect of the level. Prints mean differences with 95 % intervals over pairs, the p-value "
        "of a permutation test, adjusted for all comparisons of an outcome (Holm), and in how many pairs an episode "
        "ended before its value was complete. Exit code 1 where there is no pair."
    )
    verb.add_argument("bags", type=Path, metavar="BAG", nargs="+", help="bags, or folders with bags at any depth")
    verb.add_argument(
        "--outcomes",
        nargs="+",
        choices=OUTCOMES,
        default=list(OUTCOMES[:4]),
        metavar="NAME",
        help=f"of {', '.join(OUTCOMES)}",
    )
    verb.add_argument("--out", type=Path, metavar="FILE", help="write the effects on all outcomes as JSON")
    add_processes(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Scores every bag and compares the levels."""
    episodes, worst = scored_episodes(bags_among(arguments.bags), processes_of(arguments), OUTCOMES)
    found = effects(episodes)
    shown = [one for one in found if one.outcome in arguments.outcomes and one.found.difference.valid]
    print("\n".join(text_of(effect_tables(shown))) or "no two episodes of one seed at different levels")
    if arguments.out is not None:
        with writing(arguments.out), whole_file(arguments.out) as file:
            file.write_text(json.dumps([as_json(one) for one in found], indent=1) + "\n", encoding="utf-8")
    return worst if shown else max(worst, EXIT_FAILED)


def as_json(effect: Effect) -> dict[str, object]:
    """An effect as JSON types."""
    difference = effect.found.difference
    return {
        "template": effect.template,
        "outcome": effect.outcome,
        "levels": [effect.first, effect.second],
        "difference": difference.value if difference.valid else None,
        "interval": [difference.low, difference.high] if difference.bounded else None,
        "pairs": difference.blocks,
        "cut_off": effect.cut_off,
        "p_value": effect.found.p_value,
        "adjusted_p_value": effect.adjusted_p,
    }
