"""Prints the names of the extras that setup.py declares, one per line; setup.py is read, not run.

extras.py SETUP_PY
"""

import ast
import sys
from pathlib import Path


def extra_names(source: str) -> list[str]:
    """The keys of the literal ``extras_require={...}`` in a setup.py's text."""
    return [
        ast.literal_eval(key)
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.keyword) and node.arg == "extras_require" and isinstance(node.value, ast.Dict)
        for key in node.value.keys
        if key is not None
    ]


if __name__ == "__main__":
    sys.stdout.writelines(f"{name}\n" for name in extra_names(Path(sys.argv[1]).read_text(encoding="utf-8")))
