import pytest
from behaviour import lab as shared


@pytest.fixture
def lab():
    """The scenes that tests of the behaviour share."""
    return shared


@pytest.fixture
def world(lab):
    """A straight road at L3."""
    return lab.world_of(lab.straight_road(), lab.L3)


@pytest.fixture
def straight(lab):
    """Two lanes of 400 m."""
    return lab.straight_road()


@pytest.fixture
def junction(lab):
    return lab.junction_road()
