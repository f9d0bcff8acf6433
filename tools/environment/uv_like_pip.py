"""Runs uv with the package indexes, certificates and proxies that are configured for pip.

uv_like_pip.py ARGUMENT...
"""

import ast
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

LINE_VARIABLES = {
    "index-url": "UV_DEFAULT_INDEX",
    "cert": "SSL_CERT_FILE",
    "client-cert": "SSL_CLIENT_CERT",
    "proxy": "ALL_PROXY",
    "timeout": "UV_HTTP_TIMEOUT",
    "default-timeout": "UV_HTTP_TIMEOUT",
    "retries": "UV_HTTP_RETRIES",
}
"""pip's settings that hold one value, and the variables that uv takes them from."""

LIST_VARIABLES = {
    "extra-index-url": ("UV_INDEX", " "),
    "find-links": ("UV_FIND_LINKS", ","),
    "trusted-host": ("UV_INSECURE_HOST", " "),
}
"""Those that hold several values, and what separates them for uv."""


def pip_settings(lines: Iterable[str]) -> dict[str, str]:
    """The settings of ``pip install`` in the output of ``pip config list``.

    A variable comes before the section ``[install]``, and that before ``[global]``.
    """
    ranks = {"global": 0, "install": 1, ":env:": 2}
    ranked: dict[str, tuple[int, str]] = {}
    for line in lines:
        key, _, literal = line.partition("=")
        section, _, name = key.rpartition(".")
        rank = ranks.get(section)
        if rank is not None and rank >= ranked.get(name, (-1, ""))[0]:
            ranked[name] = (rank, str(ast.literal_eval(literal)))
    return {name: value for name, (_, value) in ranked.items()}


def uv_variables(settings: Mapping[str, str], environment: Mapping[str, str]) -> dict[str, str]:
    """What uv has to find in its environment to act as pip with these settings; what is set there already stays."""
    variables = {"UV_INDEX_STRATEGY": "unsafe-best-match"}  # as pip: the best version of all indexes
    for name, variable in LINE_VARIABLES.items():
        if settings.get(name):
            variables[variable] = settings[name]
    for name, (variable, separator) in LIST_VARIABLES.items():
        if settings.get(name):
            variables[variable] = separator.join(settings[name].split())
    if settings.get("no-index", "").lower() in {"1", "true", "yes", "on"}:
        variables["UV_NO_INDEX"] = "1"
    return {name: value for name, value in variables.items() if name not in environment}


def main() -> None:
    """Becomes the uv of this interpreter's environment."""
    listing = subprocess.run(
        [sys.executable, "-m", "pip", "config", "list"], check=True, capture_output=True, text=True
    ).stdout
    uv = str(Path(sys.prefix) / "bin" / "uv")
    variables = {**os.environ, **uv_variables(pip_settings(listing.splitlines()), os.environ)}
    os.execve(uv, [uv, *sys.argv[1:]], variables)  # noqa: S606 - our own uv, no shell


if __name__ == "__main__":
    main()
