"""Runs SUMO's ``netconvert``, and makes what it writes the same bytes on every machine."""

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from siren_ros.errors import MapError, SirenError

TIMEOUT_S: Final = 900.0
"""Longest that one import may take; a city of OpenStreetMap takes about a minute."""

_PROLOGUE: Final = re.compile(rb"\s*(<\?xml[^>]*\?>)?(?:\s*<!--.*?-->)*\s*", re.DOTALL)
_ERROR_LINE: Final = re.compile(r"^Error: *(.+)$", re.MULTILINE)


@cache
def sumo_home() -> Path:
    """The folder of SUMO: the wheel's, else ``SUMO_HOME``.

    Raises:
        SirenError: SUMO is not installed.
    """
    spec = find_spec("sumo")
    if spec is not None and spec.submodule_search_locations:
        home = Path(next(iter(spec.submodule_search_locations)))
        if (home / "bin" / "netconvert").is_file():
            return home
    if "SUMO_HOME" in os.environ:
        return Path(os.environ["SUMO_HOME"])
    raise SirenError("SUMO is not installed: neither the eclipse-sumo wheel nor SUMO_HOME is there")


@cache
def netconvert_path() -> Path:
    """The netconvert program.

    Raises:
        SirenError: There is none.
    """
    own = sumo_home() / "bin" / "netconvert"
    if own.is_file():
        return own
    found = shutil.which("netconvert")
    if found is None:
        raise SirenError(f"netconvert is neither in {own.parent} nor on the PATH")
    return Path(found)


@cache
def netconvert_version() -> str:
    """SUMO's version, part of every cache key."""
    try:
        return version("eclipse-sumo")
    except PackageNotFoundError:
        answer = subprocess.run(  # noqa: S603 - SUMO's own program, fixed arguments
            [str(netconvert_path()), "--version"], capture_output=True, text=True, check=False
        )
        return answer.stdout.partition("\n")[0]


def run_netconvert(options: Sequence[str], output: Path, shown_source: str) -> bytes:
    """Compiles a net and returns it without netconvert's dated header.

    Args:
        options: All options but the output file.
        output: Where netconvert writes; its folder must exist.
        shown_source: What the error names as the map.

    Raises:
        MapError: netconvert refused the input; the message carries its first error line.
    """
    command = [str(netconvert_path()), *options, "--output-file", str(output)]
    environment = {**os.environ, "SUMO_HOME": str(sumo_home()), "LC_ALL": "C"}
    try:
        answer = subprocess.run(  # noqa: S603 - SUMO's own program; file names are arguments, no shell
            command, capture_output=True, text=True, errors="replace", check=False, env=environment, timeout=TIMEOUT_S
        )
    except subprocess.TimeoutExpired as error:
        raise MapError(shown_source, f"a map that netconvert imports within {TIMEOUT_S:.0f} s") from error
    if answer.returncode != 0 or not output.is_file():
        found = _ERROR_LINE.search(answer.stderr) or _ERROR_LINE.search(answer.stdout)
        reason = found.group(1).strip() if found else f"exit code {answer.returncode}"
        raise MapError(shown_source, f"a map that netconvert can import (it said: {reason})")
    return without_header(output.read_bytes())


def without_header(net_xml: bytes) -> bytes:
    """The net without comments before its root element: netconvert's carry the date and the paths."""
    prologue = _PROLOGUE.match(net_xml)
    if prologue is None:
        return net_xml
    declaration = prologue.group(1)
    return (declaration + b"\n" if declaration else b"") + net_xml[prologue.end() :]
