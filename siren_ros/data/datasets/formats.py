"""The table of dataset formats: one entry each. An exporter is loaded only when it is used."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Final, Protocol, cast

from siren_ros.data.datasets.files import FileWriter, link
from siren_ros.data.episode_source import EpisodeSource, Need
from siren_ros.data.tracks import POPULATIONS
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.scenario import REGION_TEXT

FLAG: Final = ("no", "yes")
_PACKAGE: Final = "siren_ros.data.datasets"


@dataclass(frozen=True)
class Option:
    """One option of a format, ``--name VALUE`` on the command line."""

    name: str
    default: str
    allowed: tuple[str, ...]
    """Allowed values; empty if any text is allowed."""
    help: str
    waives: Mapping[str, tuple[Need, ...]] = field(default_factory=dict)
    """Requirements on the bag that a value makes unnecessary."""

    @property
    def is_flag(self) -> bool:
        """Whether the option may be given without a value, as ``--region``."""
        return self.allowed == FLAG


@dataclass(frozen=True)
class Format:
    """One entry of the table of formats."""

    name: str
    summary: str
    needs: tuple[Need, ...]
    exporter: str
    """Class of the exporter as ``module:class``, loaded when it is used."""
    options: tuple[Option, ...] = ()
    extra: str = ""
    """Extra of the package with the exporter's dependencies; empty if it has none."""
    command: str = "siren export"
    """The command that writes this format; the dataset's card shows it."""

    def needs_with(self, options: Mapping[str, str]) -> tuple[Need, ...]:
        """What a bag must contain for these options."""
        waived = {
            need for option in self.options for need in option.waives.get(options.get(option.name, option.default), ())
        }
        return tuple(need for need in self.needs if need not in waived)


@dataclass(frozen=True)
class EpisodeReport:
    """Statistics of one exported episode."""

    counts: Mapping[str, int]
    """Number of items by name: frames, boxes, scenarios."""
    classes: Mapping[str, int] = field(default_factory=dict)
    """Class balance: number of labels by class, in the format's names."""


@dataclass(frozen=True)
class EpisodePart:
    """One finished episode of a dataset."""

    episode_id: str
    """Id that is unique in the dataset, such as ``S2_L2_seed0_town``."""
    index: int
    """Place in the order of the dataset."""
    split: str
    """A ``Split``, or ``test`` where the user assigned all episodes to it."""
    folder: Path
    report: EpisodeReport

    @property
    def subset(self) -> str:
        """Name of the split in the format's files: ``train``, ``val`` or ``test``."""
        return self.split.partition("-")[0]


class Exporter(Protocol):
    """Writes one format. It is made with the format's options; each process has its own."""

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Writes one episode into a folder of its own, in any layout that ``assemble`` knows.

        Raises BagError: the bag is damaged at the place that has been reached.
        """

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Assemble the dataset from all parts. The parts do not change: files are linked, not moved."""


