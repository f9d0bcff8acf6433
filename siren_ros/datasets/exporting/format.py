"""What a dataset format is: what it needs of a bag, its options, and who writes it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

from siren_ros.datasets.exporting.file_writer import FileWriter
from siren_ros.datasets.sources.episode_source import EpisodeSource
from siren_ros.datasets.sources.needs import Need


@dataclass(frozen=True)
class Option:
    """One option of a format, ``--name VALUE`` on the command line."""

    name: str
    default: str
    allowed: tuple[str, ...]
    """Values; empty where any text is taken."""
    help: str
    waives: Mapping[str, tuple[Need, ...]] = field(default_factory=dict)
    """By value: what a bag then need not have."""

    @property
    def is_flag(self) -> bool:
        """Whether the option may stand alone: ``--region``."""
        return self.allowed == FLAG


FLAG: Final = ("no", "yes")


@dataclass(frozen=True)
class Format:
    """One line of the table of formats."""

    name: str
    summary: str
    needs: tuple[Need, ...]
    exporter: str
    """Where its writer is: ``module:class``, loaded when it is asked for."""
    options: tuple[Option, ...] = ()
    extra: str = ""
    """Extra of the package that brings what the writer imports; empty where nothing more is needed."""

    def needs_with(self, options: Mapping[str, str]) -> tuple[Need, ...]:
        """What a bag must hold for a set of options."""
        waived = {need for one in self.options for need in one.waives.get(options.get(one.name, one.default), ())}
        return tuple(need for need in self.needs if need not in waived)


@dataclass(frozen=True)
class EpisodeReport:
    """What was written of one episode."""

    counts: Mapping[str, int]
    """Number of things by their name: frames, boxes, scenarios."""
    classes: Mapping[str, int] = field(default_factory=dict)
    """Class balance: number of labels by class, in the format's names."""


@dataclass(frozen=True)
class EpisodePart:
    """One finished episode of a dataset."""

    episode_id: str
    """Unique in the dataset: ``S2_L2_seed0_town``."""
    index: int
    """Place in the order of the dataset."""
    split: str
    """``train``, ``val`` or ``test``."""
    folder: Path
    report: EpisodeReport


class Exporter(Protocol):
    """Writes one format. Made with the format's options; one object serves one process."""

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Writes one episode into a folder of its own, in any layout that ``assemble`` knows.

        Raises:
            BagError: The bag is damaged at the place that has been reached.
        """

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Makes the dataset of all parts, which stay as they are: files are linked, not moved."""
