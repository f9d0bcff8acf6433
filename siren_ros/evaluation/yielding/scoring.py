"""The yield metrics of a record: of the episode, and of every driver that the EMV came up to."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from siren_ros.evaluation.yielding.emv_line import EmvLine
from siren_ros.evaluation.yielding.encounters import Encounter
from siren_ros.evaluation.yielding.measure import Measure
from siren_ros.evaluation.yielding.metrics import DRIVER_METRICS, EPISODE_METRICS
from siren_ros.evaluation.yielding.scene import YieldScene
from siren_ros.evaluation.yielding.thresholds import YieldThresholds
from siren_ros.recording.episode_record import EpisodeRecord


@dataclass(frozen=True)
class DriverMarks:
    """One driver's marks."""

    actor_id: int
    began_s: float
    """Simulated time at which the encounter began."""
    in_the_way: bool
    with_siren: bool
    under_test: bool
    """Whether it is the AV under test."""
    marks: dict[str, Measure]


@dataclass(frozen=True)
class YieldScores:
    """The scores of one episode."""

    metrics: dict[str, Measure]
    drivers: tuple[DriverMarks, ...]

    def driver_rows(self) -> list[dict[str, Any]]:
        """One flat row for each driver; a mark without a value is None."""
        return [
            {
                "actor_id": driver.actor_id,
                "began_s": driver.began_s,
                "in_the_way": driver.in_the_way,
                "with_siren": driver.with_siren,
                "under_test": driver.under_test,
                **{name: mark.value if mark.valid else None for name, mark in driver.marks.items()},
            }
            for driver in self.drivers
        ]


def score_yielding(
    record: EpisodeRecord, limits: YieldThresholds | None = None, names: Collection[str] | None = None
) -> YieldScores:
    """All yield metrics of an episode; where the EMV does not move none has a value.

    Args:
        record: The episode.
        limits: What counts as what.
        names: These metrics of the episode alone, and no drivers: corridor and encounters are most of the work.

    Raises:
        InputError: The episode has no EMV.
    """
    line = EmvLine.of(record)
    wanted = [metric for metric in EPISODE_METRICS if names is None or metric.name in names]
    if line is None:
        nothing = Measure.lacking("the EMV did not move")
        return YieldScores({metric.name: nothing for metric in wanted}, ())
    scene = YieldScene(record, line, limits or YieldThresholds())
    metrics = {metric.name: metric.compute(scene) for metric in wanted}
    drivers = scene.encounters if names is None else ()
    return YieldScores(metrics, tuple(_marks(scene, encounter) for encounter in drivers))


def _marks(scene: YieldScene, encounter: Encounter) -> DriverMarks:
    return DriverMarks(
        actor_id=encounter.actor_id,
        began_s=float(encounter.driver.track.time_s[0]),
        in_the_way=encounter.was_in_the_way,
        with_siren=encounter.with_siren,
        under_test=encounter.actor_id == scene.record.description.av_id,
        marks={metric.name: metric.compute(scene, encounter) for metric in DRIVER_METRICS},
    )
