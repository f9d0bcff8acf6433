"""Scenario templates: what is set up, how it may vary, and which predicate tells that it happened.

The interaction region moves with the EMV: it has the vehicles that the paper's CARLA controls.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Ids
from siren_ros.base.numerics.compiled import compiled
from siren_ros.errors import InputError
from siren_ros.simulation.roads.sites import SiteKind
from siren_ros.simulation.scenario.driver_parameters import DRIVER_PARAMETERS
from siren_ros.simulation.scenario.paper import PAPER_CONSTANTS, EmergencyLevel
from siren_ros.simulation.world.actors import ActorClass, ActorStates, rows_of_ids


class BehaviourFamily(StrEnum):
    """The paper's families of templates (table of templates)."""

    CLEARANCE = "clearance"
    TRAFFIC_CONTROL = "traffic_control"
    ROAD_SPACE = "road_space"


class StartReference(StrEnum):
    """The point from which the EMV's start is counted in driving direction; before it the distance is negative."""

    SITE_START = "site_start"
    """The start is counted from the beginning of the site's edge."""
    STOP_LINE = "stop_line"
    """The start is counted from the end of the site's edge; only for sites at a junction."""


class GroupAnchor(StrEnum):
    """The point from which the first gap of a group is counted."""

    EMV = "emv"
    """The gap is counted forwards from the EMV's front."""
    STOP_LINE = "stop_line"
    """The gap is counted backwards from the stop line of the group's lane."""
    ARRIVAL = "arrival"
    """The gap is counted forwards from the place from which a vehicle at the group's speed reaches the stop line
    together with the EMV."""


class Placement(StrEnum):
    """The lanes in which a group of civilians starts, relative to the EMV's approach."""

    EMV_LANE = "emv_lane"
    """The group starts in the EMV's lane ahead of it, along its route."""
    ADJACENT_LANE = "adjacent_lane"
    """The group starts in a neighbouring lane of the EMV's: one with the EMV's movement, otherwise the left one."""
    OTHER_LANES = "other_lanes"
    """The group's vehicles are spread in turn over all other driving lanes of the EMV's approach."""
    TURNING_LANES = "turning_lanes"
    """The group's vehicles are spread in turn over those driving lanes of the EMV's approach that do not have its
    movement."""
    SAME_DIRECTION = "same_direction"
    """The group's vehicles are spread in turn over the other lanes with the EMV's movement at the site's junction.
    Where there are none, they start in the EMV's own lane, unless the group is optional."""
    CROSSING = "crossing"
    """The group's vehicles are spread in turn over the lanes whose paths cross the EMV's at the site's junction."""
    EVERY_LANE = "every_lane"
    """Each driving lane of the EMV's road gets the group's number of vehicles. They come on top of the background
    volume."""


@dataclass(frozen=True)
class ValueRange:
    """Limits between which a scenario parameter is drawn, both included."""

    minimum: float
    maximum: float
    integer: bool = False


@dataclass(frozen=True)
class EmvDemand:
    """The emergency vehicle of a template."""

    actor_class: ActorClass
    count: int
    """Number of EMVs on one route, one behind the other."""
    start_m: float
    """Distance of the foremost EMV's front bumper from ``start_from``; negative before it."""
    speed_mps: float
    """Target speed in route following (paper, table of target speeds: 50 km/h)."""
    depart_speed_mps: float
    headway_s: float
    """Time between two EMVs on the same route; it has no effect with one EMV."""
    start_from: StartReference = StartReference.SITE_START
    crossing: int = 0
    """Number of further EMVs from a side street of the site's junction, or of the first junction behind its road."""
    crossing_after_s: float = 0.0
    """Time from the first EMV's unhindered arrival at that junction to the arrival of these EMVs; without them it has
    no effect."""


@dataclass(frozen=True)
class SignalDemand:
    """When the EMV arrives within the programme of the signal at the site's junction or at the end of its road."""

    red_before_arrival_s: float
    """Time from the beginning of the red of the EMV's movement to the EMV's unhindered arrival at the stop line;
    negative where the red comes after it."""


@dataclass(frozen=True)
class JamDemand:
    """How the foremost vehicles of the groups are held up in every lane: they roll, stand, and may roll on in turn."""

    moves: int
    """Whether the vehicles go on after their first stop: 0 or 1."""
    roll_s: float
    roll_mps: float
    stand_s: float


