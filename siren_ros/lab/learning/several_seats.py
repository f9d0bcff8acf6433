"""The environment for PettingZoo's parallel API: several drivers in one episode."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from siren_ros.errors import InputError
from siren_ros.lab.learning.environment import BaseEnv, SeatResult
from siren_ros.lab.learning.options import EnvOptions
from siren_ros.lab.learning.rollout import Seat
from siren_ros.lab.learning.top_view import TopView
from siren_ros.running.generation.closed_loop import RecordedEpisode

Results = dict[Seat, SeatResult]


class SeveralSeatsEnv(ParallelEnv[str, npt.NDArray[Any], Any]):
    """Drivers of ``emv`` and ``civilian``. The episode of each ends separately; seeds as in ``SeatEnv``."""

    metadata: ClassVar[dict[str, Any]] = {
        "name": "siren_v0",
        "render_modes": ["rgb_array"],
        "is_parallelizable": True,
    }

    def __init__(
        self,
        *,
        drivers: Sequence[str] = (Seat.EMV, Seat.CIVILIAN),
        render_mode: str | None = None,
        record_to: str | Path | None = None,
        **options: Any,
    ) -> None:
        """Check the options.

        Args:
            drivers: The seats with a driver.
            render_mode: ``rgb_array`` or None.
            record_to: Folder to which the bag of every episode that ends is written.
            options: Those of ``siren_ros.lab.learning.options.EnvOptions``.

        Raises:
            InputError: An option cannot be used.
        """
        if not drivers or len(set(drivers)) < len(drivers) or not set(drivers) <= {*Seat}:
            raise InputError("drivers", ", ".join(drivers), f"some of {', '.join(Seat)}, each once")
        if render_mode not in {None, *self.metadata["render_modes"]}:
            raise InputError("render_mode", render_mode, "rgb_array or None")
        self.render_mode = render_mode
        chosen = EnvOptions.of(options)
        self._env = BaseEnv(chosen, [Seat(seat) for seat in drivers], None if record_to is None else Path(record_to))
        self.possible_agents = [str(seat) for seat in drivers]
        self.agents: list[str] = []
        self.observation_spaces = {seat: chosen.observation_space() for seat in self.possible_agents}
        self.action_spaces = {seat: chosen.action_space() for seat in self.possible_agents}
        self._random, _ = seeding.np_random(None)
        self._view: TopView | None = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Space of a driver's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Space of a driver's actions."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, npt.NDArray[Any]], dict[str, dict[str, Any]]]:
        """Begin an episode; ``options`` as in ``SeatEnv.reset``.

        Raises:
            InputError: An option or the request cannot be used.
            EpisodeError: SUMO failed before the first step.
        """
        if seed is not None:
            self._random, _ = seeding.np_random(seed)
        results = self._env.reset(seed, self._random, options)
        self.agents, self._view = list(self.possible_agents), None
        return (
            {str(seat): result.observation for seat, result in results.items()},
            {str(seat): result.info for seat, result in results.items()},
        )

    def step(self, actions: dict[str, Any]) -> tuple[dict[str, Any], ...]:
        """Simulate ``decision_s``; drivers whose episode ends leave ``agents``.

        Raises:
            InputError: A driver has no action, or one that is not of the action space; nothing has changed then.
            EpisodeError: All episodes have ended, or none has begun.
        """
        if strangers := sorted(set(actions) - set(self.possible_agents)):
            raise InputError("actions", ", ".join(strangers), f"an action of each driver: {', '.join(self.agents)}")
        results = self._env.step({Seat(seat): action for seat, action in actions.items()})
        self.agents = [str(seat) for seat, result in results.items() if not (result.terminated or result.truncated)]
        parts = ("observation", "reward", "terminated", "truncated", "info")
        return tuple({str(seat): getattr(result, part) for seat, result in results.items()} for part in parts)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Picture from above around the first seat, shape ``(400, 640, 3)``; None without ``rgb_array``."""
        rollout = self._env.rollout
        if self.render_mode is None or rollout is None:
            return None
        if self._view is None:
            self._view = TopView(rollout.setup.network)
        return self._view.draw(rollout.steps[-1], rollout.actors, self._env.state.sight.body.actor_id)

    def save(self, bag: str | Path) -> RecordedEpisode:
        """Write the bag of the current episode, as ``SeatEnv.save``."""
        return self._env.save(Path(bag))

    def close(self) -> None:
        """End SUMO."""
        self._env.close()
