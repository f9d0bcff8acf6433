"""The thresholds of the risk labels as options of a command."""

import argparse
from dataclasses import fields

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.labels import RiskThresholds


def add_thresholds(verb: argparse.ArgumentParser) -> None:
    """One option for each threshold."""
    group = verb.add_argument_group("thresholds of the labels")
    for one in fields(RiskThresholds):
        group.add_argument(
            f"--{one.name.replace('_', '-')}", type=float, metavar="X", help=f"(default {one.default:g})"
        )


def thresholds_of(arguments: argparse.Namespace, base: RiskThresholds | None = None) -> RiskThresholds:
    """The thresholds that the options give; what is not given is as in ``base``.

    Raises:
        InputError: A value that is not positive.
    """
    start = base or RiskThresholds()
    values = {}
    for one in fields(RiskThresholds):
        given = getattr(arguments, one.name)
        if given is not None and not 0.0 < given < float("inf"):
            raise InputError(one.name, given, "a positive number")
        values[one.name] = getattr(start, one.name) if given is None else given
    return RiskThresholds(**values)
