"""``siren view``, ``plot``, ``sense`` and ``video``: an episode as a page, as pictures, and as a film.

Any browser shows the page without a network; ``siren export html`` writes it, too.
"""

import argparse
import os
import sys
import tempfile
import webbrowser
from importlib.util import find_spec
from pathlib import Path

from siren_ros.cli.command import complain
from siren_ros.cli.options import add_former, check_numbers, names_in
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import EXIT_OK, InputError, write_text, writing
from siren_ros.reports.episode_page.build import page_of_bag
from siren_ros.reports.episode_page.sensed import ALL, MOST_MB, NOTHING, sensed_of
from siren_ros.scoring.pictures.birdseye import save_episode_picture
from siren_ros.scoring.pictures.sensor_views import observe_at, save_sheet
from siren_ros.scoring.pictures.video import CRF, FRAME_RATE_HZ, Coding, View, save_video
from siren_ros.sensing.look import load_look, look_of
from siren_ros.sensing.suite import load_suite


def add_view(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Opens an episode in the browser: the scene in 3-D, a timeline with its events, and what each vehicle does. "
        "The page is a file in the folder for temporary files; siren export html keeps it. With --live, it follows the "
        "episodes that run or are played in the DDS domain, from the present moment on, until Ctrl-C."
    )
    _add_bags(verb, nargs="?")
    verb.add_argument("--live", action="store_true", help="follow running episodes; no BAG")
    verb.add_argument("--port", type=int, metavar="N", help="with --live: port on this machine (default: a free one)")
    verb.add_argument("--time-s", type=float, metavar="S", help="simulated time (default: begin of the interaction)")
    add_former(verb, "--time", "time_s", type=float)
    verb.add_argument("--actor", type=int, metavar="ID", help="vehicle to follow (default: the first EMV)")
    verb.add_argument("--no-browser", action="store_true", help="only print the address of the page")
    verb.set_defaults(run=view)


def view(arguments: argparse.Namespace) -> int:
    """Writes the page and opens it, or becomes the viewer of running episodes."""
    if arguments.live:
        return _follow(arguments)
    if arguments.bag is None:
        raise InputError("bag", "", "a folder of a recorded episode, or --live")
    content = _page_of(arguments)
    path = Path(tempfile.mkdtemp(prefix="siren_view_")) / "episode.html"
    write_text(path, content)
    asked = {"t": arguments.time_s, "v": arguments.actor}
    moment = "&".join(f"{name}={value:g}" for name, value in asked.items() if value is not None)
    address = path.as_uri() + (f"#{moment}" if moment else "")
    print(address)
    if not arguments.no_browser:
        webbrowser.open(address)
    return EXIT_OK


def _follow(arguments: argparse.Namespace) -> int:
    for name in ("bag", "against", "show", "time_s", "actor"):
        if given := getattr(arguments, name):
            raise InputError(name, str(given), "nothing with --live")
    if find_spec("rclpy") is None:
        raise InputError("live", True, "a ROS 2 environment; a recorded episode needs none")
    values = {"browser": str(not arguments.no_browser).lower(), "port": arguments.port or 0}
    flags = [part for name, value in values.items() for part in ("-p", f"{name}:={value}")]
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", "siren_nodes.viewer", "--ros-args", *flags])  # noqa: S606 - our own


def _add_bags(parser: argparse.ArgumentParser, nargs: str | None = None) -> None:
    parser.add_argument("bag", type=Path, nargs=nargs, metavar="BAG", help="folder of a recorded episode")
    parser.add_argument(
        "--against",
        type=Path,
        action="append",
        default=[],
        metavar="BAG",
        help="another episode, next to the first and, on the same map, drawn where it differs; up to three times",
    )
    parser.add_argument(
        "--show",
        default="",
        metavar="NAMES",
        help=f"LiDAR and cameras to show, by commas, such as lidar,camera_front,av/lidar, or {ALL} (default: none)",
    )
    add_former(parser, "--sensors", "show")
    parser.add_argument(
        "--at-most-mb",
        type=float,
        default=MOST_MB,
        metavar="MB",
        help="size by which sensor data may make the page larger; more is thinned in time (default %(default)g)",
    )


def _page_of(arguments: argparse.Namespace) -> str:
    def complain_of(text: str) -> None:
        complain(f"siren {arguments.verb}: {text}")

    check_numbers(arguments, {"at_most_mb": (0.0, 1000.0)})
    sensors = names_in(arguments.show)
    sensed = sensed_of(arguments.bag, sensors, arguments.at_most_mb) if sensors else NOTHING
    for name, note in sensed.notes:
        complain_of(f"{name}: {note}")
    return page_of_bag(arguments.bag, arguments.against, complain_of, sensed)


def add_page(parser: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    parser.description = "Writes an episode as one HTML file: in 3-D, with a timeline and what each vehicle does."
    _add_bags(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.html", help="page to write")
    parser.set_defaults(run=page)


def page(arguments: argparse.Namespace) -> int:
    """Writes the page."""
    out: Path = arguments.out
    if out.suffix.lower() not in {".html", ".htm"}:
        raise InputError("out", str(out), "a file name that ends in .html")
    content = _page_of(arguments)
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, content)
    print(f"{out}: {len(content.encode()) / 1e6:.1f} MB")
    return EXIT_OK


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
