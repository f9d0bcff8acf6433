"""A driver that ignores sirens: it keeps its lane, its distance, and obeys signals."""

from dataclasses import dataclass

from siren_ros.running.seat.sight import Sight
from siren_ros.running.seat.speeds import indicators, speed_to_junction, speed_to_leader, speed_to_limit, speed_to_red
from siren_ros.running.seat.steering import steered
from siren_ros.simulation.world.commands import AvControl


@dataclass(frozen=True)
class LaneKeeper:
    """Follows its leader with the equilibrium of the Intelligent Driver Model (Treiber, Hennecke, Helbing 2000)."""

    @property
    def start(self) -> None:
        """Return an empty state: it remembers nothing."""
        return

    def step(self, state: None, sight: Sight) -> tuple[None, AvControl]:
        """Decide a step."""
        wanted = min(speed_to_limit(sight), speed_to_leader(sight, 0.0), speed_to_red(sight), speed_to_junction(sight))
        return state, steered(sight, wanted, 0.0, indicators(sight))
