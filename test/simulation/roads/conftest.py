import pytest
from made_district import write_district

from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    """A cache of compiled maps."""
    return tmp_path_factory.mktemp("maps")


@pytest.fixture(scope="session")
def town(cache):
    return parse_road_network(compile_map(None, cache).read_bytes())


@pytest.fixture(scope="session")
def district(cache):
    return parse_road_network(compile_map(write_district(cache), cache).read_bytes())
