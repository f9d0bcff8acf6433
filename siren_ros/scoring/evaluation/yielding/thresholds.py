"""Thresholds of the yield metrics, each with its reason, and the type of a measured value, which may be missing."""

from dataclasses import dataclass
from typing import Self

from siren_ros.base.tables.interval import NONE
from siren_ros.simulation.scenario.paper import PAPER_CONSTANTS


@dataclass(frozen=True)
class YieldThresholds:
    """Limits of the metrics. The defaults are those of all published numbers; others are for studies of the metrics."""

    stop_mps: float = 0.5
    """A vehicle that is slower stands; walking pace is 1.4 m/s."""
    moving_mps: float = 2.0
    """A stop is over when the vehicle is faster: creeping up in a queue is no second stop."""
    encounter_m: float = PAPER_CONSTANTS.region_enter_m
    """Gap between the EMV and a driver ahead at which the encounter begins (paper: interaction region, 40 m)."""
    beside_m: float = 7.0
    """Distance from the EMV's line up to which drivers belong to the encounter: two lanes of 3.5 m."""
    shift_m: float = 0.3
    """Lateral shift that is a response: lane keeping varies by less (standard deviation 0.1 to 0.2 m; J. Verster and
    T. Roth, Int. J. Gen. Med. 4 (2011) 359, on the standard deviation of lateral position)."""
    slowed_mps: float = 1.5
    """Drop of speed that is a response: three seconds of coasting at about 0.5 m/s²."""
    clear_before_m: float = 5.0
    """Gap at which the way has to be clear: one car's length, so that the EMV need not stop."""
    held_gap_m: float = 10.0
    """The driver holds the EMV up while the EMV stands or creeps within this gap behind it."""
    beyond_m: float = 15.0
    """Length of the EMV's strip beyond the end of its record: a driver ahead of it there is in its way."""
    recovered_share: float = 0.8
    """Share of the speed before the encounter at which a driver has recovered."""
    recovered_offset_m: float = 0.5
    """Distance from the lane's centre line at which a driver is back in the lane."""
    look_ahead_m: float = 30.0
    """Length of the corridor that is measured: the way of 2 s at 50 km/h."""
    corridor_margin_m: float = 0.2
    """Free space that the EMV needs on each side: the least margin of its own gap search."""


@dataclass(frozen=True)
class Measure:
    """A number of an episode. Where nothing could be measured ``value`` is 0, means nothing, and ``lack`` says why."""

    value: float
    lack: str = ""
    at_least: bool = False
    """Whether the episode ended before the value was complete: it is a lower bound."""

    @property
    def valid(self) -> bool:
        """Whether there is a value."""
        return not self.lack

    @property
    def text(self) -> str:
        """For a table: the value, ``at least`` before a lower bound, and the reason where there is none."""
        return f"{'at least ' * self.at_least}{self.value:.2f}" if self.valid else f"{NONE} ({self.lack})"

    @classmethod
    def lacking(cls, reason: str) -> Self:
        """No value."""
        return cls(0.0, reason)
