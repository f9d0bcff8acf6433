"""Names of the coordinate frames (REP 105) that the vehicles with sensors share."""

from typing import Final

MAP_FRAME: Final = "map"
ODOM_FRAME: Final = "odom"
"""A vehicle's odometry is continuous in this frame, which drifts against ``map``."""
BASE_FRAME: Final = "base_link"
STATION_FRAME: Final = "station"
"""Where a roadside unit stands, on the ground."""
