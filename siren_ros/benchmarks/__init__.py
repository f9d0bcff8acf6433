"""Benchmarks: commands that print figures measured on this machine."""

from siren_ros.numerics.arithmetic import pin_arithmetic

pin_arithmetic()
