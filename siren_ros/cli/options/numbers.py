"""Limits of a command's numbers: refused by their own names before any work begins."""

import argparse
from collections.abc import Mapping

from siren_ros.errors import InputError


def check_numbers(arguments: argparse.Namespace, limits: Mapping[str, tuple[float, float]]) -> None:
    """Checks options against the least and the largest number that they may have; those that are not given are fine.

    Raises:
        InputError: A number outside its limits, or none at all (nan).
    """
    for name, (least, most) in limits.items():
        value = getattr(arguments, name)
        if value is not None and not least <= value <= most:
            kind = "an integer" if isinstance(value, int) else "a number"
            raise InputError(name, value, f"{kind} from {least:.12g} to {most:.12g}")