class FilesExporter:
    """Base class of formats whose dataset is the files of all episodes, in one folder or in one folder per split.

    Episodes on the same map share its file.
    """

    by_split = False

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Link the files."""
        for part in parts:
            for path in sorted(part.folder.iterdir()):
                link(path, folder / (part.subset if self.by_split else "") / path.name)


FORMATS: Final = {
    dataset_format.name: dataset_format
    for dataset_format in (
        Format(
            "csv",
            "The paper's tracks: trajectory.csv, 10 Hz, CARLA's world frame",
            (Need.TRACKS,),
            f"{_PACKAGE}.trajectory_tables:CsvExporter",
            (Option("region", "no", FLAG, f"only the vehicles in the interaction region ({REGION_TEXT})"),),
        ),
        Format(
            "kitti",
            "KITTI's 3-D object benchmark: sweeps, front camera, labels, calibration",
            (Need.LIDAR, Need.FRONT_CAMERA),
            f"{_PACKAGE}.kitti:KittiExporter",
            (
                Option(
                    "layout",
                    "kitti",
                    ("kitti", "paper"),
                    "KITTI's layout, or the paper's (labels in the LiDAR frame, which KITTI readers misread)",
                    {"paper": (Need.FRONT_CAMERA,)},
                ),
            ),
        ),
        Format(
            "openpcdet",
            "OpenPCDet's custom dataset: points, labels in the LiDAR frame, ImageSets",
            (Need.LIDAR,),
            f"{_PACKAGE}.kitti:OpenPcdetExporter",
            (Option("least-points", "1", (), "least number of LiDAR points of a box"),),
        ),
        Format(
            "nuscenes",
            "nuScenes: scenes with all sweeps, pictures of all cameras and annotated keyframes at 2 Hz",
            (Need.LIDAR, Need.CAMERA, Need.MAP),
            f"{_PACKAGE}.nuscenes:NuscenesExporter",
            (
                Option(
                    "emv-category",
                    "vehicle.car",
                    ("vehicle.car", "vehicle.emergency"),
                    "category of emergency vehicles: the paper's, or nuScenes'",
                ),
                Option(
                    "vehicle-category",
                    "nuscenes",
                    ("nuscenes", "vehicle.car"),
                    "categories of other vehicles: nuScenes' car, truck and bus, or the paper's one class",
                ),
            ),
        ),
        Format(
            "argoverse2",
            "Argoverse 2 motion forecasting: a scenario of 11 s for each vehicle and frame, with the map",
            (Need.TRACKS, Need.MAP, Need.EMV),
            f"{_PACKAGE}.argoverse2:Argoverse2Exporter",
            (
                Option("population", "region", POPULATIONS, "vehicles to predict; the scenarios show all vehicles"),
                Option("stride", "1", (), "number of frames of 0.1 s between two scenarios of a vehicle"),
            ),
        ),
        Format(
            "ngsim",
            "NGSIM for CSP, STDAN and BAT: tracks in feet, 13 x 3 grid, manoeuvre classes",
            (Need.TRACKS, Need.MAP, Need.EMV),
            f"{_PACKAGE}.trajectory_tables:NgsimExporter",
            (Option("population", "region", POPULATIONS, "vehicles that are targets and neighbours"),),
        ),
        Format(
            "commonroad",
            "CommonRoad 2020a: lanelets, lights, dynamic obstacles; the EMV is the planning problem",
            (Need.TRACKS, Need.MAP, Need.EMV),
            f"{_PACKAGE}.commonroad:CommonRoadExporter",
            (
                Option(
                    "intersections",
                    "outgoing",
                    ("outgoing", "successors"),
                    "name of the lanelets behind an arm, for commonroad-io 2026.1 or for 2024.3 and older",
                ),
            ),
        ),
        Format(
            "opendrive",
            "OpenDRIVE: the episode's map",
            (Need.MAP,),
            f"{_PACKAGE}.simulator_scenarios:OpenDriveExporter",
        ),
        Format(
            "openscenario",
            "OpenSCENARIO 1.2: all vehicles follow their recorded trajectories on the OpenDRIVE map",
            (Need.TRACKS, Need.MAP),
            f"{_PACKAGE}.simulator_scenarios:OpenScenarioExporter",
            (
                Option(
                    "dialect",
                    "1.2",
                    ("1.2", "scenario-runner"),
                    "OpenSCENARIO 1.2, or 1.0 with CARLA's blueprints, as CARLA's ScenarioRunner reads it",
                ),
            ),
        ),
        Format(
            "scenarionet",
            "ScenarioNet for MetaDrive: tracks, map features and dynamic map states",
            (Need.TRACKS, Need.MAP, Need.EMV),
            f"{_PACKAGE}.simulator_scenarios:ScenarioNetExporter",
        ),
        Format(
            "rerun",
            "Rerun: map, boxes, path, events, and recorded LiDAR and cameras, on a timeline",
            (Need.TRACKS, Need.MAP),
            f"{_PACKAGE}.rerun:RerunExporter",
            extra="rerun",
        ),
    )
}
"""Formats by name, in the order in which commands list them."""


def format_named(name: str) -> Format:
    """A format by its name; InputError for an unknown one."""
    if name not in FORMATS:
        raise InputError("format", name, f"one of {', '.join(FORMATS)}")
    return FORMATS[name]


def load_exporter(dataset_format: Format, options: Mapping[str, str]) -> Exporter:
    """Load the exporter of a format.

    Raises InputError: an option is unknown or has a value that is not allowed, or the extra is not installed.
    """
    known = {option.name: option for option in dataset_format.options}
    for name, value in options.items():
        if name not in known:
            allowed = f"one of {', '.join(known)}" if known else f"none for {dataset_format.name}"
            raise InputError("option", name, allowed)
        if known[name].allowed and value not in known[name].allowed:
            raise InputError(name, value, f"one of {', '.join(known[name].allowed)}")
    values = {name: options.get(name, option.default) for name, option in known.items()}
    module, _, exporter = dataset_format.exporter.partition(":")
    try:
        loaded = getattr(import_module(module), exporter)
    except ModuleNotFoundError as error:
        if not dataset_format.extra or str(error.name).startswith("siren_ros"):
            raise
        command = f"`./env --with {dataset_format.extra} siren export {dataset_format.name} …`"
        raise InputError("format", dataset_format.name, f"{command}, which installs {error.name}") from error
    return cast("Exporter", loaded(**{name.replace("-", "_"): value for name, value in values.items()}))
