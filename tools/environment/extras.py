"""Prints the names of the extras that pyproject.toml declares, one per line.

extras.py PYPROJECT_TOML
"""

import sys
import tomllib
from pathlib import Path


def extra_names(text: str) -> list[str]:
    """The keys of ``[project.optional-dependencies]`` in a pyproject.toml's text."""
    return list(tomllib.loads(text)["project"]["optional-dependencies"])


if __name__ == "__main__":
    sys.stdout.writelines(f"{name}\n" for name in extra_names(Path(sys.argv[1]).read_text(encoding="utf-8")))