@dataclass(frozen=True)
class DemandGroup:
    """Civilians that start in a row. They count in the background volume."""

    name: str
    placement: Placement
    vehicles: int
    first_gap_m: float
    """Distance from the anchor to the nearer bumper of the first vehicle."""
    spacing_m: float
    """Mean gap between one vehicle's front and the next one's rear."""
    speed_mps: float
    """Speed at the start, unless the vehicles stand. Later they wish for the same speeds as other drivers."""
    anchor: GroupAnchor = GroupAnchor.EMV
    standing: bool = False
    """Whether the vehicles form a standing queue at the start."""
    optional: bool = False
    """Whether the interaction can happen without the group. Such a group is left out where it has no lane or no
    road."""


@dataclass(frozen=True)
class PeopleDemand:
    """Numbers of pedestrians, cyclists and motorcycles within 150 m of the EMV's way.

    They do not count in the background volume.
    """

    pedestrians: int = 0
    cyclists: int = 0
    motorcycles: int = 0


PEOPLE: Final = tuple(f"demand.people.{part.name}" for part in fields(PeopleDemand))
"""Paths of these parameters, which every template has."""


@dataclass(frozen=True)
class VarietyDemand:
    """How much scenes vary, so that models cannot learn them by heart.

    With 0 everything is as in the paper's episodes.
    """

    size_spread: float = 0.0
    """Largest share by which lengths, widths and heights of vehicles differ from those of their class, by seed."""
    parked_share: float = 0.0
    """Share of the places along the carriageway at which a vehicle is parked, outside the space of traffic."""
    clutter_per_100_m: float = 0.0
    """Number of bins, benches, boxes, cabinets and similar objects on 100 m of the carriageway's edge."""
    colour_share: float = 0.0
    """How strongly LiDAR reflectivity of paint, walls and sheet metal follows their colour, 0 to 1."""


VARIETY: Final = tuple(f"demand.variety.{part.name}" for part in fields(VarietyDemand))
"""Paths of these parameters, which every template has, and which a record has where they are not 0."""
DRAWN_BY_NAME: Final = frozenset({"duration_s", "emv.count", "emv.crossing", "emv.crossing_after_s", *PEOPLE, *VARIETY})
"""Parameters that are drawn only where a study names them: length of an episode, numbers of EMVs and people,
variety."""


@dataclass(frozen=True)
class Demand:
    """Civilian traffic of a template."""

    background_vehicles: int
    """Civilians near the EMV's way, groups included (paper, table of templates: N_veh)."""
    speed_limit_mps: float
    """Highest speed limit of the map's roads; higher ones are lowered to it."""
    speed_factor: float
    """Factor on the speed that drivers wish for, relative to the speed limit."""
    classes: tuple[tuple[ActorClass, float], ...]
    """Share of each vehicle class; the shares add up to 1."""
    groups: tuple[DemandGroup, ...]
    district_per_lane_km: float = 0.0
    """Number of further civilians per kilometre of lane in the streets around those of the background volume."""
    people: PeopleDemand = field(default_factory=PeopleDemand)
    variety: VarietyDemand = field(default_factory=VarietyDemand)


@dataclass(frozen=True)
class CivilianResponseDemand:
    """How a template changes the civilians' response that the preset gives (``DriverPreset.for_scenario``)."""

    response_distance_m: float
    extra_delay_s: float
    """Time that is added to each driver's reaction delay."""
    compliance: float
    """Factor on the shares of drivers who comply."""
    duty: int = 0
    """Whether drivers open a rescue lane in slow traffic out of town before they hear a siren: 0 or 1."""


@dataclass(frozen=True)
class PredicateDemand:
    """The predicate that decides whether the interaction happened, with its thresholds."""

    name: str
    thresholds: Mapping[str, float]


