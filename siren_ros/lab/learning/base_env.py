"""Runs episodes with drivers, decision by decision; the basis of all environments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.bag_folder import default_bag_path_of
from siren_ros.errors import EpisodeError, InputError
from siren_ros.lab.learning.options import Action, EnvOptions, Observation
from siren_ros.lab.learning.raster import RasterView
from siren_ros.lab.learning.rewards import OFF_ROAD_M, TERMS, terms_of, weights_of
from siren_ros.lab.learning.rollout import Rollout, Seat
from siren_ros.lab.learning.seat_state import SeatState, SeatView
from siren_ros.reports.exam.grading import examine
from siren_ros.reports.exam.rulebook import load_rulebook
from siren_ros.running.generation.closed_loop import record_of
from siren_ros.running.generation.recorded_episode import RecordedEpisode
from siren_ros.running.seat.features import features_of
from siren_ros.running.seat.manoeuvres import Aim, Manoeuvre, aim_of, by_manoeuvre, by_pedals
from siren_ros.simulation.dynamics.parameters import load_vehicle_parameters
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
        self.close()
        tries = 1 if seed is not None else _TRIES
        for left in reversed(range(tries)):
            drawn = int(random.integers(*self.options.seeds)) if seed is None else seed
            try:
                self._begin(drawn)
                break
            except (InputError, EpisodeError):
                self.close()
                if not left:
                    raise
        return {
            seat: SeatResult(driver.observe(), info=self._info(driver, dict.fromkeys(TERMS, 0.0)))
            for seat, driver in self._drivers.items()
        }

    def _begin(self, seed: int) -> None:
        self.rollout = Rollout(self.options.request(seed, with_av=Seat.CIVILIAN in self.seats))
        self._drivers = {seat: _Driver(self.options, self.rollout, seat) for seat in self.seats}

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
        """End the episode."""
        if self.rollout is not None:
            self.rollout.close()
        self._drivers, self.rollout = {}, None


def _free_name(bag: Path) -> Path:
    """Free path for a bag: a number is added if its name is taken."""
    number, free = 2, bag
    while free.exists():
        number, free = number + 1, bag.with_name(f"{bag.name}_{number}")
    return free
