import pytest
from made_legs import network_of_legs, scene_of_legs


@pytest.fixture(scope="session")
def network():
    return network_of_legs()


@pytest.fixture(scope="session")
def scene():
    return scene_of_legs()
