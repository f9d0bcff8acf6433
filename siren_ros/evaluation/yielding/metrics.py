"""The table of the yield metrics: of an episode, and of one driver. One function computes each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from siren_ros.evaluation.surrogate_safety import PairMeasures, conflict_series, pair_measures
from siren_ros.evaluation.yielding import corridor
from siren_ros.evaluation.yielding import marks as civilians
from siren_ros.evaluation.yielding import marks as driver
from siren_ros.evaluation.yielding import marks as emv
from siren_ros.evaluation.yielding import marks as safety
from siren_ros.evaluation.yielding import marks as wake
from siren_ros.evaluation.yielding.corridor import CorridorSeries, corridor_series
from siren_ros.evaluation.yielding.emv_line import EmvLine
from siren_ros.evaluation.yielding.encounters import Encounter, encounters_of
from siren_ros.evaluation.yielding.thresholds import Measure, YieldThresholds
from siren_ros.recording.episode_record import EpisodeRecord


@dataclass(frozen=True)
class YieldScene:
    """An episode whose EMV moves."""

    record: EpisodeRecord
    line: EmvLine
    limits: YieldThresholds

    @cached_property
    def encounters(self) -> tuple[Encounter, ...]:
        """The EMV with each driver that it comes up to."""
        return tuple(encounters_of(self.record, self.line, self.limits))

    @cached_property
    def corridor(self) -> CorridorSeries:
        """The way ahead over time."""
        return corridor_series(self.record, self.line, self.limits)

    @cached_property
    def conflicts(self) -> tuple[PairMeasures, ...]:
        """Surrogate safety measures of the EMV with everybody."""
        return self.conflicts_of(self.record.emv_ids[0])

    def conflicts_of(self, actor_id: int) -> tuple[PairMeasures, ...]:
        """Surrogate safety measures of an actor with everybody; worked out once for each actor."""
        if actor_id not in self._conflicts:
            self._conflicts[actor_id] = pair_measures(conflict_series(self.record, actor_id))
        return self._conflicts[actor_id]

    @cached_property
    def _conflicts(self) -> dict[int, tuple[PairMeasures, ...]]:
        return {}


@dataclass(frozen=True)
class EpisodeMetric:
    """A number of an episode."""

    name: str
    meaning: str
    compute: Callable[[YieldScene], Measure]


@dataclass(frozen=True)
class DriverMetric:
    """A number of one driver's encounter with the EMV."""

    name: str
    meaning: str
    compute: Callable[[YieldScene, Encounter], Measure]


DRIVER_METRICS: Final = (
    DriverMetric(
        "response_time_s",
        "until the driver first shifted or slowed down",
        lambda scene, one: driver.response_time_s(one, scene.limits),
    ),
    DriverMetric(
        "clearance_time_s",
        "until the EMV's way was clear of the driver",
        lambda _, one: driver.clearance_time_s(one),
    ),
    DriverMetric(
        "compliance",
        "1 where the way was clear before the EMV came close",
        lambda scene, one: driver.complied(one, scene.limits),
    ),
    DriverMetric(
        "held_up_s",
        "for which the EMV was stuck behind the driver",
        lambda scene, one: driver.held_up_s(one, scene.limits),
    ),
    DriverMetric("made_way_m", "lateral shift before the EMV passed", lambda _, one: driver.made_way_m(one)),
    DriverMetric("passing_gap_m", "lateral gap as the EMV passed", lambda _, one: driver.passing_gap_m(one)),
    DriverMetric(
        "recovery_time_s",
        "from the passing until the driver was back at speed and in its lane",
        lambda scene, one: driver.recovery_time_s(one, scene.limits),
    ),
    DriverMetric(
        "min_ttc_s", "least TTC with anybody", lambda scene, one: safety.min_ttc_s(scene.conflicts_of(one.actor_id))
    ),
    DriverMetric(
        "min_pet_s", "least PET with anybody", lambda scene, one: safety.min_pet_s(scene.conflicts_of(one.actor_id))
    ),
    DriverMetric(
        "collisions", "collisions of the driver", lambda scene, one: safety.collisions(scene.record, one.actor_id)
    ),
)


