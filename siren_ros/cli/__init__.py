"""The console command ``siren``: everything that is done with recorded episodes, without ROS."""

from siren_ros.numerics.arithmetic import pin_arithmetic

pin_arithmetic()
