"""The console command ``siren``: work on recorded episodes, without ROS."""

from siren_ros.numerics.arithmetic import pin_arithmetic

pin_arithmetic()
