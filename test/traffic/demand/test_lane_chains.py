"""Lanes one after the other, addressed by one distance."""

import pytest
from made_streets import A_LEFT, A_RIGHT, B_LEFT, B_RIGHT, C_LEFT, SOUTH, A, B, C, D, streets

from siren_ros.traffic.demand.lane_chains import LaneChain, chain_along, connection_onward
from siren_ros.traffic.demand.plan import LaneInterval

NETWORK = streets()
OVER_K_RIGHT, OVER_K_LEFT, OVER_J_RIGHT, OVER_J_LEFT, INTO_SOUTH = range(9, 14)


def along(lane: int, *edges: int) -> LaneChain:
    return chain_along(NETWORK, NETWORK.lanes[lane], edges)


def test_lanes_and_paths_with_their_starts() -> None:
    chain = along(A_LEFT, A, B, C)
    assert chain.lanes == (A_LEFT, OVER_K_LEFT, B_LEFT, OVER_J_LEFT, C_LEFT)
    assert chain.start_m == pytest.approx((0.0, 200.0, 210.0, 310.0, 330.0))
    assert chain.end_m == pytest.approx(530.0)


def test_where_a_lane_does_not_lead_on_the_nearest_one_does() -> None:
    """Only the right lane leads to the south."""
    chain = along(A_LEFT, A, B, D)
    assert chain.lanes == (A_LEFT, OVER_K_LEFT, B_LEFT, INTO_SOUTH, SOUTH)
    assert connection_onward(NETWORK, NETWORK.lanes[B_LEFT], D) == NETWORK.connections[4]
    assert connection_onward(NETWORK, NETWORK.lanes[B_RIGHT], C) == NETWORK.connections[2]
    assert connection_onward(NETWORK, NETWORK.lanes[A_RIGHT], C) is None


def test_a_route_that_nobody_can_drive_ends_the_chain() -> None:
    chain = along(A_LEFT, A, C)
    assert (chain.lanes, chain.end_m) == ((A_LEFT,), pytest.approx(200.0))
    assert along(A_RIGHT, A).lanes == (A_RIGHT,)


def test_places_are_on_roads_and_not_in_junctions() -> None:
    chain = along(A_LEFT, A, B, C)
    assert chain.place(NETWORK, 0.0) == (A_LEFT, 0.0)
    assert chain.place(NETWORK, 199.0) == (A_LEFT, pytest.approx(199.0))
    assert chain.place(NETWORK, 205.0) is None
    assert chain.place(NETWORK, 210.0) == (B_LEFT, pytest.approx(0.0))
    assert chain.place(NETWORK, 309.0) == (B_LEFT, pytest.approx(99.0))
    assert chain.place(NETWORK, 320.0) is None
    assert chain.place(NETWORK, 529.9) == (C_LEFT, pytest.approx(199.9))
    assert chain.place(NETWORK, 530.0) is None
    assert chain.place(NETWORK, -0.1) is None


def test_stretches_between_two_distances() -> None:
    chain = along(A_LEFT, A, B, C)
    assert chain.intervals(NETWORK, 190.0, 230.0) == (
        LaneInterval(A_LEFT, pytest.approx(190.0), pytest.approx(200.0)),
        LaneInterval(OVER_K_LEFT, 0.0, pytest.approx(10.0)),
        LaneInterval(B_LEFT, 0.0, pytest.approx(20.0)),
    )
    assert chain.intervals(NETWORK, 220.0, 240.0) == (LaneInterval(B_LEFT, pytest.approx(10.0), pytest.approx(30.0)),)
    assert chain.intervals(NETWORK, -30.0, 20.0) == (LaneInterval(A_LEFT, 0.0, pytest.approx(20.0)),)
    assert chain.intervals(NETWORK, 530.0, 600.0) == ()
    assert chain.intervals(NETWORK, 50.0, 50.0) == ()
