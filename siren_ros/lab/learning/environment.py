"""The Gymnasium environments, one for a civilian's driver, one for an emergency vehicle's, and the basis of all.

The basis runs episodes with drivers, decision by decision.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final

import gymnasium
import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.bag_folder import default_bag_path_of
from siren_ros.errors import EpisodeError, InputError
from siren_ros.lab.learning.options import OFF_ROAD_M, TERMS, Action, EnvOptions, Observation, terms_of, weights_of
from siren_ros.lab.learning.rollout import Rollout, Seat, SeatState, SeatView
from siren_ros.lab.learning.snapshot import Snapshot, drop_snapshot, take_snapshot
from siren_ros.lab.learning.top_view import RasterView, TopView, Window
from siren_ros.reports.exam.grading import examine, load_rulebook
from siren_ros.running.generation.closed_loop import RecordedEpisode, record_of
from siren_ros.running.seat.policy import Aim, Manoeuvre, aim_of, by_manoeuvre, by_pedals, features_of
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.commands import AvControl

_TRIES: Final = 20
"""Number of seeds that are tried for an episode: some seeds have no place for some templates."""
_END_M: Final = 8.0
"""A vehicle this near to the end of its path has reached it."""


@dataclass
class SeatResult:
    """Result of a decision for one driver."""

    observation: npt.NDArray[Any]
    reward: float = 0.0
    terminated: bool = False
    truncated: bool = False
    info: dict[str, Any] = field(default_factory=dict)


class _Driver:
    """One driver in an episode."""

    def __init__(self, options: EnvOptions, rollout: Rollout, seat: Seat) -> None:
        self.seat, self.view, self._options = seat, SeatView(rollout, seat), options
        self.weights = weights_of(seat, options.rewards)
        self.aim = Aim()
        self._raster = RasterView(rollout.network) if options.observation == Observation.RASTER else None
        self._vehicles = load_vehicle_parameters(rollout.setup.description.files)
        state = self.view.look()
        if state is None:
            raise EpisodeError(f"nobody is in the seat {seat} at the first step")
        self.state: SeatState = state
        self.ended = ""
        """Why the driver's episode has ended; empty before."""

    def decide(self, action: Any) -> None:
        """Take an action: a manoeuvre sets an aim, pedals stay for the following steps."""
        self._action = action
        if self._options.action == Action.MANOEUVRE:
            self.aim = aim_of(self.aim, Manoeuvre(int(np.asarray(action).item())), self.state.sight)

    def control(self) -> AvControl:
        """Control of the vehicle at the current step."""
        sight = self.state.sight
        if self._options.action == Action.MANOEUVRE:
            return by_manoeuvre(self.aim, sight, self.state.emv_wanted_mps if sight.body.is_emv else None)
        return by_pedals(np.asarray(self._action, np.float32), sight, self._vehicles)

    def look(self) -> dict[str, float]:
        """Process the simulated step; returns the amounts of the reward's terms."""
        state = self.view.look()
        if state is None:
            self.ended = "arrived"
            return dict.fromkeys(TERMS, 0.0)
        self.state = state
        terms = terms_of(state)
        if state.contact:
            self.ended = "contact"
        elif abs(state.sight.left_m) > OFF_ROAD_M:
            self.ended = "off_road"
        elif state.sight.s_m > self.view.way.curve.length_m - _END_M:
            self.ended = "arrived"
        return terms

    def observe(self) -> npt.NDArray[Any]:
        """Observation at the last step at which the vehicle was present."""
        return features_of(self.state.sight) if self._raster is None else self._raster.draw(self.state)


def _simulate(
    rollout: Rollout, active: Mapping[Seat, _Driver], sums: Mapping[Seat, dict[str, float]], steps: int
) -> str:
    """Simulate some steps, until all drivers have ended or the time is over, and add up the terms.

    Returns:
        Why the episode failed; empty where it did not.
    """
    for _ in range(steps):
        driving = {seat: driver for seat, driver in active.items() if not driver.ended}
        if not driving or rollout.over:
            break
        try:
            rollout.advance({driver.view.actor_id: driver.control() for driver in driving.values()})
        except EpisodeError as error:
            return str(error)
        for seat, driver in driving.items():
            for name, amount in driver.look().items():
                sums[seat][name] += amount
    return ""


