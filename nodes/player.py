"""``player``: publishes a recorded bag again; also ``siren replay BAG``."""

import sys
from functools import partial

from siren_ros.running.ros.programs.bag_player import BagPlayer
from siren_ros.running.ros.programs.program import run_program

NODE = BagPlayer
main = partial(run_program, NODE, "player")

if __name__ == "__main__":
    sys.exit(main())
