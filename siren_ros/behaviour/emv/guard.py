"""A guard of the EMV's control (paper, Algorithm 1): one of the steps that are evaluated from top to bottom."""

from collections.abc import Callable
from typing import TypeAlias

from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.emv.unit import EmvUnit
from siren_ros.world.events import Event

Outcome: TypeAlias = tuple[EmvUnit, tuple[Event, ...]]
"""The EMV after a guard, and what the guard has to report."""
Guard: TypeAlias = Callable[[EmvUnit, StepView, int], Outcome]
"""Takes the EMV's latched state, the step and the EMV's row."""
