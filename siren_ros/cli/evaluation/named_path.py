"""Arguments of the form ``NAME=PATH``."""

import argparse
from pathlib import Path


def named_path(text: str) -> tuple[str, Path]:
    """The type of an argument ``NAME=PATH``; argparse prints the error."""
    name, equals, path = text.partition("=")
    if not (name and equals and path):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=PATH")
    return name, Path(path)
