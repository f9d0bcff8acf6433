"""Benchmarks: commands that print figures of this machine."""

from siren_ros.numerics.arithmetic import pin_arithmetic

pin_arithmetic()
