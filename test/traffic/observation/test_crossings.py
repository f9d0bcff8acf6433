from dataclasses import replace

import pytest
from made_streets import A_LEFT, B_LEFT, B_RIGHT, C_LEFT, C_RIGHT, STRAIGHT, STRAIGHT_LEFT, streets
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


def test_a_lane_change_at_the_line_does_not_hide_the_crossing() -> None:
    """From one step to the next a vehicle leaves its lane and enters the path that begins at the lane next to it."""
    state = dict.fromkeys({str(one.signal_id) for one in NETWORK.connections}, "G" * 60)
    tried = 0
    for connection in NETWORK.connections:
        if connection.signal_id is None or not connection.via:
            continue
        for source in NETWORK.edges[NETWORK.lanes[connection.from_lane].edge].lanes:
            movements = NETWORK.connections_from.get(source, ())
            own = any(connection.via[0] in one.via or connection.to_lane == one.to_lane for one in movements)
            if source == connection.from_lane or own:
                continue
            watch = CrossingWatch(NETWORK)
            watch.watch(0, mover(source), state)
            (crossed,) = watch.watch(1, mover(connection.via[0]), state)
            assert crossed.kind is EventKind.STOP_LINE_CROSSED
            assert (crossed.detail["junction"], crossed.detail["signal_state"]) == (connection.junction, "G")
            (left,) = watch.watch(2, mover(connection.to_lane), state)
            assert left.kind is EventKind.JUNCTION_LEFT
            tried += 1
    assert tried > 5


def test_the_letter_is_the_one_of_the_movement_that_was_taken() -> None:
    """Where two movements leave a lane, each has its own link."""
    for lane, movements in NETWORK.connections_from.items():
        links = {one.signal_link for one in movements}
        if len(links) < 2 or any(one.signal_id is None or not one.via for one in movements):
            continue
        for connection in movements:
            letters = "".join("r" if link == connection.signal_link else "G" for link in range(60))
            watch = CrossingWatch(NETWORK)
            watch.watch(0, mover(lane), {})
            (crossed,) = watch.watch(1, mover(connection.via[0]), {str(connection.signal_id): letters})
            assert (crossed.detail["signal_state"], crossed.detail["direction"]) == ("r", connection.direction)
        return
    pytest.fail("no lane with two movements")


def test_a_lane_change_on_the_road_crosses_nothing() -> None:
    edge = next(edge for edge in NETWORK.edges if len(edge.lanes) > 1 and not edge.internal)
    watch = CrossingWatch(NETWORK)
    watch.watch(0, mover(edge.lanes[0]), {})
    assert watch.watch(1, mover(edge.lanes[1]), {}) == ()


@pytest.mark.parametrize(("lane", "letter"), [(B_RIGHT, "r"), (B_LEFT, "G")])
def test_where_two_lanes_lead_into_one_the_letter_is_that_of_the_own_lane(lane: int, letter: str) -> None:
    """Also where the path across was missed between two steps."""
    roads = streets()
    connections = list(roads.connections)
    connections[STRAIGHT_LEFT] = replace(connections[STRAIGHT_LEFT], to_lane=C_RIGHT)
    network = replace(roads, connections=tuple(connections))
    letters = "".join("G" if link == connections[STRAIGHT_LEFT].signal_link else "r" for link in range(8))
    assert connections[STRAIGHT].to_lane == C_RIGHT
    watch = CrossingWatch(network)
    watch.watch(0, mover(lane), {})
    (crossed,) = watch.watch(1, mover(C_RIGHT), {"J": letters})
    assert crossed.detail["signal_state"] == letter


def test_who_left_inside_a_junction_has_not_been_in_it_when_the_number_comes_again() -> None:
    connection = movement(signal=True)
    watch = CrossingWatch(NETWORK)
    watch.watch(0, mover(connection.from_lane), {})
    watch.watch(1, mover(connection.via[0]), {})
    watch.forget(7)
    assert watch.watch(2, mover(connection.via[0]), {}) == ()
    assert watch.watch(3, mover(connection.to_lane), {}) == ()
    watch.watch(4, mover(connection.from_lane), {})
    watch.forget(7)
    assert watch.watch(5, mover(connection.via[0]), {}) == ()


def test_a_junction_is_left_once() -> None:
    roads = streets()
    watch = CrossingWatch(roads)
    lanes = (B_LEFT, roads.connections[STRAIGHT_LEFT].via[0], C_LEFT, A_LEFT)
    kinds = [event.kind for step, lane in enumerate(lanes) for event in watch.watch(step, mover(lane), {})]
    assert kinds.count(EventKind.JUNCTION_LEFT) == 1
