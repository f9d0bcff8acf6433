"""``siren video BAG --view birdseye|front|grid --out FILE.mp4``: an episode as a film."""

import argparse
from pathlib import Path

from siren_ros.errors import EXIT_OK
from siren_ros.pictures.video import CRF, FRAME_RATE_HZ, Coding, View, save_video


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = (
        f"Writes an H.264 MP4 file at {FRAME_RATE_HZ} Hz of simulated time: the episode from above, with "
        "vehicles coloured by what they do, signals and the EMV's mode; the recorded front camera; or a grid of all "
        "cameras and the view from above."
    )
    verb.add_argument("bag", type=Path, metavar="BAG", help="folder of a recorded episode")
    verb.add_argument(
        "--view", choices=[view.value for view in View], default=View.BIRDSEYE.value, help="what it shows"
    )
    verb.add_argument("--out", type=Path, metavar="FILE.mp4", required=True, help="video to write")
    verb.add_argument("--frames", type=int, metavar="N", help="number of frames (paper: 190); all without it")
    verb.add_argument("--start-s", type=float, metavar="S", default=0.0, help="simulated time of the first frame")
    verb.add_argument("--width", type=int, metavar="PX", help="scale wider frames down to this")
    verb.add_argument(
        "--crf",
        type=int,
        metavar="N",
        default=CRF,
        help=f"H.264's quality, 0 to 51 (default {CRF}: almost no visible loss); six more are about half the bytes",
    )
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Makes the video."""
    coding = Coding(arguments.width, arguments.crf)
    frames = save_video(arguments.bag, View(arguments.view), arguments.out, arguments.frames, arguments.start_s, coding)
    print(f"{arguments.out}: {frames} frames, {frames / FRAME_RATE_HZ:.1f} s")
    return EXIT_OK
