"""The table of dataset formats. One line for each; its writer is loaded when it is asked for."""

from collections.abc import Mapping
from importlib import import_module
from typing import Final, cast

from siren_ros.datasets.exporting.format import FLAG, Exporter, Format, Option
from siren_ros.datasets.sources.needs import Need
from siren_ros.datasets.sources.sampling import POPULATIONS
from siren_ros.errors import InputError

_PACKAGE: Final = "siren_ros.datasets"
FORMATS: Final = {
    made.name: made
    for made in (
        Format(
            "csv",
            "Tracks as the paper has them: trajectory.csv, 10 Hz, CARLA's world frame",
            (Need.TRACKS,),
            f"{_PACKAGE}.trajectory_csv:CsvExporter",
            (Option("region", "no", FLAG, "only who is in the region of 40 m in, 50 m out around the EMV"),),
        ),
        Format(
            "kitti",
            "KITTI's 3-D object benchmark: sweeps, front camera, labels, calibration",
            (Need.LIDAR, Need.FRONT_CAMERA),
            f"{_PACKAGE}.kitti.exporter:KittiExporter",
            (
                Option(
                    "layout",
                    "kitti",
                    ("kitti", "paper"),
                    "KITTI's own, or exactly the paper's (labels in the LiDAR frame, which KITTI readers misread)",
                    {"paper": (Need.FRONT_CAMERA,)},
                ),
            ),
        ),
        Format(
            "openpcdet",
            "OpenPCDet's custom dataset: points, labels in the LiDAR frame, ImageSets",
            (Need.LIDAR,),
            f"{_PACKAGE}.openpcdet:OpenPcdetExporter",
            (Option("least-points", "1", (), "boxes with fewer LiDAR points are left out"),),
        ),
        Format(
            "nuscenes",
            "nuScenes: scenes with all sweeps, pictures of all cameras and annotated keyframes at 2 Hz",
            (Need.LIDAR, Need.CAMERA, Need.MAP),
            f"{_PACKAGE}.nuscenes.exporter:NuscenesExporter",
            (
                Option(
                    "emv-category",
                    "vehicle.car",
                    ("vehicle.car", "vehicle.emergency"),
                    "category of emergency vehicles: the paper's, or nuScenes' own",
                ),
                Option(
                    "vehicle-category",
                    "nuscenes",
                    ("nuscenes", "vehicle.car"),
                    "category of all other vehicles: nuScenes' car, truck and bus, or the paper's one class",
                ),
            ),
        ),
        Format(
            "argoverse2",
            "Argoverse 2 motion forecasting: a scenario of 11 s for each vehicle and frame, with the map",
            (Need.TRACKS, Need.MAP, Need.EMV),
            f"{_PACKAGE}.argoverse2.exporter:Argoverse2Exporter",
            (
                Option("population", "region", POPULATIONS, "whose windows are scenarios; everybody is in them"),
                Option("stride", "1", (), "frames of 0.1 s from one scenario of a vehicle to the next"),
            ),
        ),
        Format(
            "ngsim",
            "NGSIM as CSP, STDAN and BAT read it: tracks in feet, 13 x 3 grid, manoeuvre classes",
            (Need.TRACKS, Need.MAP, Need.EMV),
            f"{_PACKAGE}.ngsim.exporter:NgsimExporter",
            (Option("population", "region", POPULATIONS, "whose windows are samples, and who is a neighbour"),),
        ),
        Format(
            "commonroad",
            "CommonRoad 2020a: lanelets, lights, dynamic obstacles; the EMV is the planning problem",
            (Need.TRACKS, Need.MAP, Need.EMV),
            f"{_PACKAGE}.commonroad.exporter:CommonRoadExporter",
            (
                Option(
                    "intersections",
                    "outgoing",
                    ("outgoing", "successors"),
                    "how the lanelets behind an arm are named: as commonroad-io 2026.1 reads them, or 2024.3 and older",
                ),
            ),
        ),
        Format(
            "opendrive",
            "OpenDRIVE: the episode's map",
            (Need.MAP,),
            f"{_PACKAGE}.opendrive:OpenDriveExporter",
        ),
        Format(
            "openscenario",
            "OpenSCENARIO 1.2: everybody follows the recorded trajectory on the OpenDRIVE map",
            (Need.TRACKS, Need.MAP),
            f"{_PACKAGE}.openscenario.exporter:OpenScenarioExporter",
        ),
        Format(
            "scenarionet",
            "ScenarioNet: tracks, map features and dynamic map states that MetaDrive replays",
            (Need.TRACKS, Need.MAP, Need.EMV),
            f"{_PACKAGE}.scenarionet.exporter:ScenarioNetExporter",
        ),
        Format(
            "rerun",
            "Rerun: map, boxes, path, events, and LiDAR and cameras where they were recorded, on a timeline",
            (Need.TRACKS, Need.MAP),
            f"{_PACKAGE}.rerun.exporter:RerunExporter",
            extra="rerun",
        ),
    )
}
"""By name, in the order in which they are listed."""


def format_named(name: str) -> Format:
    """A format by its name; InputError for an unknown one."""
    if name not in FORMATS:
        raise InputError("format", name, f"one of {', '.join(FORMATS)}")
    return FORMATS[name]


def load_exporter(made: Format, options: Mapping[str, str]) -> Exporter:
    """The writer of a format.

    Raises:
        InputError: An option is unknown or has a value that is not allowed, or the extra is not installed.
    """
    known = {option.name: option for option in made.options}
    for name, value in options.items():
        if name not in known:
            raise InputError("option", name, f"one of {', '.join(known)}" if known else f"none for {made.name}")
        if known[name].allowed and value not in known[name].allowed:
            raise InputError(name, value, f"one of {', '.join(known[name].allowed)}")
    values = {name: options.get(name, option.default) for name, option in known.items()}
    module, _, exporter = made.exporter.partition(":")
    try:
        loaded = getattr(import_module(module), exporter)
    except ModuleNotFoundError as error:
        if not made.extra or str(error.name).startswith("siren_ros"):
            raise
        command = f"`./env --with {made.extra} siren export {made.name} …`"
        raise InputError("format", made.name, f"{command}, which installs {error.name}") from error
    return cast("Exporter", loaded(**{name.replace("-", "_"): value for name, value in values.items()}))
