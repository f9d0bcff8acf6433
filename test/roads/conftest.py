import pytest
from repository import SHARED

from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.net_parser import parse_road_network

TOWN10 = SHARED / "maps" / "Town10HD_Opt.xodr"


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    """A cache of compiled maps."""
    return tmp_path_factory.mktemp("maps")


@pytest.fixture(scope="session")
def town(cache):
    return parse_road_network(compile_map(None, cache).read_bytes())


@pytest.fixture(scope="session")
def town10(cache):
    if not TOWN10.exists():
        pytest.skip(f"the OpenDRIVE map {TOWN10.name} is not beside this checkout")
    return parse_road_network(compile_map(TOWN10, cache).read_bytes())
