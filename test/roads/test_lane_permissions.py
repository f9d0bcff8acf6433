import pytest

from siren_ros.roads.lane_permissions import kind_of_lane, permissions_of
from siren_ros.roads.road_network import LaneKind


@pytest.mark.parametrize(
    ("allow", "disallow", "civilian", "emergency", "pedestrian"),
    [
        (None, None, True, True, True),
        ("all", None, True, True, True),
        (None, "all", False, False, False),
        ("emergency", None, False, True, False),
        ("pedestrian", "pedestrian", False, False, True),
        (None, "passenger", False, True, True),
    ],
)
def test_permissions(allow, disallow, civilian, emergency, pedestrian):
    permissions = permissions_of(allow, disallow)
    assert (permissions.civilian, permissions.emergency, permissions.pedestrian) == (civilian, emergency, pedestrian)


@pytest.mark.parametrize(
    ("allow", "lane_type", "kind"),
    [
        ("bus", "", LaneKind.DRIVING),
        ("emergency authority", "", LaneKind.SHOULDER),
        ("bicycle", "", LaneKind.KERB),
        ("bicycle pedestrian", "", LaneKind.SIDEWALK),
        (None, "sidewalk", LaneKind.SIDEWALK),
        ("tram", "", LaneKind.KERB),
    ],
)
def test_kind(allow, lane_type, kind):
    assert kind_of_lane(permissions_of(allow, None), lane_type) is kind
