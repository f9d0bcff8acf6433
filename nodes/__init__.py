"""The ROS 2 nodes, one per file: read the parameters, convert in, call the library, convert out."""

import sys

from siren_ros.errors import InputError
from siren_ros.ros.transport.shared_memory import check_room

try:
    check_room()  # before rclpy is loaded
except InputError as error:
    sys.stderr.write(f"{error}\n")
    sys.exit(error.exit_code)
