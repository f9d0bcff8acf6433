"""Stop lines crossed and junctions left, from the lanes of one step and the next."""

from collections.abc import Mapping
from dataclasses import dataclass

from siren_ros.roads.road_network import Connection, Lane, LaneKind, RoadNetwork
from siren_ros.world.events import Event, EventKind


@dataclass(frozen=True)
class Mover:
    """A vehicle's front bumper at one step."""

    actor_id: int
    lane: int
    x_m: float
    y_m: float
    speed_mps: float


class CrossingWatch:
    """Remembers each vehicle's last lane and tells when it enters or leaves a controlled junction."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._last_lane: dict[int, Lane] = {}
        self._inside: dict[int, str] = {}

    def forget(self, actor_id: int) -> None:
        """Drop a vehicle that has left."""
        self._last_lane.pop(actor_id, None)
        self._inside.pop(actor_id, None)

    def is_on(self, actor_id: int, lane: int) -> bool:
        """Whether a vehicle was on this lane at the last call of ``watch``, so that nothing has happened."""
        last = self._last_lane.get(actor_id)
        return last is not None and last.index == lane

    def watch(self, step: int, mover: Mover, signals: Mapping[str, str]) -> tuple[Event, ...]:
        """Events of a vehicle whose lane has changed since the last call.

        Args:
            step: Present step.
            mover: The vehicle; its lane is on the road.
            signals: State strings of all signals by id.
        """
        lane = self._network.lanes[mover.lane]
        last = self._last_lane.get(mover.actor_id)
        self._last_lane[mover.actor_id] = lane
        if last is None or last.edge == lane.edge:
            return ()
        found = []
        if mover.actor_id in self._inside and lane.kind is not LaneKind.INTERNAL:
            detail: dict[str, float | int | str] = {"junction": self._inside.pop(mover.actor_id)}
            found.append(
                Event(step, EventKind.JUNCTION_LEFT, mover.actor_id, x_m=mover.x_m, y_m=mover.y_m, detail=detail)
            )
        connection = self._connection(last, lane) if last.kind is not LaneKind.INTERNAL else None
        if connection is not None and (connection.signal_id is not None or connection.must_stop):
            detail = _detail(connection, mover.speed_mps, signals)
            found.append(
                Event(step, EventKind.STOP_LINE_CROSSED, mover.actor_id, x_m=mover.x_m, y_m=mover.y_m, detail=detail)
            )
            if lane.kind is LaneKind.INTERNAL:
                self._inside[mover.actor_id] = connection.junction
        return tuple(found)

    def _connection(self, last: Lane, lane: Lane) -> Connection | None:
        """The movement between two lanes; a vehicle that changes lanes there may come from a neighbour lane."""
        siblings = [last.index, *(index for index in self._network.edges[last.edge].lanes if index != last.index)]
        for source in siblings:
            for connection in self._network.connections_from.get(source, ()):
                if lane.index in connection.via or connection.to_lane == lane.index:
                    return connection
        return None


def _detail(connection: Connection, speed_mps: float, signals: Mapping[str, str]) -> dict[str, float | int | str]:
    state = signals.get(connection.signal_id or "", "")
    return {
        "junction": connection.junction,
        "direction": connection.direction,
        "signal_state": state[connection.signal_link] if 0 <= connection.signal_link < len(state) else "",
        "must_stop": int(connection.must_stop),
        "speed_mps": speed_mps,
    }
