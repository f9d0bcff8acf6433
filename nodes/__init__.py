"""The ROS 2 nodes, one per file: read the parameters, convert in, call the library, convert out."""

from siren_ros.numerics.arithmetic import pin_arithmetic

pin_arithmetic()
