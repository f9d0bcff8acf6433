"""Runs SUMO's ``netconvert`` so that it writes the same bytes on every machine.

Stop and yield signs are given to it as plain XML: the type of a junction and the priority of its approaches.
"""

import os
import re
import resource
import shutil
import signal
import subprocess
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, tostring

from siren_ros.errors import MapError, SirenError
from siren_ros.simulation.roads.maps.map_source import shown_words
from siren_ros.simulation.roads.net_parser import MAX_MAP_BYTES

TIMEOUT_S: Final = 900.0
"""Longest time of one import; a city of OpenStreetMap takes about a minute."""
MOST_MEMORY_BYTES: Final = 8 * 2**30
"""Largest address space of netconvert. A grid of streets with a net of 300 MB, more than SIREN reads, took 1.4 GB."""
_MOST_OUTPUT_BYTES: Final = 2 * MAX_MAP_BYTES

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
    """Path of the netconvert program.

    Raises:
        SirenError: There is none.
    """
    program = sumo_home() / "bin" / "netconvert"
    if program.is_file():
        return program
    if on_path := shutil.which("netconvert"):
        return Path(on_path)
    raise SirenError(f"netconvert is neither in {program.parent} nor on the PATH")


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

    netconvert writes to ``output``, whose folder must exist. The error names the map by ``shown_source``.

    Raises:
        MapError: netconvert refused the input, and the message carries its first error line; or it took too much time,
            memory or disk.
    """
    command = [*_bounds(), str(netconvert_path()), *options, "--output-file", str(output)]
    environment = {**os.environ, "SUMO_HOME": str(sumo_home()), "LC_ALL": "C"}
    try:
        answer = subprocess.run(  # noqa: S603 - SUMO's own program; file names are arguments, no shell
            command, capture_output=True, text=True, errors="replace", check=False, env=environment, timeout=TIMEOUT_S
        )
    except subprocess.TimeoutExpired as error:
        raise MapError(shown_source, f"a map that netconvert imports within {TIMEOUT_S:.0f} s") from error
    if answer.returncode != 0 or not output.is_file():
        raise MapError(shown_source, f"a map that netconvert can import (it said: {_reason(answer)})")
    if output.stat().st_size > MAX_MAP_BYTES:
        raise MapError(shown_source, f"a map whose net has at most {MAX_MAP_BYTES // 1_000_000} MB")
    return without_header(output.read_bytes())


def _bounds() -> Sequence[str]:
    """Command prefix that limits netconvert's memory and ends it together with this process (util-linux).

    Without the latter, netconvert would go on alone where this process is killed.
    """
    limits = {
        "as": (resource.RLIMIT_AS, MOST_MEMORY_BYTES),
        "cpu": (resource.RLIMIT_CPU, int(TIMEOUT_S)),
        "fsize": (resource.RLIMIT_FSIZE, _MOST_OUTPUT_BYTES),
    }
    options = []
    for name, (number, most) in limits.items():
        _, allowed = resource.getrlimit(number)
        options.append(f"--{name}={most if allowed == resource.RLIM_INFINITY else min(most, allowed)}")
    return ("prlimit", *options, "setpriv", "--pdeathsig", "KILL", "--")


def _reason(answer: subprocess.CompletedProcess[str]) -> str:
    """Why netconvert failed, in one line that a terminal can show."""
    if line := _ERROR_LINE.search(answer.stderr) or _ERROR_LINE.search(answer.stdout):
        lacks_memory = "bad_alloc" in line.group(1)
        memory = f"more than {MOST_MEMORY_BYTES // 2**30} GB of memory are needed"
        return memory if lacks_memory else shown_words(line.group(1).strip())
    code = answer.returncode
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def without_header(net_xml: bytes) -> bytes:
    """The net without comments before its root element: netconvert's carry the date and the paths."""
    prologue = _PROLOGUE.match(net_xml)
    if prologue is None:
        return net_xml
    declaration = prologue.group(1)
    return (declaration + b"\n" if declaration else b"") + net_xml[prologue.end() :]


def normal_edges(net: Element) -> Iterator[Element]:
    """The edges of a net outside junctions."""
    return (edge for edge in net.iterfind("edge") if edge.get("function", "normal") == "normal")


def document(root: Element | str, elements: Iterable[Element] = ()) -> bytes:
    """A net as bytes, or one of netconvert's plain XML files with elements, by its root's name (``nodes``)."""
    if isinstance(root, Element):
        return bytes(tostring(root, encoding="utf-8", xml_declaration=True))
    plain = Element(root)
    plain.extend(elements)
    return bytes(tostring(plain, encoding="utf-8"))


def control_patches(
    net: Element, stopping: Collection[str], yielding: Collection[str], is_driven_on: Callable[[Element], bool]
) -> tuple[list[Element], Mapping[str, int]]:
    """Node patches and edge priorities for signs.

    A junction is an all-way stop where all of its approaches have a stop sign, and a priority stop where some have.
    Signed approaches get less priority than the others. Junctions with signals stay as they are. ``stopping`` and
    ``yielding`` are the ids of the edges that end at such a sign; ``is_driven_on`` says whether an edge is an approach.

    Returns:
        ``node`` elements, and the new priority of each signed edge by id.
    """
    approaches: dict[str, dict[str, int]] = {}
    for edge in filter(is_driven_on, normal_edges(net)):
        approaches.setdefault(edge.attrib["to"], {})[edge.attrib["id"]] = int(edge.get("priority", "1"))
    for junction in net.iterfind("junction"):
        if junction.get("type", "").startswith("traffic_light"):
            approaches.pop(junction.attrib["id"], None)
    nodes: list[Element] = []
    priorities: dict[str, int] = {}
    for junction_id, edges in approaches.items():
        stops = [edge for edge in edges if edge in stopping]
        if stops:
            kind = "allway_stop" if len(stops) == len(edges) else "priority_stop"
            nodes.append(Element("node", id=junction_id, type=kind))
        signed = {edge for edge in edges if edge in stopping or edge in yielding}
        others = [priority for edge, priority in edges.items() if edge not in signed]
        priorities |= {edge: min([priority, *others]) - 1 for edge, priority in edges.items() if edge in signed}
    return nodes, priorities
