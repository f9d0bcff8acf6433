"""The thresholds of the risk labels as options of a command."""

import argparse
from dataclasses import fields
from typing import Final

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.labels import RiskThresholds

_MEANINGS: Final = {
    "time_to_collision_s": "near-miss: a TTC below this",
    "time_to_collision_for_s": "near-miss: for so long without interruption",
    "closing_mps": "near-miss: while closing faster than this",
    "post_encroachment_s": "near-miss: a PET below this",
    "required_deceleration_mps2": "near-miss: a required deceleration above this",
    "gap_m": "near-miss: at a gap below this, for the deceleration",
}


def add_thresholds(verb: argparse.ArgumentParser) -> None:
    """One option for each threshold."""
    group = verb.add_argument_group("thresholds of the labels")
    for one in fields(RiskThresholds):
        option = f"--{one.name.replace('_', '-')}"
        group.add_argument(option, type=float, metavar="X", help=f"{_MEANINGS[one.name]} (default {one.default:g})")


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
