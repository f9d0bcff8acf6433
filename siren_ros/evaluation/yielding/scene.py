"""All that the yield metrics look at, worked out once for an episode."""

from dataclasses import dataclass
from functools import cached_property

from siren_ros.evaluation.surrogate_safety.conflict_measures import PairMeasures, conflict_series, pair_measures
from siren_ros.evaluation.yielding.emv_line import EmvLine
from siren_ros.evaluation.yielding.encounters import Encounter, encounters_of
from siren_ros.evaluation.yielding.marks.corridor import CorridorSeries, corridor_series
from siren_ros.evaluation.yielding.thresholds import YieldThresholds
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
