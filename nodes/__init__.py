"""The ROS 2 nodes, one per file: read the parameters, convert in, call the library, convert out."""

import sys
from importlib.util import find_spec

from siren_ros.errors import EXIT_BAD_INPUT, InputError
from siren_ros.running.ros.transport.dds import check_room

if find_spec("rclpy") is None:
    sys.stderr.write("ROS 2 is missing (rclpy): nodes need it. `siren episode` makes an episode without it\n")
    sys.exit(EXIT_BAD_INPUT)
try:
    check_room()  # before rclpy is loaded
except InputError as error:
    sys.stderr.write(f"{error}\n")
    sys.exit(error.exit_code)
