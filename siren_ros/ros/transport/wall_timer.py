"""Timers by wall time, for work that goes on while simulated time stands still."""

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node


def create_wall_timer(node: Node, period_s: float, callback: Callable[[], None]) -> Any:
    """A timer of a node that runs by the steady clock, whatever ``/clock`` says."""
    return node.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))