def of_drivers(
    scene: YieldScene, mark: Callable[[Encounter], Measure], statistic: Callable[[Sequence[float]], float]
) -> Measure:
    """A statistic of a mark over the drivers for whom it has a value."""
    marks = [found for found in map(mark, scene.encounters) if found.valid]
    if not marks:
        return Measure.lacking("no driver had to make way")
    return Measure(float(statistic([found.value for found in marks])), at_least=any(found.at_least for found in marks))


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


EPISODE_METRICS: Final = (
    EpisodeMetric(
        "site_time_s",
        "until the EMV is at the middle of its site",
        lambda scene: emv.site_time_s(scene.record, scene.line, scene.limits),
    ),
    EpisodeMetric(
        "emv_delay_s",
        "time that the EMV lost against free flow",
        lambda scene: emv.emv_delay_s(scene.record, scene.line, scene.limits),
    ),
    EpisodeMetric("emv_stops", "stops of the EMV", lambda scene: emv.emv_stops(scene.record, scene.line, scene.limits)),
    EpisodeMetric(
        "emv_standstill_s",
        "for which the EMV stood",
        lambda scene: emv.emv_standstill_s(scene.record, scene.line, scene.limits),
    ),
    EpisodeMetric(
        "emv_gap_escape_s",
        "for which the EMV was in gap escape",
        lambda scene: emv.emv_gap_escape_s(scene.record, scene.line, scene.limits),
    ),
    EpisodeMetric(
        "corridor_width_m",
        "median width of the way ahead through the traffic",
        lambda scene: corridor.corridor_width_m(scene.corridor),
    ),
    EpisodeMetric(
        "corridor_continuity",
        "share of the time at which the EMV fitted through, 30 m ahead",
        lambda scene: corridor.corridor_continuity(scene.corridor),
    ),
    EpisodeMetric(
        "drivers_in_the_way",
        "drivers who had to make way",
        lambda scene: Measure(float(sum(one.was_in_the_way for one in scene.encounters))),
    ),
    EpisodeMetric(
        "response_time_s",
        "median over those drivers, until they first shifted or slowed down",
        lambda scene: of_drivers(scene, lambda one: driver.response_time_s(one, scene.limits), _median),
    ),
    EpisodeMetric(
        "clearance_time_s",
        "median over them, until the way was clear",
        lambda scene: of_drivers(scene, driver.clearance_time_s, _median),
    ),
    EpisodeMetric(
        "compliance",
        "share of them that cleared the way in time",
        lambda scene: of_drivers(scene, lambda one: driver.complied(one, scene.limits), _mean),
    ),
    EpisodeMetric(
        "held_up_s",
        "for which the EMV was stuck behind them",
        lambda scene: of_drivers(scene, lambda one: driver.held_up_s(one, scene.limits), sum),
    ),
    EpisodeMetric(
        "wake_duration_s",
        "longest recovery of a driver after the passing",
        lambda scene: wake.wake_duration_s(scene.encounters, scene.limits),
    ),
    EpisodeMetric(
        "wake_length_m",
        "farthest disturbed driver behind the EMV",
        lambda scene: wake.wake_length_m(scene.encounters, scene.limits),
    ),
    EpisodeMetric(
        "civilian_delay_s",
        "vehicle-seconds that the civilians lost",
        lambda scene: civilians.civilian_delay_s(scene.record),
    ),
    EpisodeMetric("min_ttc_s", "least TTC of the EMV", lambda scene: safety.min_ttc_s(scene.conflicts)),
    EpisodeMetric("min_pet_s", "least PET of the EMV", lambda scene: safety.min_pet_s(scene.conflicts)),
    EpisodeMetric("collisions", "collisions of everybody", lambda scene: safety.collisions(scene.record)),
)
