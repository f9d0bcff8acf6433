"""The table of the yield metrics: of an episode, and of one driver. One function computes each."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Self

import numpy as np

from siren_ros.evaluation.surrogate_safety import PairMeasures, conflict_series, pair_measures
from siren_ros.evaluation.yielding import marks
from siren_ros.evaluation.yielding.corridor import (
    CorridorSeries,
    corridor_continuity,
    corridor_series,
    corridor_width_m,
)
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

    @classmethod
    def of_mark(cls, name: str, meaning: str, mark: Callable[[Encounter, YieldThresholds], Measure]) -> Self:
        """The metric of a mark that looks at the encounter alone."""
        return cls(name, meaning, lambda scene, encounter: mark(encounter, scene.limits))


DRIVER_METRICS: Final = (
    DriverMetric.of_mark("response_time_s", "until the driver first shifted or slowed down", marks.response_time_s),
    DriverMetric.of_mark("clearance_time_s", "until the EMV's way was clear of the driver", marks.clearance_time_s),
    DriverMetric.of_mark("compliance", "1 where the way was clear before the EMV came close", marks.complied),
    DriverMetric.of_mark("held_up_s", "for which the EMV was stuck behind the driver", marks.held_up_s),
    DriverMetric.of_mark("made_way_m", "lateral shift before the EMV passed", marks.made_way_m),
    DriverMetric.of_mark("passing_gap_m", "lateral gap as the EMV passed", marks.passing_gap_m),
    DriverMetric.of_mark(
        "recovery_time_s", "from the passing until the driver was back at speed and in its lane", marks.recovery_time_s
    ),
    DriverMetric(
        "min_ttc_s", "least TTC with anybody", lambda scene, one: marks.min_ttc_s(scene.conflicts_of(one.actor_id))
    ),
    DriverMetric(
        "min_pet_s", "least PET with anybody", lambda scene, one: marks.min_pet_s(scene.conflicts_of(one.actor_id))
    ),
    DriverMetric(
        "collisions", "collisions of the driver", lambda scene, one: marks.collisions(scene.record, one.actor_id)
    ),
)


def _emv(name: str, meaning: str, mark: Callable[[EpisodeRecord, EmvLine, YieldThresholds], Measure]) -> EpisodeMetric:
    return EpisodeMetric(name, meaning, lambda scene: mark(scene.record, scene.line, scene.limits))


def of_drivers(
    scene: YieldScene,
    mark: Callable[[Encounter, YieldThresholds], Measure],
    statistic: Callable[[list[float]], np.floating[Any] | float],
) -> Measure:
    """A statistic of a mark over the drivers for whom it has a value."""
    known = [value for one in scene.encounters if (value := mark(one, scene.limits)).valid]
    if not known:
        return Measure.lacking("no driver had to make way")
    return Measure(float(statistic([value.value for value in known])), at_least=any(value.at_least for value in known))


EPISODE_METRICS: Final = (
    _emv("site_time_s", "until the EMV is at the middle of its site", marks.site_time_s),
    _emv("emv_delay_s", "time that the EMV lost against free flow", marks.emv_delay_s),
    _emv("emv_stops", "stops of the EMV", marks.emv_stops),
    _emv("emv_standstill_s", "for which the EMV stood", marks.emv_standstill_s),
    _emv("emv_gap_escape_s", "for which the EMV was in gap escape", marks.emv_gap_escape_s),
    EpisodeMetric(
        "corridor_width_m",
        "median width of the way ahead through the traffic",
        lambda scene: corridor_width_m(scene.corridor),
    ),
    EpisodeMetric(
        "corridor_continuity",
        "share of the time at which the EMV fitted through, 30 m ahead",
        lambda scene: corridor_continuity(scene.corridor),
    ),
    EpisodeMetric(
        "drivers_in_the_way",
        "drivers who had to make way",
        lambda scene: Measure(float(sum(one.was_in_the_way for one in scene.encounters))),
    ),
    EpisodeMetric(
        "response_time_s",
        "median over those drivers, until they first shifted or slowed down",
        lambda scene: of_drivers(scene, marks.response_time_s, np.median),
    ),
    EpisodeMetric(
        "clearance_time_s",
        "median over them, until the way was clear",
        lambda scene: of_drivers(scene, marks.clearance_time_s, np.median),
    ),
    EpisodeMetric(
        "compliance",
        "share of them that cleared the way in time",
        lambda scene: of_drivers(scene, marks.complied, np.mean),
    ),
    EpisodeMetric(
        "held_up_s", "for which the EMV was stuck behind them", lambda scene: of_drivers(scene, marks.held_up_s, sum)
    ),
    EpisodeMetric(
        "wake_duration_s",
        "longest recovery of a driver after the passing",
        lambda scene: marks.wake_duration_s(scene.encounters, scene.limits),
    ),
    EpisodeMetric(
        "wake_length_m",
        "farthest disturbed driver behind the EMV",
        lambda scene: marks.wake_length_m(scene.encounters, scene.limits),
    ),
    EpisodeMetric(
        "civilian_delay_s",
        "vehicle-seconds that the civilians lost",
        lambda scene: marks.civilian_delay_s(scene.record),
    ),
    EpisodeMetric("min_ttc_s", "least TTC of the EMV", lambda scene: marks.min_ttc_s(scene.conflicts)),
    EpisodeMetric("min_pet_s", "least PET of the EMV", lambda scene: marks.min_pet_s(scene.conflicts)),
    EpisodeMetric("collisions", "collisions of everybody", lambda scene: marks.collisions(scene.record)),
)
