"""Compiles a map in a process of its own whose memory is bounded, as a user gives it: with netconvert."""

import resource
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network

MEMORY_BYTES = 3 * 2**30
Compilation = Callable[[str, bytes], str]


def refusal(name, data):
    """What is said of a map; empty where it becomes a network. Any other exception or warning is a mistake of ours."""
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        source = Path(folder) / name
        source.write_bytes(data)
        try:
            parse_road_network(compile_map(source, Path(folder) / "cache").read_bytes())
        except MapError as error:
            return str(error).replace(str(source), name)
    return ""


def bound_memory():
    """Of this process; netconvert's is bounded by the library."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, resource.RLIM_INFINITY))


@contextmanager
def bounded_compilation():
    """``refusal``, in that process."""
    with ProcessPoolExecutor(1, get_context("spawn"), bound_memory) as pool:
        yield lambda name, data: pool.submit(refusal, name, data).result()
