"""Arguments that are whole numbers from 1 on."""

import argparse


def positive(text: str) -> int:
    """The type of such an argument; argparse prints the error."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 on")
    return value
