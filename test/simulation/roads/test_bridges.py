import numpy as np
import pytest

from siren_ros.simulation.roads.bridges import bridges
from siren_ros.simulation.roads.net_parser import parse_road_network


def net(*shapes: str, function: str = "normal") -> bytes:
    lanes = (
        f'<edge id="{number}" function="{function if number else "normal"}" from="a{number}" to="b{number}">'
        f'<lane id="{number}_0" index="0" speed="10" shape="{shape}"/></edge>'
        for number, shape in enumerate(shapes)
    )
    return f"<net>{''.join(lanes)}</net>".encode()


@pytest.mark.parametrize(
    ("other", "places"),
    [("30,-50 30,50", [(30.0, 0.0)]), ("100,0 100,50", []), ("0,5 100,5", []), ("20,-10 40,10", [(30.0, 0.0)])],
)
def test_a_bridge_is_where_two_roads_cross(other: str, places: list[tuple[float, float]]) -> None:
    found = bridges(parse_road_network(net("0,0 100,0", other)))
    np.testing.assert_allclose(found, np.reshape(places, (-1, 2)), atol=1e-9)


def test_paths_across_junctions_are_no_bridges() -> None:
    assert len(bridges(parse_road_network(net("0,0 100,0", "30,-50 30,50", function="internal")))) == 0
