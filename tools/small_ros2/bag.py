"""``ros2 bag info`` and ``ros2 bag play``: the arguments; the work is in bag_info.py and bag_play.py."""

import argparse
import importlib

from small_ros2.arguments import not_negative, positive

DELAY_S = 0.5
CLOCK_HZ = 40.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the verbs."""
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    info = verbs.add_parser("info", help="print what a bag holds")
    info.add_argument("bag", help="folder of the bag, or one storage file")
    info.set_defaults(main=lambda arguments: importlib.import_module("small_ros2.bag_info").info(arguments))

    play = verbs.add_parser("play", help="publish a bag's messages at the times they were recorded")
    play.add_argument("bag", help="folder of the bag, or one storage file")
    play.add_argument("-r", "--rate", type=positive, default=1.0, help="speed relative to the recording (1)")
    play.add_argument("--start-offset", type=not_negative, default=0.0, metavar="S", help="s into the bag (0)")
    play.add_argument("-l", "--loop", action="store_true", help="start again at the end")
    play.add_argument("--topics", nargs="+", metavar="TOPIC", help="only these topics")
    play.add_argument(
        "--clock",
        type=positive,
        nargs="?",
        const=CLOCK_HZ,
        metavar="HZ",
        help=f"publish /clock at this rate ({CLOCK_HZ:.0f}), instead of a recorded one",
    )
    play.add_argument(
        "-d", "--delay", type=not_negative, default=DELAY_S, metavar="S", help=f"s before it starts ({DELAY_S})"
    )
    play.set_defaults(main=lambda arguments: importlib.import_module("small_ros2.bag_play").play(arguments))
