"""Road networks of maps, compiled and read once in a process, for tests of every folder."""

from functools import cache
from pathlib import Path

from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork


@cache
def network_of_map(source: Path | None = None) -> RoadNetwork:
    """The network of a file or of a built-in map by its name; of the town where none is given."""
    return parse_road_network(compile_map(source).read_bytes())
