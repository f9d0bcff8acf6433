"""A traffic plan: every vehicle of an episode, decided before SUMO starts."""

from dataclasses import dataclass

from siren_ros.traffic.demand.driver_models import DriverModel
from siren_ros.world.actors import ActorClass


@dataclass(frozen=True)
class Spot:
    """A place on a lane: where a vehicle's front bumper is put, and how fast it goes there."""

    lane: int
    """Index into ``RoadNetwork.lanes``."""
    front_m: float
    """Along the lane's centre line."""
    speed_mps: float


@dataclass(frozen=True)
class PlannedVehicle:
    """One vehicle: body, driver, route and place of entry."""

    name: str
    actor_class: ActorClass
    length_m: float
    width_m: float
    height_m: float
    colour_rgb: tuple[int, int, int]
    driver: DriverModel
    route: tuple[str, ...]
    """Edge ids; the first is the spot's edge."""
    spot: Spot
    is_emv: bool = False
    attentive: bool = True
    """Whether the driver sees an EMV that comes across against a signal or sign."""


@dataclass(frozen=True)
class LaneInterval:
    """A stretch of a lane, from and to in metres along its centre line."""

    lane: int
    from_m: float
    to_m: float


@dataclass(frozen=True)
class SignalTiming:
    """Where in its programme a signal is at the episode's start."""

    signal_id: str
    link: int
    """Index into the signal's state string."""
    red_from_s: float
    """Time from step 0 on at which the link's red begins; negative where it is red already."""
    crossing: tuple[int, ...] = ()
    """Links of the movements that are to cross during this red. Where their green begins later, that counts."""
    platoon: tuple[str, ...] = ()
    """Vehicles for which the green lasts: it ends when a detector has seen the last of them (gap-out control)."""


@dataclass(frozen=True)
class TrafficPlan:
    """All vehicles of an episode, in the order in which they enter."""

    emvs: tuple[PlannedVehicle, ...]
    groups: tuple[PlannedVehicle, ...]
    """Civilians placed around the EMV's start; with the EMVs they enter at step 0."""
    background: tuple[PlannedVehicle, ...]
    """Civilians that enter before the warm-up."""
    reserve: tuple[PlannedVehicle, ...]
    """Take the places of vehicles that leave, in this order where their spots are free."""
    stage: tuple[LaneInterval, ...]
    """Where EMVs and groups start; cleared of background vehicles at step 0."""
    civilians: int
    """Number of civilians to keep in the network."""
    warm_up_steps: int
    response_distance_m: float
    """Reach of the siren in SUMO's bluelight device."""
    signal: SignalTiming | None = None
    """None where all signals run as the map says."""
    av: str = ""
    """Name of the civilian that an external controller drives; empty for none. It has the first id after the EMVs'."""
