"""``python -m small_ros2``: the same as the ``ros2`` that the environment installs."""

import sys

from small_ros2.main import main

sys.exit(main(sys.argv[1:]))
