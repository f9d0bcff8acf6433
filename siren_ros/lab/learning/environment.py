"""The Gymnasium environments: one for a civilian's driver, one for an emergency vehicle's."""

from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import numpy.typing as npt

from siren_ros.errors import InputError
from siren_ros.lab.learning.base_env import BaseEnv, SeatResult
from siren_ros.lab.learning.options import EnvOptions
from siren_ros.lab.learning.rollout import Rollout, Seat
from siren_ros.lab.learning.seat_state import SeatState
from siren_ros.lab.learning.top_view import TopView, Window
from siren_ros.running.generation.recorded_episode import RecordedEpisode


class SeatEnv(gymnasium.Env[npt.NDArray[Any], Any]):
    """A driver in one seat of SIREN's episodes, without ROS.

    ``reset(seed=7)`` begins the episode with seed 7. Without a seed it draws one from ``seeds``; those that it draws
    follow from the last one that was given. The episode is *terminated* by a contact, off the road, at the end of the
    way, and where the simulation fails; it is *truncated* when its time is over. ``info`` has ``seed``, ``time_s``,
    ``actor_id`` and the amounts of the reward's ``terms``; at the end also ``ended``, the reason, and ``clauses``, the
    grades of the rulebook.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array", "human"], "render_fps": 5}  # type: ignore[misc]
    seat: ClassVar[Seat]

    def __init__(self, *, render_mode: str | None = None, record_to: str | Path | None = None, **options: Any) -> None:
        """Checks the options.

        Args:
            render_mode: ``rgb_array``, ``human`` or None.
            record_to: Folder to which the bag of every episode that ends is written.
            options: Those of ``siren_ros.lab.learning.options.EnvOptions``.

        Raises:
            InputError: An option cannot be used.
        """
        if render_mode not in {None, *self.metadata["render_modes"]}:
            raise InputError("render_mode", render_mode, "rgb_array, human or None")
        self.render_mode = render_mode
        chosen = EnvOptions.of(options)
        self._env = BaseEnv(chosen, [self.seat], None if record_to is None else Path(record_to))
        self.metadata = {**type(self).metadata, "render_fps": max(1, round(1.0 / chosen.decision_s))}  # type: ignore[misc]
        self.observation_space = chosen.observation_space()
        self.action_space = chosen.action_space()
        self._view: TopView | None = None
        self._window: Window | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[Any], dict[str, Any]]:
        """Begin an episode, as described for the class.

        Args:
            seed: Seed of the episode.
            options: Options of the environment in place of its own, for this episode alone: all but ``observation``
                and ``action``, on which the spaces depend.

        Raises:
            InputError: An option or the request cannot be used.
            EpisodeError: SUMO failed before the first step.
        """
        super().reset(seed=seed)
        result = self._env.reset(seed, self.np_random, options)[self.seat]
        self._view = None
        self._show()
        return result.observation, result.info

    def step(self, action: Any) -> tuple[npt.NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Simulate ``decision_s`` with an action.

        Raises:
            InputError: The action is not one of the action space; nothing has changed then.
            EpisodeError: The episode has ended, or none has begun.
        """
        result: SeatResult = self._env.step({self.seat: action})[self.seat]
        self._show()
        return result.observation, result.reward, result.terminated, result.truncated, result.info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Picture from above, shape ``(400, 640, 3)``, for ``rgb_array``; for ``human`` the window shows it."""
        if self.render_mode == "rgb_array":
            return self._picture()
        self._show()
        return None

    def save(self, bag: str | Path) -> RecordedEpisode:
        """Write the bag of the current episode up to its current step; ``siren replay --check`` can repeat it.

        Raises:
            InputError: The bag exists already or cannot be written.
            EpisodeError: No episode has begun, or the disk is full.
        """
        return self._env.save(Path(bag))

    @property
    def rollout(self) -> Rollout:
        """The current episode with all its steps.

        Raises:
            EpisodeError: No episode has begun.
        """
        return self._env.present

    @property
    def moment(self) -> SeatState:
        """The current step from the driver's view, for drivers that are not networks."""
        return self._env.state

    def close(self) -> None:
        """End SUMO and close the window."""
        self._env.close()
        if self._window is not None:
            self._window.close()
            self._window = None

    def _picture(self) -> npt.NDArray[np.uint8]:
        rollout = self.rollout
        self._view = self._view or TopView(rollout.setup.network)
        return self._view.draw(rollout.steps[-1], rollout.actors, self.moment.sight.body.actor_id)

    def _show(self) -> None:
        if self.render_mode == "human":
            self._window = self._window or Window("SIREN")
            self._window.show(self._picture(), self.metadata["render_fps"])


class YieldEnv(SeatEnv):
    """``siren/Yield-v0``: drives the civilian that the EMV must pass."""

    seat = Seat.CIVILIAN


class EmergencyEnv(SeatEnv):
    """``siren/Emergency-v0``: drives the first emergency vehicle."""

    seat = Seat.EMV
