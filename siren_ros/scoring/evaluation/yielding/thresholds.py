"""Thresholds of the yield metrics with their reasons."""

from dataclasses import dataclass

from siren_ros.simulation.scenario.paper import PAPER_CONSTANTS


@dataclass(frozen=True)
class YieldThresholds:
    """Thresholds of the metrics.

    All published numbers use the defaults; other values are for studies of the metrics.
    """

    stop_mps: float = 0.5
    """A slower vehicle counts as standing; walking pace is 1.4 m/s."""
    moving_mps: float = 2.0
    """A stop ends above this speed: slow motion in a queue does not begin a second stop."""
    encounter_m: float = PAPER_CONSTANTS.region_enter_m
    """Gap between the EMV and a driver ahead at which the encounter begins (paper: interaction region, 40 m)."""
    beside_m: float = 7.0
    """Largest distance of a driver from the EMV's line in an encounter: two lanes of 3.5 m."""
    shift_m: float = 0.3
    """Lateral shift that counts as a response. Lane keeping varies by less (standard deviation 0.1 to 0.2 m; J. Verster
    and T. Roth, Int. J. Gen. Med. 4 (2011) 359, on the standard deviation of lateral position)."""
    slowed_mps: float = 1.5
    """Drop of speed that counts as a response: three seconds of coasting at about 0.5 m/s²."""
    clear_before_m: float = 5.0
    """Gap at which the way must be clear: one car's length, so that the EMV need not stop."""
    held_gap_m: float = 10.0
    """The driver delays the EMV if the EMV stands or drives very slowly within this gap behind it."""
    beyond_m: float = 15.0
    """Length of the EMV's strip beyond the end of its record; a driver there is in its way."""
    recovered_share: float = 0.8
    """A driver has recovered at this share of its speed before the encounter."""
    recovered_offset_m: float = 0.5
    """A driver within this distance of the lane's centre line is back in the lane."""
    look_ahead_m: float = 30.0
    """Length of the measured corridor: the distance of 2 s at 50 km/h."""
    corridor_margin_m: float = 0.2
    """Free space that the EMV needs on each side: the smallest margin of its own gap search."""
