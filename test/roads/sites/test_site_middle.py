import numpy as np
import pytest
from hand_made_record import crossing

from siren_ros.roads.road_network import LaneKind
from siren_ros.roads.sites.site_middle import middle_of_site


def test_the_middle_of_a_junction_is_that_of_its_outline() -> None:
    network = crossing()
    middle = middle_of_site(network, {"junction": "J"})
    assert middle is not None
    assert middle == pytest.approx([network.junctions["J"].x_m, network.junctions["J"].y_m], abs=5.0)


def test_the_middle_of_a_road_is_half_way_along_it() -> None:
    network = crossing()
    lane = next(lane for lane in network.lanes if lane.kind is LaneKind.DRIVING)
    edge = network.edges[lane.edge]
    lanes = [network.lanes[index] for index in edge.lanes if network.lanes[index].kind is not LaneKind.SIDEWALK]
    middle = middle_of_site(network, {"stretch": [edge.edge_id]})
    assert middle == pytest.approx(np.mean([one.centre.at(0.5 * one.length_m) for one in lanes], axis=0), abs=0.01)


def test_a_site_without_junction_and_road_has_no_middle() -> None:
    assert middle_of_site(crossing(), {}) is None
    assert middle_of_site(crossing(), {"stretch": ["nowhere"]}) is None