@dataclass(frozen=True)
class Template:
    """A scenario with a value for each parameter."""

    template_id: str
    title: str
    family: BehaviourFamily
    level: EmergencyLevel
    site_kind: SiteKind
    duration_s: float
    warm_up_s: float
    """Time for which traffic runs before step 0, so that it has settled."""
    emv: EmvDemand
    demand: Demand
    response: CivilianResponseDemand
    predicate: PredicateDemand
    signal: SignalDemand | None = None
    """When the EMV arrives at the signal; None where the signals run as they are."""
    jam: JamDemand | None = None
    """What holds up the groups; None where only traffic holds vehicles up."""
    map_name: str = ""
    """The built-in map on which the scenario happens where nobody names a map; empty means the town."""
    shoulders_in_use: bool = False
    """Whether the map's shoulders are closed to all drivers, as where vehicles park there."""
    spaces: tuple[str, ...] = ()
    """Space beside the right lane that the EMV may drive on, the best first; empty where the template needs none."""
    drivers: Mapping[str, float] = field(default_factory=dict)
    """Parameters of drivers that differ from the preset's, by their names in ``DRIVER_PARAMETERS``."""
    ranges: Mapping[str, ValueRange] = field(default_factory=dict)
    """Range of each scenario parameter by its dotted path: ``emv.speed_mps``, ``demand.platoon.vehicles``."""
    drawn: Mapping[str, ValueRange] = field(default_factory=dict)
    """The parameters that every seed draws anew, with the part of their range that it draws from."""

    def value(self, path: str) -> float:
        """Present value of a scenario parameter; KeyError for an unknown path."""
        if path in self.drivers:
            return self.drivers[path]
        owner, name = self._owner(path)
        return float(getattr(owner, name))

    def values(self) -> dict[str, float]:
        """Present values of all scenario parameters, and of those of drivers that were set."""
        return {path: self.value(path) for path in (*self.ranges, *sorted(self.drivers.keys() - self.ranges))}

    def recorded_values(self) -> dict[str, float]:
        """The values as a record has them. Variety of 0 is left out, so that records without variety stay the same."""
        return {path: value for path, value in self.values().items() if value or path not in VARIETY}

    @property
    def lasting_s(self) -> float:
        """Duration of the episode; with several EMVs, until the last one has had as long as the first one."""
        return self.duration_s + (self.emv.count - 1) * self.emv.headway_s

    def with_values(self, values: Mapping[str, float]) -> "Template":
        """The template with some values replaced, of its own parameters or of drivers'.

        Raises:
            InputError: an unknown parameter, or a value outside its range.
        """
        changed = self
        for path, value in values.items():
            limits = self.range_of(path, value)
            if not limits.minimum <= value <= limits.maximum or (limits.integer and value != round(value)):
                kind = "a whole number" if limits.integer else "a number"
                raise InputError(path, value, f"{kind} from {limits.minimum:g} to {limits.maximum:g}")
            if path in DRIVER_PARAMETERS:
                changed = replace(changed, drivers={**changed.drivers, path: value})
            else:
                changed = _replaced(changed, path.split("."), round(value) if limits.integer else value)
        return changed

    def range_of(self, path: str, value: object) -> ValueRange:
        """Range of a parameter of the scenario or of drivers; InputError with the value for an unknown one."""
        if path in self.ranges:
            return self.ranges[path]
        known = DRIVER_PARAMETERS.get(path)
        if known is None:
            of_drivers = ", ".join(DRIVER_PARAMETERS)
            raise InputError(path, value, f"one of {', '.join(self.ranges)}, or of drivers {of_drivers}")
        return ValueRange(known.minimum, known.maximum)

    def _owner(self, path: str) -> tuple[Any, str]:
        parts = path.split(".")
        owner: Any = self
        for part in parts[:-1]:
            groups = {group.name: group for group in owner.groups} if isinstance(owner, Demand) else {}
            owner = groups[part] if part in groups else getattr(owner, part)
        return owner, parts[-1]


def _replaced(section: Any, path: list[str], value: float) -> Any:
    """A copy of a nested section in which the value at a path is replaced. Groups are found by their names."""
    if not path:
        return value
    head, *rest = path
    if isinstance(section, Demand) and head in {group.name for group in section.groups}:
        groups = tuple(_replaced(group, rest, value) if group.name == head else group for group in section.groups)
        return replace(section, groups=groups)
    return replace(section, **{head: _replaced(getattr(section, head), rest, value)})


def realised(template: Template, rng: np.random.Generator) -> Template:
    """The template as one seed sets it up: every parameter with a ``draw`` range gets a drawn value."""
    return template.with_values(_uniform(template.drawn, rng))


def draw_values(template: Template, rng: np.random.Generator) -> dict[str, float]:
    """One draw of every scenario parameter, uniform over its range, in the order of the template's ranges."""
    return _uniform(template.ranges, rng)


