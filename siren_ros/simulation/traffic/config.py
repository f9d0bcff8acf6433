"""Constants of the traffic demand and of the traffic simulation."""

from dataclasses import dataclass, field

from siren_ros.errors import InputError
from siren_ros.simulation.conflicts.yielding import YieldingConfig
from siren_ros.simulation.roads.sites import TOWN_LIMIT_MPS
from siren_ros.simulation.scenario.paper import PAPER_CONSTANTS


@dataclass(frozen=True)
class DemandConfig:
    """How vehicles are spread over the network."""

    placement_gap_m: float = 9.0
    """Least gap between a vehicle's front and the rear of the next one at its first placement."""
    fast_gap_s: float = 2.0
    """On roads out of town the same gap is at least this time at the limit: nobody can be put right before another."""
    neighbourhood_m: float = 150.0
    """Background traffic starts within this of the EMV's way to the site and through it, where there is road enough.
    The volume of the paper's table is that of a district of about 200 m by 200 m, whatever the size of the map."""
    district_m: float = 300.0
    """The streets around them, to this distance from that way, have the density of ``demand.district_per_lane_km``."""
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
    lasting_share: float = 0.5
    """Part of a route within which it leaves the map only where there is no other way: what is driven at 30 km/h. Who
    leaves the map earlier is gone before the EMV's eyes."""
    emv_route_slack_s: float = 5.0
    """The EMV's route is this much longer than the episode takes at its target speed."""
    reserve_factor: float = 4.0
    """Replacement vehicles in reserve, per civilian of the volume."""
    people_reserve_factor: float = 10.0
    """Pedestrians and riders in reserve, per one that is kept near the EMV: they start along its whole way."""
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

    def gap_m(self, limit_mps: float) -> float:
        """Least gap before and behind a vehicle that is put on a lane with a speed limit."""
        fast_m = self.fast_gap_s * limit_mps if limit_mps > TOWN_LIMIT_MPS else 0.0
        return max(self.placement_gap_m, fast_m)


@dataclass(frozen=True)
class CautionConfig:
    """How SUMO's drivers wait for vehicles that are driven from outside."""

    yielding: YieldingConfig = field(default_factory=lambda: YieldingConfig(after_s=1.0))
    """Margins to vehicles that are driven from outside: behind an EMV, too, nobody passes in less than a second."""
    among: YieldingConfig = field(default_factory=lambda: YieldingConfig(before_s=0.0, after_s=0.2, standoff_m=1.3))
    """Among themselves SUMO's drivers keep its own margins; only contact is avoided. The tail of a bus cuts a tight
    bend by 1.24 m, which its way along its lane does not show: who waits keeps this distance from it."""
    margin_m: float = 0.2
    """Added to each side of a vehicle that is driven from outside."""
    ahead_s: float = 4.0
    """How far ahead the ways are looked at, at the present speeds…"""
    more_m: float = 12.0
    """…with this much more…"""
    far_m: float = 70.0
    """…and this much at most."""
    accel_mps2: float = 2.0
    """Acceleration of SUMO's drivers."""
    rolling_mps: float = 0.3
    """Slower vehicles stand."""
    beside_m: float = 3.0
    """Distance beside the own middle within which bodies ahead count."""
    behind_m: float = 0.3
    """Distance kept at least from a body ahead; SUMO's own is larger."""
    firm_mps2: float = 2.5
    """SUMO's drivers brake by themselves until more than this is needed."""
    gentle_mps2: float = 0.5
    """A driver who brakes for a body ahead goes on braking while more than this is needed."""
    slowing_mps2: float = -0.3
    """A driver who brakes harder is taken to go on braking."""
    most_brake_mps2: float = 8.0
    """An emergency brake on a dry road."""


@dataclass(frozen=True)
class TrafficConfig:
    """How SUMO is run, and how actors change between SUMO and the simulated world."""

    lateral_resolution_m: float = 0.6
    """Width of SUMO's sublanes; rescue corridors need the sublane model."""
    leader_range_m: float = PAPER_CONSTANTS.leader_query_m
    """How far ahead SUMO is asked for the EMV's leader."""
    advice_range_m: float = 80.0
    """Lane-change intent of civilians is read within this distance of an EMV."""
    still_m: float = 0.01
    """A mirrored pose that moved less than this is held, because SUMO may snap to another lane on creeping back."""
    placed_m: float = 0.05
    """A mirrored actor has to stand within this of where it was put."""
    realign_m: float = 1.5
    """A simulated vehicle farther than this from its pose in SUMO cannot follow: SUMO's is brought back to it."""
    realign_standing_m: float = 0.4
    """The same where both stand: the simulated vehicle came to a stop later and will not make up for it."""
    jump_m: float = 1.0
    """A vehicle that moves further than its speed explains by more than this has been teleported."""
    route_edges_ahead: int = 6
    replacement_gap_m: float = 15.0
    """Free space ahead of and behind a vehicle that replaces another one."""
    replacement_distance_m: float = 90.0
    """A replacement enters at least this far from every EMV, beyond the interaction region and the camera's care."""
    people_within_m: float = 180.0
    """Pedestrians, cyclists and motorcyclists that the demand asks for are within this of an EMV or the AV under test:
    beyond the distances at which sensors tell them apart…"""
    people_margin_m: float = 15.0
    """…they enter nearer than that by this much, so that they stay for a while."""
    deferred_speed_factor: float = 1.2
    """Of the speed limit, at least, for a driver who waits for a gap to leave the EMV's lane."""
    cleared_speed_share: float = 0.7
    """Share of the wished speed of a driver who has left it: so gaps come up for those who still have to leave it."""
    red_light_speed_mps: float = 5.56
    """SUMO's ``jmDriveRedSpeed`` of a privileged EMV (SUMO's default): SUMO's own advice on speed over red."""
    caution: CautionConfig = field(default_factory=CautionConfig)
    """How SUMO's drivers wait for vehicles that are driven from outside."""

    def __post_init__(self) -> None:
        for name in ("lateral_resolution_m", "leader_range_m", "advice_range_m", "jump_m"):
            if not getattr(self, name) > 0.0:
                raise InputError(name, getattr(self, name), "a number above 0")
        if self.route_edges_ahead < 2:
            raise InputError("route_edges_ahead", self.route_edges_ahead, "a whole number from 2 on")
