"""``siren export csv|kitti BAG --out DIR``: episodes in other people's formats."""

import argparse
from pathlib import Path

from siren_ros.datasets.kitti_export import export_kitti
from siren_ros.datasets.trajectory_csv import export_csv
from siren_ros.errors import EXIT_OK
from siren_ros.recording.bag_reader import read_episode


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = "Writes an episode in another format."
    formats = verb.add_subparsers(title="formats", metavar="FORMAT", required=True)
    csv = formats.add_parser(
        "csv",
        help="trajectory.csv: every actor at 10 Hz, CARLA's world frame",
        description="Writes DIR/trajectory.csv: one row per actor and logged frame at 10 Hz, in CARLA's world frame.",
    )
    kitti = formats.add_parser(
        "kitti",
        help="KITTI: sweeps and labels, and the front camera where it was recorded",
        description="Writes velodyne/ and label_2/ in the paper's layout, image_2/ and calib/ where there is a camera.",
    )
    for parser, run in ((csv, _run_csv), (kitti, _run_kitti)):
        parser.add_argument("bag", type=Path, metavar="BAG", help="folder of a recorded episode")
        parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="folder to write into")
        parser.set_defaults(run=run)


def _run_csv(arguments: argparse.Namespace) -> int:
    print(export_csv(read_episode(arguments.bag), arguments.out))
    return EXIT_OK


def _run_kitti(arguments: argparse.Namespace) -> int:
    frames = export_kitti(arguments.bag, arguments.out)
    print(f"{arguments.out}: {frames} frames")
    return EXIT_OK
