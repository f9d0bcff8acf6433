import pytest
from traffic_helpers import load_map

from siren_ros.roads.road_network import Connection, LaneKind
from siren_ros.traffic.observation.crossings import CrossingWatch, Mover
from siren_ros.world.events import EventKind

NETWORK = load_map(None)[1]


def movement(*, signal: bool) -> Connection:
    return next(
        connection
        for connection in NETWORK.connections
        if connection.via
        and NETWORK.lanes[connection.from_lane].kind is LaneKind.DRIVING
        and (connection.signal_id is not None if signal else connection.must_stop)
    )


def mover(lane: int) -> Mover:
    return Mover(actor_id=7, lane=lane, x_m=1.0, y_m=2.0, speed_mps=9.0)


@pytest.mark.parametrize("letter", ["r", "G"])
def test_crossing_at_a_signal_tells_its_state_and_leaving_the_junction(letter: str) -> None:
    connection = movement(signal=True)
    state = {str(connection.signal_id): "y" * connection.signal_link + letter + "y" * 40}
    watch = CrossingWatch(NETWORK)
    assert watch.watch(0, mover(connection.from_lane), state) == ()
    (crossed,) = watch.watch(1, mover(connection.via[0]), state)
    assert crossed.kind is EventKind.STOP_LINE_CROSSED
    assert crossed.detail["signal_state"] == letter
    assert crossed.detail["junction"] == connection.junction
    assert crossed.detail["speed_mps"] == 9.0
    assert watch.watch(2, mover(connection.via[0]), state) == ()
    (left,) = watch.watch(3, mover(connection.to_lane), state)
    assert left.kind is EventKind.JUNCTION_LEFT
    assert left.detail["junction"] == connection.junction
    assert watch.watch(4, mover(connection.to_lane), state) == ()


def test_crossing_a_stop_line_has_no_signal_state() -> None:
    connection = movement(signal=False)
    watch = CrossingWatch(NETWORK)
    watch.watch(0, mover(connection.from_lane), {})
    (crossed,) = watch.watch(1, mover(connection.via[0]), {})
    assert crossed.detail["must_stop"] == 1
    assert crossed.detail["signal_state"] == ""


def test_path_across_that_is_missed_between_two_steps_still_counts() -> None:
    connection = movement(signal=True)
    watch = CrossingWatch(NETWORK)
    watch.watch(0, mover(connection.from_lane), {})
    (crossed,) = watch.watch(1, mover(connection.to_lane), {})
    assert crossed.kind is EventKind.STOP_LINE_CROSSED


def test_vehicle_first_seen_inside_a_junction_crosses_nothing() -> None:
    connection = movement(signal=True)
    watch = CrossingWatch(NETWORK)
    assert watch.watch(0, mover(connection.via[0]), {}) == ()
    watch.forget(7)
    assert watch.watch(1, mover(connection.to_lane), {}) == ()