class BaseEnv:
    """Runs episodes one after the other, with drivers in some seats."""

    def __init__(self, options: EnvOptions, seats: Sequence[Seat], record_to: Path | None = None) -> None:
        """Check the options.

        Raises:
            InputError: An option cannot be used.
        """
        self.seats = tuple(seats)
        self._own = options
        """Of episodes that are begun without options."""
        self._record_to = record_to
        self._take_up(options)
        self._drivers: dict[Seat, _Driver] = {}
        self.rollout: Rollout | None = None
        self._snapshots: dict[EpisodeRequest, Snapshot] = {}
        """Of the episodes that were begun last, the latest at the end."""

    def _take_up(self, options: EnvOptions) -> None:
        for seat in self.seats:
            weights_of(seat, options.rewards)
        self._rulebook = load_rulebook(options.rulebook) if options.rulebook else None
        self.options = options

    def reset(
        self, seed: int | None, random: np.random.Generator, options: Mapping[str, Any] | None = None
    ) -> dict[Seat, SeatResult]:
        """Begin the episode of a seed; without a seed one is drawn.

        Args:
            seed: Seed of the episode.
            random: Draws seeds.
            options: Fields of ``EnvOptions`` in place of the environment's, for this episode alone.

        Raises:
            InputError: An option or the request cannot be used.
            EpisodeError: SUMO failed before the first step.
        """
        self._take_up(self._own.changed(options or {}))
        self._end()
        tries = 1 if seed is not None else _TRIES
        for left in reversed(range(tries)):
            drawn = int(random.integers(*self.options.seeds)) if seed is None else seed
            try:
                self._begin(drawn)
                break
            except (InputError, EpisodeError):
                self._end()
                if not left:
                    raise
        return {
            seat: SeatResult(driver.observe(), info=self._info(driver, dict.fromkeys(TERMS, 0.0)))
            for seat, driver in self._drivers.items()
        }

    def _begin(self, seed: int) -> None:
        request = self.options.request(seed, with_av=Seat.CIVILIAN in self.seats)
        self.rollout = Rollout(request, self._snapshot_of(request))
        self._drivers = {seat: _Driver(self.options, self.rollout, seat) for seat in self.seats}

    def _snapshot_of(self, request: EpisodeRequest) -> Snapshot | None:
        """The snapshot of an episode; a new one takes the place of the one that was used longest ago."""
        if not self.options.snapshots:
            return None
        kept = self._snapshots
        kept[request] = kept.pop(request) if request in kept else take_snapshot(request)
        while len(kept) > self.options.snapshots:
            drop_snapshot(kept.pop(next(iter(kept))))
        return kept[request]

    def step(self, actions: Mapping[Seat, Any]) -> dict[Seat, SeatResult]:
        """Simulate until the next decision; returns results for drivers that had not ended before.

        Raises:
            InputError: An action cannot be used, or a driver has none; nothing has changed then.
            EpisodeError: No episode has begun, or it has ended.
        """
        rollout = self.rollout
        if rollout is None:
            raise EpisodeError("no episode has begun: reset comes first")
        active = {seat: driver for seat, driver in self._drivers.items() if not driver.ended}
        if not active:
            raise EpisodeError("the episode has ended: reset begins the next one")
        for seat in active:
            if seat not in actions:
                raise InputError("actions", ", ".join(actions), f"an action of each driver: {', '.join(active)}")
            self.options.check_action(actions[seat])
        for seat, driver in active.items():
            driver.decide(actions[seat])
        sums = {seat: dict.fromkeys(TERMS, 0.0) for seat in active}
        failure = _simulate(rollout, active, sums, self.options.steps_per_decision)
        for driver in active.values():
            driver.ended = driver.ended or ("failed" if failure else "time" if rollout.over else "")
        whole = all(driver.ended for driver in self._drivers.values())
        results = {seat: self._result(driver, sums[seat], failure) for seat, driver in active.items()}
        if whole and self._record_to is not None:
            self.save(_free_name(self._record_to / default_bag_path_of(rollout.setup.description).name))
        return results

    def _result(self, driver: _Driver, sums: dict[str, float], failure: str) -> SeatResult:
        info = self._info(driver, sums)
        if driver.ended:
            info["ended"] = driver.ended
            info["clauses"] = self._clauses(driver)
        if failure:
            info["failure"] = failure
        reward = sum(driver.weights[name] * amount for name, amount in sums.items())
        truncated = driver.ended == "time"
        return SeatResult(driver.observe(), float(reward), bool(driver.ended) and not truncated, truncated, info)

    def _info(self, driver: _Driver, sums: dict[str, float]) -> dict[str, Any]:
        rollout = self.present
        return {
            "seed": rollout.request.seed,
            "time_s": (len(rollout.steps) - 1) * STEP_S,
            "actor_id": driver.view.actor_id,
            "terms": sums,
        }

    def _clauses(self, driver: _Driver) -> dict[str, str]:
        """Grade of each clause of the rulebook; empty for an EMV's driver, to whom rulebooks do not apply."""
        rollout = self.present
        if self._rulebook is None or driver.seat is Seat.EMV:
            return {}
        sitting = examine(record_of(rollout.setup, rollout.steps), driver.view.actor_id, self._rulebook)
        return {mark.clause.clause_id: str(mark.grade) for mark in sitting.marks}

    @property
    def present(self) -> Rollout:
        """The current episode.

        Raises:
            EpisodeError: None has begun.
        """
        if self.rollout is None:
            raise EpisodeError("no episode has begun: reset comes first")
        return self.rollout

    @property
    def state(self) -> SeatState:
        """The current state of the first seat."""
        return self._drivers[self.seats[0]].state

    def save(self, bag: Path) -> RecordedEpisode:
        """Write the bag of the current episode up to its current step, as ``Rollout.save``."""
        return self.present.save(bag)

    def close(self) -> None:
        """End the episode, and the processes of all snapshots."""
        self._end()
        while self._snapshots:
            drop_snapshot(self._snapshots.popitem()[1])

    def _end(self) -> None:
        if self.rollout is not None:
            self.rollout.close()
        self._drivers, self.rollout = {}, None


def _free_name(bag: Path) -> Path:
    """Free path for a bag: a number is added if its name is taken."""
    number, free = 2, bag
    while free.exists():
        number, free = number + 1, bag.with_name(f"{bag.name}_{number}")
    return free


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
