"""The state of a seat at a step: the basis of observations and rewards."""

from dataclasses import dataclass

from siren_ros.lab.learning.rollout import Rollout, Seat
from siren_ros.running.seat.sight import Sight, sight_of
from siren_ros.running.seat.way import Way
from siren_ros.simulation.traffic.demand.demand import av_way, way_of
from siren_ros.simulation.world.traffic_state import EventKind


@dataclass(frozen=True)
class SeatState:
    """What a driver sees at a step, and what has happened since the step before; left-hand traffic is mirrored."""

    sight: Sight
    before: Sight
    """The view one step before; at the first step the same view."""
    emv_id: int
    """Id of the first emergency vehicle."""
    emv_wanted_mps: float
    """Speed of the emergency vehicle if no other vehicle were in its way."""
    contact: bool
    """Whether the own vehicle touched another actor at this step."""
    red_lines: int
    """Number of red stop lines that the own front crossed at this step."""

    @property
    def emv_row(self) -> int | None:
        """Row of the first emergency vehicle; None if it is not on the map."""
        return self.sight.states.row_of(self.emv_id)


class SeatView:
    """The view of one driver on a rollout, step by step."""

    def __init__(self, rollout: Rollout, seat: Seat) -> None:
        """Find the path of the seat's vehicle.

        Raises:
            InputError: The episode has nobody in the seat, or its route cannot be driven from its first lane.
        """
        setup, network = rollout.setup, rollout.network
        curve = av_way(network, setup.plan) if seat is Seat.CIVILIAN else way_of(network, setup.plan.emvs[0])
        self.actor_id = rollout.actor_of(seat)
        self.way = Way.of(network, curve)
        self._rollout = rollout
        self._emv_id = rollout.actor_of(Seat.EMV)
        self._emv_wanted_mps = float(setup.description.template_values["emv.speed_mps"])
        self._last: SeatState | None = None

    def look(self) -> SeatState | None:
        """State at the rollout's current step; None if the vehicle has left the map."""
        step, states = self._rollout.steps[-1], self._rollout.states
        if states.row_of(self.actor_id) is None:
            return None
        at_m = 0.0 if self._last is None else self._last.sight.s_m
        sight = sight_of(states, step.traffic.signals, self._rollout.actors, self.actor_id, self.way, at_m)
        before = sight if self._last is None else self._last.sight
        touched = any(
            event.kind is EventKind.COLLISION and self.actor_id in {event.actor_id, event.other_id}
            for event in step.events
        )
        colours = {signal.signal_id: signal.state for signal in step.traffic.signals}
        crossed = [
            line.connection
            for line in self.way.lines
            if before.s_m < line.at_m - 0.5 * sight.length_m <= sight.s_m
            and line.connection.letter_in(colours.get(line.connection.signal_id or "", "")) in {"r", "R"}
        ]
        self._last = SeatState(sight, before, self._emv_id, self._emv_wanted_mps, touched, len(crossed))
        return self._last
