"""The table of dataset formats. One line for each; its writer is loaded when it is asked for."""

from collections.abc import Mapping
from importlib import import_module
from typing import Final, cast

from siren_ros.datasets.exporting.format import FLAG, Exporter, Format, Option
from siren_ros.datasets.sources.needs import Need
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
