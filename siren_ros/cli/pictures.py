"""``siren plot``, ``siren sense`` and ``siren video``: an episode as a picture, to its sensors, and as a film."""

import argparse
from pathlib import Path

from siren_ros.cli.options import add_former
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import EXIT_OK
from siren_ros.scoring.pictures.birdseye import save_episode_picture
from siren_ros.scoring.pictures.sensor_views import observe_at, save_sheet
from siren_ros.scoring.pictures.video import CRF, FRAME_RATE_HZ, Coding, View, save_video
from siren_ros.sensing.look import load_look, look_of
from siren_ros.sensing.suite import load_suite


def add_plot(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Draws one PNG file with the roads, all paths coloured by speed, the yielding vehicles, the events, three "
        "moments of the interaction, and a timeline of what each vehicle did."
    )
    verb.add_argument("bag", type=Path, metavar="BAG", help="folder of a recorded episode")
    verb.add_argument("--out", type=Path, metavar="FILE.png", required=True, help="picture to write")
    verb.set_defaults(run=plot)


def plot(arguments: argparse.Namespace) -> int:
    """Draws the picture."""
    print(save_episode_picture(read_episode(arguments.bag), arguments.out))
    return EXIT_OK


def add_sense(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Draws the pictures of all cameras of a suite and its point clouds, by height and by instance, into one file. "
        "Suite and look may differ from those of the episode, and the bag may have no sensors."
    )
    verb.add_argument("bag", type=Path, metavar="BAG", help="folder of a recorded episode")
    when = verb.add_mutually_exclusive_group(required=True)
    when.add_argument("--time-s", type=float, metavar="S", help="simulated time")
    add_former(when, "--time", "time_s", type=float)
    verb.add_argument("--sensors", metavar="SUITE", default="full", help="name or file of a suite (default: full)")
    verb.add_argument("--look", metavar="LOOK", help="name or file of a look (default: the episode's)")
    verb.add_argument("--actor", type=int, metavar="ID", help="carrier of the sensors (default: the first EMV)")
    verb.add_argument("--out", type=Path, metavar="FILE", required=True, help="PNG or JPEG file to write")
    verb.set_defaults(run=sense)


def sense(arguments: argparse.Namespace) -> int:
    """Draws what the sensors measure."""
    record = read_episode(arguments.bag)
    episode = record.description
    look = load_look(arguments.look) if arguments.look else load_look(look_of(episode), episode.files)
    seen = observe_at(record, arguments.time_s, load_suite(arguments.sensors), look, arguments.actor)
    print(save_sheet(seen, arguments.out))
    return EXIT_OK


def add_video(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        f"Writes an H.264 MP4 file at {FRAME_RATE_HZ} Hz of simulated time: the episode from above, with "
        "vehicles coloured by what they do, signals and the EMV's mode; the recorded front camera; or a grid of all "
        "cameras and the view from above."
    )
    verb.add_argument("bag", type=Path, metavar="BAG", help="folder of a recorded episode")
    verb.add_argument(
        "--view",
        choices=[view.value for view in View],
        default=View.BIRDSEYE.value,
        help="content (default %(default)s)",
    )
    verb.add_argument("--out", type=Path, metavar="FILE.mp4", required=True, help="video to write")
    verb.add_argument("--frames", type=int, metavar="N", help="number of frames (default: all; paper: 190)")
    verb.add_argument("--start-s", type=float, metavar="S", default=0.0, help="simulated time of the first frame")
    verb.add_argument("--width", type=int, metavar="PX", help="largest width; wider frames are scaled down")
    verb.add_argument(
        "--crf",
        type=int,
        metavar="N",
        default=CRF,
        help=f"quality of H.264, 0 to 51 (default {CRF}: almost no visible loss); six more give about half the bytes",
    )
    verb.set_defaults(run=video)


def video(arguments: argparse.Namespace) -> int:
    """Makes the video."""
    coding = Coding(arguments.width, arguments.crf)
    frames = save_video(arguments.bag, View(arguments.view), arguments.out, arguments.frames, arguments.start_s, coding)
    print(f"{arguments.out}: {frames} frames, {frames / FRAME_RATE_HZ:.1f} s")
    return EXIT_OK
