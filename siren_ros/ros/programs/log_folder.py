"""The folder of rclpy's log files."""

import os
from pathlib import Path
from typing import Final

from siren_ros.errors import InputError
from siren_ros.user_folder import is_writable, user_folder

LOG_VARIABLE: Final = "ROS_LOG_DIR"


def choose_log_folder() -> None:
    """Choose a folder for rclpy, which does not start without one, unless the user names one.

    rclpy knows ``ROS_LOG_DIR``, ``ROS_HOME`` and the variable ``HOME``, and no other place.

    Raises:
        InputError: The folder that the user names cannot be written.
    """
    for variable, below in ((LOG_VARIABLE, ""), ("ROS_HOME", "log")):
        if named := os.environ.get(variable):
            if not is_writable(Path(named).expanduser() / below):
                raise InputError(variable, named, "a folder that can be written, for ROS's log files")
            return
    os.environ[LOG_VARIABLE] = str(user_folder(".ros/log"))