def _uniform(ranges: Mapping[str, ValueRange], rng: np.random.Generator) -> dict[str, float]:
    return {
        path: float(rng.integers(round(limits.minimum), round(limits.maximum), endpoint=True))
        if limits.integer
        else float(rng.uniform(limits.minimum, limits.maximum))
        for path, limits in ranges.items()
    }


@dataclass(frozen=True)
class PredicateDeclaration:
    """A predicate by its name, as templates and records use it. ``siren_ros.scoring.judging`` evaluates it."""

    name: str
    thresholds: Mapping[str, tuple[float, float]]
    """Smallest and largest value that a template may give each threshold."""
    needs: EmergencyLevel = EmergencyLevel.L1
    """Least level at which the cause of the interaction exists; below it the predicate must not hold."""


STANDS_MAX: Final = "standstill_max_s"
"""Threshold that every template may set: the longest time for which the EMV may stand."""
STANDS_MAX_S: Final = 15.0
"""The same where the template does not: five times the standstill after which an EMV seeks a way round (paper: 3 s)."""
_SPEED_MIN: Final = {"speed_min_mps": (0.1, 20.0)}

RESCUE_LANE: Final = PredicateDeclaration(
    "rescue_lane",
    {
        "open_share_min": (0.0, 1.0),
        "ahead_m": (20.0, 300.0),
        "side_m": (0.0, 1.0),
        "through_min_m": (50.0, 2000.0),
        "speed_min_mps": (0.1, 20.0),
    },
    EmergencyLevel.L3,
)
QUEUES_SPLIT: Final = PredicateDeclaration(
    "queues_split", {"holding_min": (1, 50), "overtaken_min": (1, 50), "lateral_max_m": (0.1, 5.0)}, EmergencyLevel.L3
)
LANE_CLEARED: Final = PredicateDeclaration(
    "lane_cleared", {"lane_changes_min": (1, 50), "passed_min": (1, 50)}, EmergencyLevel.L2
)
RED_SAME_DIRECTION: Final = PredicateDeclaration("red_same_direction", {})
RED_CROSSING: Final = PredicateDeclaration("red_crossing", {})
STOP_SAME_DIRECTION: Final = PredicateDeclaration("stop_same_direction", _SPEED_MIN)
STOP_CROSSING: Final = PredicateDeclaration("stop_crossing", _SPEED_MIN)
SHOULDER_TURN: Final = PredicateDeclaration("shoulder_turn", {"shoulder_min_s": (0.1, 60.0)})

DECLARED_PREDICATES: Final[dict[str, PredicateDeclaration]] = {
    declared.name: declared
    for declared in (
        *(QUEUES_SPLIT, LANE_CLEARED, RED_SAME_DIRECTION, RED_CROSSING),
        *(STOP_SAME_DIRECTION, STOP_CROSSING, SHOULDER_TURN, RESCUE_LANE),
    )
}
"""The declared predicates by name."""


REGION_TEXT: Final = f"{PAPER_CONSTANTS.region_enter_m:g} m in, {PAPER_CONSTANTS.region_leave_m:g} m out"
"""The text by which help and reports name the region."""


@compiled
def in_region(distance_m: Any, was_inside: Any, enter_m: float, leave_m: float) -> Any:
    """Whether vehicles are in the region after a step (paper, table of thresholds: hysteresis, EMV-centred).

    ``distance_m`` is between the centres of a vehicle and of the nearest EMV; ``was_inside`` is of the step before.
    """
    return (distance_m < enter_m) | (was_inside & (distance_m <= leave_m))


def region_members(before: Ids, states: ActorStates, emv_ids: Iterable[int]) -> Ids:
    """Sorted ids of the vehicles in the region after a step: those that ``in_region`` names, and the EMVs.

    ``before`` are the members at the step before, sorted. Without an EMV the region is empty.
    """
    is_emv = (states.actor_id[:, None] == np.fromiter(emv_ids, dtype=np.uint32)).any(axis=1)
    if not is_emv.any():
        return np.empty(0, dtype=np.uint32)
    xy = np.stack((states.x_m, states.y_m), axis=-1)
    distance = np.hypot(*(xy[:, None] - xy[is_emv]).transpose(2, 0, 1)).min(axis=1)
    was_inside = rows_of_ids(before, states.actor_id) >= 0
    inside = in_region(distance, was_inside, PAPER_CONSTANTS.region_enter_m, PAPER_CONSTANTS.region_leave_m)
    return states.actor_id[inside | is_emv]
