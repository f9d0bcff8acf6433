"""What identifies an episode, and how it ended."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from siren_ros.params.input_files import FILES_ON_DISK, InputFiles, RecordedFiles, files_from_json
from siren_ros.scenario.levels import EmergencyLevel
from siren_ros.world.actors import NO_ACTOR

FILES_PARAMETER: Final = "files"
"""Key of ``EpisodeDescription.parameters`` with the text and the hash of every parameter file."""
MAP_SOURCE_PARAMETER: Final = "map_source_sha256"
"""Key of the hash of the map file before it was compiled, unpacked where it was packed."""


class EpisodeEnd(StrEnum):
    """Why an episode ended."""

    COMPLETE = "complete"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True)
class EpisodeDescription:
    """Everything that is needed to make the same episode again."""

    template: str
    level: EmergencyLevel
    seed: int
    map_name: str
    map_sha256: str
    """Of the compiled SUMO net."""
    duration_s: float
    sensor_suite: str
    preset: str
    emv_ids: tuple[int, ...]
    parameters: Mapping[str, object] = field(default_factory=dict)
    """The request, the template's values, the predicate and the parameter files; JSON types only."""
    versions: Mapping[str, str] = field(default_factory=dict)
    site: Mapping[str, object] = field(default_factory=dict)
    """The place that the site finder chose: kind, junction, approach lanes, route edges."""

    @property
    def files(self) -> InputFiles:
        """The recorded parameter files; those on disk for a description without any.

        Raises:
            BagError: The recorded files are damaged.
        """
        stored = self.parameters.get(FILES_PARAMETER)
        return FILES_ON_DISK if stored is None else RecordedFiles(files_from_json(stored))

    @property
    def av_id(self) -> int:
        """The civilian that an external controller drives; NO_ACTOR in episodes without one."""
        av = self.parameters.get("av")
        return int(av["actor_id"]) if isinstance(av, Mapping) else NO_ACTOR

    @property
    def asked(self) -> Mapping[str, object]:
        """The request that the episode was made from; empty where the description does not say."""
        request = self.parameters.get("request")
        return request if isinstance(request, Mapping) else {}

    @property
    def predictor(self) -> str:
        """The program whose predictions are recorded; empty in episodes without one."""
        return str(self.asked.get("predictor", ""))

    @property
    def detector(self) -> str:
        """The detector whose boxes are recorded; empty in episodes without one."""
        return str(self.asked.get("detector", ""))

    @property
    def draw(self) -> str:
        """Values of the template's parameters in place of the seed's own, as the request has them; empty without."""
        return str(self.asked.get("values", ""))

    @property
    def template_values(self) -> Mapping[str, float]:
        """Values of the template's parameters, by path; those alone that are numbers."""
        values = self.parameters.get("template")
        if not isinstance(values, Mapping):
            return {}
        return {
            str(name): float(value)
            for name, value in values.items()
            if isinstance(value, int | float) and not isinstance(value, bool)
        }

    @property
    def av_sensor_suite(self) -> str:
        """Sensor suite of the AV under test; empty in episodes without one."""
        av = self.parameters.get("av")
        return str(av["sensors"]) if isinstance(av, Mapping) else ""


@dataclass(frozen=True)
class EpisodeOutcome:
    """How an episode ended, as stored at the end of its bag."""

    end: EpisodeEnd
    reason: str
    steps: int
    predicate_holds: bool | None
    """None where the predicate could not be evaluated."""
    measures: Mapping[str, float | int | str] = field(default_factory=dict)
    """Numbers of the interaction: predicate parts, collisions, residual percentiles, travel time."""

    @property
    def shortcomings(self) -> tuple[str, ...]:
        """What an episode that was made lacks, in words; empty where its interaction happened without a collision."""
        return shortcomings(self.predicate_holds, int(self.measures.get("collisions", 0)))


def shortcomings(predicate_holds: bool | None, collisions: int) -> tuple[str, ...]:
    """As ``EpisodeOutcome.shortcomings``, of its two parts."""
    happened = {
        True: (),
        False: ("the interaction did not happen",),
        None: ("whether the interaction happened could not be judged",),
    }[predicate_holds]
    collided = (f"{collisions} collision{'s' if collisions > 1 else ''}",) if collisions else ()
    return (*happened, *collided)
