"""Constants of the traffic simulation."""

from dataclasses import dataclass, field

from siren_ros.conflicts.yielding import YieldingConfig
from siren_ros.errors import InputError
from siren_ros.scenario.levels import EmergencyLevel
from siren_ros.scenario.paper_constants import PAPER_CONSTANTS


@dataclass(frozen=True)
class TrafficConfig:
    """How SUMO is run, and how actors change between SUMO and the simulated world."""

    lateral_resolution_m: float = 0.6
    """Width of SUMO's sublanes; rescue corridors need the sublane model."""
    bluelight_levels: frozenset[EmergencyLevel] = frozenset({EmergencyLevel.L3})
    """Levels at which SUMO's own bluelight device runs. At L2 it would push civilians to their lane's side and
    suppress lane changes, which is not what L2 asks for, so the rescue flags are then derived from geometry."""
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
    deferred_speed_factor: float = 1.0
    """Of the speed limit, at least, for a driver who waits for a gap to leave the EMV's lane. Drivers who have left it
    are slower, so that gaps come up in the neighbouring lane."""
    red_light_speed_mps: float = 5.56
    """SUMO's ``jmDriveRedSpeed`` of a privileged EMV (SUMO's default): SUMO's own advice on speed over red."""
    yielding: YieldingConfig = field(default_factory=YieldingConfig)
    """How SUMO's drivers wait for vehicles that are driven from outside."""

    def __post_init__(self) -> None:
        positive = ("lateral_resolution_m", "leader_range_m", "advice_range_m", "jump_m")
        for name in positive:
            if not getattr(self, name) > 0.0:
                raise InputError(name, getattr(self, name), "a number above 0")
        if self.route_edges_ahead < 2:
            raise InputError("route_edges_ahead", self.route_edges_ahead, "a whole number from 2 on")
