"""Constants of the traffic demand."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DemandConfig:
    """How vehicles are spread over the network."""

    placement_gap_m: float = 9.0
    """Least gap between a vehicle's front and the rear of the next one at its first placement."""
    neighbourhood_m: float = 150.0
    """Background traffic starts within this of the EMV's way to the site and through it, where there is road enough.
    The volume of the paper's table is that of a district of about 200 m by 200 m, whatever the size of the map."""
    neighbourhood_after_m: float = 250.0
    """How far the EMV's way counts beyond the site."""
    background_spacing_m: float = 40.0
    """Lane length that background traffic needs, per vehicle; with less near the EMV's way the whole map is used."""
    stage_behind_m: float = 25.0
    """Background traffic is kept off this stretch behind the rearmost EMV at the start…"""
    stage_ahead_m: float = 35.0
    """…and off this stretch ahead of the foremost vehicle of the groups."""
    route_slack_s: float = 20.0
    """Routes are this much longer than warm-up and episode take at ``route_speed_mps``."""
    route_speed_mps: float = 16.0
    emv_route_slack_s: float = 5.0
    """The EMV's route is this much longer than the episode takes at its target speed."""
    reserve_factor: float = 4.0
    """Replacement vehicles in reserve, per civilian of the volume."""
    depart_speed_share: float = 0.7
    """Speed at the first placement, as a share of the wished speed."""
    comfortable_decel_mps2: float = 2.5
    """With which a vehicle that has just been placed must be able to stop."""
    spacing_spread: float = 0.15
    """Gaps within a group vary by up to this fraction."""
    speed_spread: float = 0.05
    """Wished speeds within a group vary by up to this fraction."""
    emv_accel_mps2: float = 2.0
    """With which an EMV comes to its target speed, for the time of its unhindered arrival."""
    emv_brake_mps2: float = 3.5
    """With which it brakes before bends, for the same."""
    emv_queue_brake_mps2: float = 2.5
    """With which it can stop behind vehicles that stand ahead of it at its start."""
    emv_queue_gap_m: float = 4.0
    """The gap that it leaves to them."""
    emv_lateral_accel_mps2: float = 3.0
    """With which it drives through bends, for the same."""
    emv_clearance_m: float = 10.0
    """Least gap between the EMV's front and the rear of a vehicle in its lane at the start."""
    turn_weight: float = 0.35
    """Chance of a turn at a junction, per lane that leads there, relative to straight on: about three of four drivers
    go straight on where three lanes lead straight, left and right (typical value of urban turning counts)."""
    emv_turn_weight: float = 0.1
    """The same of an EMV beyond the site: the fastest way to where it is called follows main roads."""
    car_radius_m: float = 5.5
    """No vehicle takes a tighter bend than this where there is another way: the turning circle of cars."""
    long_vehicle_m: float = 8.0
    """Longer vehicles…"""
    long_vehicle_radius_m: float = 12.5
    """…take no bend tighter than this: the centre of a turning lane that a 12 m bus follows without swinging out
    (Directive 97/27/EC: outer turning radius of 12.5 m at most)."""
