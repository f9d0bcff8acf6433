"""What the command lines share: a parser whose errors are one line, and the numbers that arguments may have."""

import argparse
import math
import sys
from typing import Final, Never

EXIT_USAGE: Final = 2


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line and exit code 2."""

    def error(self, message: str) -> Never:
        """Says what is wrong with the call and where its help is."""
        sys.stderr.write(f"{self.prog}: {message}; '{self.prog} --help' tells the usage\n")
        sys.exit(EXIT_USAGE)


def positive(text: str) -> float:
    """A finite number above zero."""
    value = float(text)
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"'{text}' cannot be used; allowed: a number above 0")
    return value


def not_negative(text: str) -> float:
    """A finite number, zero or more."""
    value = float(text)
    if not (math.isfinite(value) and value >= 0.0):
        raise argparse.ArgumentTypeError(f"'{text}' cannot be used; allowed: 0 and more")
    return value
