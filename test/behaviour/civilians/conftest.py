"""The road and the level that most tests of civilians share."""

import pytest


@pytest.fixture
def world(lab):
    """A straight road at L3."""
    return lab.world_of(lab.straight_road(), lab.L3)
