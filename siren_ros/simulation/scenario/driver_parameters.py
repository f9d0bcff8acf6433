"""Parameters of drivers that users can set: by dotted names in presets, templates and ``values``, each default once."""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Final

from siren_ros.base.params.parameters import parameter
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.paper import PAPER_SPEEDS, TargetSpeeds


def number(default: float | None, low: float, high: float, meaning: str) -> Any:
    """Declares a parameter of drivers with its default, its range and its meaning.

    None stands for what the meaning says.
    """
    return parameter(default, meaning, minimum=low, maximum=high)


def _falling(owner: object, *names: str) -> None:
    """Refuses margins that do not decrease in the order of their names."""
    for wider, narrower in pairwise(names):
        if not getattr(owner, wider) > getattr(owner, narrower):
            raise InputError(narrower, getattr(owner, narrower), f"less than {wider}, {getattr(owner, wider):g}")


@dataclass(frozen=True)
class NavigatorConfig:
    """How the waypoint navigator tracks a path, keeps a speed and watches for others."""

    lateral_accel_mps2: float = number(3.0, 1, 5, "lateral acceleration in bends")
    """The comfort limit of urban driving."""
    comfort_brake_mps2: float = number(3.0, 1, 8, "deceleration towards other vehicles")
    path_brake_mps2: float = number(3.0, 0.5, 5, "deceleration before bends and stops")
    comfort_accel_mps2: float = number(2.5, 0.8, 4, "acceleration")
    ease_off_mps2: float = number(
        1.5, 0.3, 4, "deceleration towards a lower target speed, where nothing else asks for more"
    )
    standstill_gap_m: float = number(2.0, 0.5, 10, "standing distance to the vehicle ahead")
    headway_s: float = number(0.8, 0.2, 3, "time kept to the vehicle ahead")
    reaction_s: float = number(0.5, 0.1, 2, "time ahead at which the speed limit of the path is looked up")
    """It covers the delay of the speed loop."""
    side_margin_m: float = number(0.25, 0.05, 1, "free space on each side of the swept path")
    own_accel_mps2: float = number(1.5, 0.5, 4, "acceleration that the driver counts with on the way to a conflict")
    path_creep_mps: float = number(1.5, 0.5, 5, "speed at which any path may be steered")


@dataclass(frozen=True)
class ConflictConfig:
    """Margins where the ways of others meet the path."""

    before_s: float = number(1.0, 0, 5, "time that a driver who goes first leaves before the other one comes")
    """Post-encroachment time; conflicts below it are counted as serious (Allen, Shin and Cooper 1978)."""
    after_s: float | None = number(0.4, 0, 5, "time behind the other one; none: the preset's `emv_pet_s`")
    merge_s: float = number(1.5, 0.3, 5, "headway with which a driver merges ahead of another one")
    commit_mps2: float = number(3.0, 1, 8, "deceleration above which others are expected to go on")
    brake_mps2: float = number(2.0, 0.5, 6, "deceleration that a waiting driver plans with")
    early_mps2: float = number(1.0, 0, 4, "acceleration that others may have on the way to the conflict")
    standoff_m: float = number(1.0, 0, 5, "distance that a waiting vehicle keeps from the way of the other one")
    room_m: float = number(0.0, 0, 10, "more of it where that takes no hard braking")
    """A vehicle at this distance is not in the way before the other one has gone."""


@dataclass(frozen=True)
class LaneChangeConfig:
    """Geometry and gap acceptance of forced lane changes."""

    duration_s: float = number(2.5, 1, 8, "length of the change over the speed at its start")
    length_min_m: float = number(14.0, 5, 40, "least length of the change")
    front_gap_m: float = number(2.0, 0.5, 10, "free way to the vehicle ahead at equal speeds")
    front_time_s: float = number(0.3, 0, 3, "time before one brakes for the vehicle ahead")
    rear_gap_m: float = number(2.0, 0.5, 10, "free way to the vehicle behind at equal speeds")
    rear_time_s: float = number(0.5, 0, 3, "time before the vehicle behind brakes")
    """The default is long enough for slow changes, because others react once the lane line is crossed."""
    front_brake_mps2: float = number(4.0, 0.5, 8, "deceleration that one accepts towards the vehicle ahead")
    brake_mps2: float = number(4.0, 0.5, 8, "deceleration that the vehicle behind is expected to accept")
    own_brake_mps2: float = number(1.5, 0.3, 4, "deceleration towards the target speed during the change")


@dataclass(frozen=True)
class YieldConfig:
    """How civilians change lanes to make way, and return."""

    speed_mps: float = number(
        PAPER_SPEEDS.civilian_yield_lane_change_mps, 0.5, 10, "greatest speed during the lane change (paper: 10 km/h)"
    )
    queue_m: float = number(80.0, 0, 200, "distance to an EMV in their queue within which drivers who stand notice it")
    """The default is the length of a queue of about a dozen vehicles."""
    seek_after_s: float = number(0.5, 0, 10, "time without an open gap after which the driver begins to make one")
    seek_for_s: float = number(4.0, 0.5, 30, "time for which a gap is sought")
    seek_pause_s: float = number(4.0, 0, 30, "time for which the driver then goes on at the pace of the road")
    """A driver who has found no gap must not hold up the EMV by trying again at once."""
    seek_speed_mps: float = number(
        3.0, 0.5, 8, "difference of speed to the vehicle that is in the way while a gap is sought"
    )
    seek_least_mps: float = number(2.0, 0.5, 8, "least speed while a gap is sought")
    seek_pace: float = number(1.2, 0.8, 1.5, "share of the speed limit that a driver uses to draw ahead")
    """Drivers may exceed the limit by 20 %, because nobody keeps to it with an EMV behind."""
    rejoin_speed_mps: float = number(5.0, 1, 15, "speed on the way back to the lane")
    rejoin_blocked_s: float = number(2.0, 0.5, 20, "standstill on the way back after which SUMO takes over")


@dataclass(frozen=True)
class PullOverConfig:
    """The pull-over to the lane's edge."""

    speed_mps: float = number(PAPER_SPEEDS.civilian_pull_over_mps, 1, 10, "speed to the edge (paper: 15 km/h)")
    corridor_half_m: float = number(1.4, 1, 2.5, "free width that a vehicle tries to leave on its inner side")
    shoulder_free_m: float = number(2.6, 2, 3.5, "width that an EMV on the shoulder needs next to a standing vehicle")
    """An EMV is 2.2 m wide, and 0.2 m remain on each side."""
    overhang_max_m: float = number(0.5, 0, 1.5, "how far a vehicle may reach beyond its lane's edge to make space")
    shoulder_overhang_max_m: float = number(1.0, 0, 2, "the same where a shoulder lies there")
    duration_s: float = number(2.0, 1, 6, "length of the way back to the lane over the speed")
    blocked_hold_s: float = number(
        1.0, 0.2, 10, "standstill behind another vehicle after which a partly finished pull-over is held"
    )
    resume_gap_m: float = number(3.5, 1, 10, "free space ahead with which a partly finished pull-over goes on")
    emv_crawls_mps: float = number(1.5, 0.2, 5, "speed below which an EMV counts as held up")
    room_after_s: float = number(
        1.5, 0, 10, "time for which the EMV is held up behind a driver who then goes on to make space"
    )
    room_gap_m: float = number(2.5, 0.5, 10, "free space ahead with which a driver goes on to make space")
    room_standstill_gap_m: float = number(1.0, 0.3, 5, "gap to the vehicle ahead at which that driver stops")
    room_over_line_m: float = number(12.0, 0, 20, "how far the front then reaches over the stop line of a red light")
    """The default is at most a car's length plus the way of the lateral move. The front stays clear of those who may
    come on the junction."""
    head_over_line_m: float = number(
        9.0, 0, 20, "how far the front of the first one in a queue reaches over the stop line"
    )
    stays_behind_m: float = number(20.0, 0, 100, "distance to an EMV that has passed below which the driver holds on…")
    stays_behind_mps: float = number(3.0, 0, 10, "…while that EMV is slower than this")
    """A driver who went on would pass the EMV, which may have to move aside."""
    start_mps: float = number(1.5, 0.3, 5, "speed that a vehicle at rest gets up to on its way to the edge")
    creep_mps: float = number(1.0, 0.3, 5, "speed on a way that is only as long as the lateral move")
    """The speed is low enough for the steering to keep up."""
    mirror_m: float = number(0.2, 0, 0.8, "distance from the lane's edge at which a driver keeps a rescue lane open")
    """With the default the mirror stays inside the lane."""
    flows_mps: float = number(8.3, 2, 20, "speed of traffic above which there is no rescue lane")
    """The default is 30 km/h."""


@dataclass(frozen=True)
class ManoeuvringConfig:
    """Margins of a civilian who goes to the lane's edge or comes back from it."""

    narrow_gap_m: float = number(0.3, 0.05, 2, "distance to others below which a driver goes at `narrow_mps`")
    narrow_mps: float = number(1.5, 0.3, 5, "speed where others are nearer than `narrow_gap_m`")
    clearance_m: float = number(0.1, 0, 1, "distance to others at which a driver stops")
    brake_mps2: float = number(2.0, 0.5, 6, "deceleration laid out for towards tight places")

    def __post_init__(self) -> None:
        """Refuses margins that do not decrease in their order."""
        _falling(self, "narrow_gap_m", "clearance_m")

    @cached_property
    def squeezes(self) -> tuple[tuple[float, float], ...]:
        """The margins that are tried, the widest first, each with its speed."""
        return (self.narrow_gap_m, math.inf), (self.clearance_m, self.narrow_mps)


@dataclass(frozen=True)
class CorridorConfig:
    """How the EMV drives in the rescue corridor that the civilians open."""

    side_clearance_m: float = number(0.2, 0, 1, "distance kept to the vehicles on both sides of the corridor")
    leave_after_s: float = number(1.0, 0.2, 10, "time without a reacting or braking vehicle before the corridor ends")
    speed_mps: float = number(PAPER_SPEEDS.emv_copy_sumo_mps, 2, 20, "target speed in the corridor (paper: 30 km/h)")
    narrow_gap_m: float = number(0.3, 0.2, 2, "space on a side below which the EMV goes at `narrow_mps`")
    narrow_mps: float = number(5.0, 0.5, 15, "speed where a side has less than `narrow_gap_m`")
    tight_gap_m: float = number(0.2, 0.05, 1, "space on a side, below `narrow_gap_m`, at which it goes at `tight_mps`")
    tight_mps: float = number(2.5, 0.3, 10, "speed where a side has less than `tight_gap_m`")
    clearance_m: float = number(0.1, 0, 0.5, "distance on a side below which a place is impassable")
    stop_short_m: float = number(5.0, 0, 20, "distance kept from an impassable place")
    merge_s: float = number(1.5, 0.5, 6, "time of the lateral move into the corridor")

    def __post_init__(self) -> None:
        """Refuses margins that do not decrease in their order."""
        _falling(self, "narrow_gap_m", "tight_gap_m", "clearance_m")

    @cached_property
    def squeezes(self) -> tuple[tuple[float, float], ...]:
        """The margins that are tried, the widest first, each with its speed."""
        return (self.narrow_gap_m, math.inf), (self.tight_gap_m, self.narrow_mps), (self.clearance_m, self.tight_mps)


@dataclass(frozen=True)
class GapEscapeConfig:
    """How the EMV searches for a gap when it is blocked."""

    speed_mps: float = number(PAPER_SPEEDS.emv_gap_escape_mps, 1, 15, "target speed of the escape (paper: 20 km/h)")
    wide_gap_m: float = number(0.3, 0.15, 2, "margin around the EMV that an escape path keeps where it can")
    narrow_gap_m: float = number(0.15, 0.08, 1, "next smaller margin…")
    narrow_mps: float = number(1.8, 0.3, 10, "…and the speed with it")
    tight_gap_m: float = number(0.08, 0.06, 0.5, "least margin…")
    tight_mps: float = number(0.8, 0.2, 5, "…and the speed with it")
    oncoming_s: float = number(
        6.5, 1, 15, "time over which oncoming vehicles are foreseen before the opposite lane is taken"
    )
    """The default is the EMV's time to the horizon at its target speed, plus one second."""
    oncoming_watch_s: float = number(3.0, 0.5, 10, "the same while it is driven on")
    """In the default time two vehicles at 20 and 50 km/h can stop before they meet."""
    crossing_s: float = number(3.75, 0.5, 10, "the same of vehicles that cross the EMV's direction")
    brake_mps2: float = number(2.5, 0.5, 6, "deceleration laid out for tight places and stops, also in the corridor")
    bend_accel_mps2: float = number(1.2, 0.3, 4, "lateral acceleration in the bends of an escape path")
    """The default is low enough for the EMV to keep the margins."""
    edge_overhang_m: float = number(0.3, 0, 1, "how far the body may overhang the edge of the road")
    stop_short_m: float = number(0.4, 0.1, 3, "distance kept from the place at which the EMV would touch somebody")
    opposite_cost_m: float = number(30.0, 0, 200, "free length that a path in the opposite lane must gain")
    shoulder_cost_m: float = number(4.0, 0, 100, "the same of a path on the shoulder")

    def __post_init__(self) -> None:
        """Refuses margins that do not decrease in their order."""
        _falling(self, "wide_gap_m", "narrow_gap_m", "tight_gap_m")

    @cached_property
    def squeezes(self) -> tuple[tuple[float, float], ...]:
        """The margins that are tried, the widest first, each with its speed."""
        return (self.wide_gap_m, math.inf), (self.narrow_gap_m, self.narrow_mps), (self.tight_gap_m, self.tight_mps)


@dataclass(frozen=True)
class AnticipationConfig:
    """How the EMV approaches the vehicles ahead on its path."""

    brake_mps2: float = number(1.2, 0.5, 3, "deceleration laid out for towards vehicles ahead")
    """The default is a third of what a driver accepts as comfortable."""
    headway_s: float = number(1.0, 0.4, 2.5, "time kept to vehicles ahead")
    standstill_gap_m: float = number(6.0, 3, 12, "standing distance to vehicles ahead")
    """The default is slightly more than the gap of the collision handling, so that the EMV need not brake for it."""
    ease_off_mps2: float = number(2.0, 0.5, 4, "greatest deceleration for anticipation alone")


@dataclass(frozen=True)
class JunctionEntryConfig:
    """How the EMV comes to a line without right of way: a red light, a stop sign, a give-way sign.

    Each driver has an own speed there (``Attention.emv_line_mps``).
    """

    speed_mps: float | None = number(
        None,
        2,
        12,
        "speed at red lights and other lines without right of way; none: as the preset draws and the view allows",
    )
    brake_mps2: float = number(1.2, 0.5, 4, "deceleration laid out for towards these lines")
    ease_off_mps2: float = number(2.0, 0.5, 4, "greatest deceleration for them")
    stop_mps2: float = number(3.0, 1, 6, "deceleration for somebody who comes into view")
    """The default is the comfortable deceleration of the navigator."""
    reaction_s: float = number(0.5, 0.1, 3, "reaction time to somebody who comes into view")
    """The default is that of a driver who expects others and is ready to brake."""
    standoff_m: float = number(1.0, 0, 5, "distance kept from the nearest lane of the street from the side")
    least_mps: float = number(2.5, 0.5, 6, "speed with which a driver noses out where the view allows less")
    """At the default speed, drivers who come can see the EMV in time."""


@dataclass(frozen=True)
class EmvDriver:
    """How EMVs drive at L1 to L3, where SUMO does not drive them."""

    driving: NavigatorConfig = field(
        default_factory=lambda: NavigatorConfig(standstill_gap_m=4.0, comfort_accel_mps2=2.0, path_brake_mps2=2.0)
    )
    conflicts: ConflictConfig = field(default_factory=lambda: ConflictConfig(after_s=None, room_m=2.0))
    lane_change: LaneChangeConfig = field(default_factory=lambda: LaneChangeConfig(front_brake_mps2=2.0))
    approach: AnticipationConfig = field(default_factory=AnticipationConfig)
    lines: JunctionEntryConfig = field(default_factory=JunctionEntryConfig)
    corridor: CorridorConfig = field(default_factory=CorridorConfig)
    gap_escape: GapEscapeConfig = field(default_factory=GapEscapeConfig)
    pass_from_m: float = number(
        50.0, 10, 150, "distance from slow traffic ahead at which the EMV looks for a free lane or shoulder"
    )
    slow_below_mps: float = number(3.0, 0.5, 10, "speed of the vehicle ahead below which traffic counts as slow")
    pass_gain_m: float = number(20.0, 5, 100, "free road that passing must gain")
    pass_return_m: float = number(30.0, 5, 100, "free road ahead of the slow traffic that is left for the way back")
    """The default is the way of 4 s at 30 km/h."""
    escape_gap_m: float = number(6.0, 2, 12, "standing distance to the vehicle ahead at levels with gap escape")
    """At the default distance the EMV can pull out past the vehicle ahead without reversing."""


@dataclass(frozen=True)
class CivilianDriver:
    """How civilians drive while they make way and return, where SUMO does not drive them."""

    driving: NavigatorConfig = field(default_factory=lambda: NavigatorConfig(ease_off_mps2=1.0))
    conflicts: ConflictConfig = field(default_factory=ConflictConfig)
    lane_change: LaneChangeConfig = field(
        default_factory=lambda: LaneChangeConfig(duration_s=2.0, length_min_m=12.0, rear_time_s=1.0, own_brake_mps2=1.0)
    )
    yielding: YieldConfig = field(default_factory=YieldConfig)
    pull_over: PullOverConfig = field(default_factory=PullOverConfig)
    manoeuvring: ManoeuvringConfig = field(default_factory=ManoeuvringConfig)


@dataclass(frozen=True)
class SumoEmvDriver:
    """SUMO's driver of EMVs at L0.

    Where a value is None, the one in ``params/drivers/urban.yaml`` for the vehicle's class holds.
    """

    speed_factor: float | None = number(None, 0.6, 1.0, "wished speed over the speed limit")
    tau_s: float | None = number(None, 0.5, 2.5, "time headway")
    accel_mps2: float | None = number(None, 0.8, 4.0, "acceleration")
    decel_mps2: float | None = number(None, 1.5, 6.0, "comfortable deceleration")
    min_gap_m: float | None = number(None, 1.0, 5.0, "standing distance to the vehicle ahead")


@dataclass(frozen=True)
class TrafficDrivers:
    """All that SUMO drives."""

    headway_factor: float = number(1.0, 0.5, 3, "factor on the drivers' time headways (`tau_s` in `params/drivers`)")
    gap_factor: float = number(1.0, 0.5, 3, "factor on the standing distances of civilians (`min_gap_m` there)")
    accel_factor: float = number(1.0, 0.5, 2, "factor on the accelerations of civilians")
    decel_factor: float = number(1.0, 0.5, 3, "factor on the comfortable decelerations of civilians")
    spread_factor: float = number(
        1.0, 0, 2, "factor on how much drivers differ in wished speed, time headway and standing distance"
    )
    waiting_pace: float = number(
        1.2, 0.8, 1.5, "share of the speed limit, at least, of a driver who waits for a gap to leave the EMV's lane"
    )
    cleared_pace: float = number(0.7, 0.3, 1, "share of the wished speed of a driver who has left it")
    """The lower speed opens gaps for drivers who still have to leave the EMV's lane."""
    spacing_spread: float = number(0.15, 0, 0.5, "fraction by which gaps within a group vary")
    speed_spread: float = number(0.05, 0, 0.3, "fraction by which wished speeds within a group vary")


@dataclass(frozen=True)
class DriverParameters:
    """All parameters of drivers. The names of the fields, joined by dots, are those that users write."""

    emv_driver: EmvDriver = field(default_factory=EmvDriver)
    civilian_driver: CivilianDriver = field(default_factory=CivilianDriver)
    sumo: SumoEmvDriver = field(default_factory=SumoEmvDriver)
    traffic: TrafficDrivers = field(default_factory=TrafficDrivers)

    def with_values(self, values: Mapping[str, float]) -> "DriverParameters":
        """The parameters with some values replaced, by their dotted names.

        Raises:
            InputError: An unknown name, a value out of its range, or margins that do not fall.
        """
        groups: defaultdict[tuple[str, ...], dict[str, float]] = defaultdict(dict)
        for name, value in values.items():
            check_driver_value(name, value)
            *owners, field_name = name.split(".")
            groups[tuple(owners)][field_name] = float(value)
        changed: DriverParameters = self
        for path, own in groups.items():  # fields of one owner together: each alone might not fit the others
            changed = _replaced(changed, path, own)
        return changed

    def speeds(self, emv_mps: float) -> TargetSpeeds:
        """Target speeds of all modes, from the EMV's speed on a free way."""
        return replace(
            PAPER_SPEEDS,
            emv_route_follow_mps=emv_mps,
            emv_lane_change_mps=emv_mps,
            emv_copy_sumo_mps=self.emv_driver.corridor.speed_mps,
            emv_gap_escape_mps=self.emv_driver.gap_escape.speed_mps,
            civilian_yield_lane_change_mps=self.civilian_driver.yielding.speed_mps,
            civilian_pull_over_mps=self.civilian_driver.pull_over.speed_mps,
        )


def _replaced(owner: Any, owners: Sequence[str], values: Mapping[str, float]) -> Any:
    if not owners:
        return replace(owner, **values)
    head, *rest = owners
    return replace(owner, **{head: _replaced(getattr(owner, head), rest, values)})


@dataclass(frozen=True)
class DriverParameter:
    """What a user has to know to set one parameter."""

    name: str
    meaning: str
    default: float | None
    minimum: float
    maximum: float

    def at(self, share: float) -> float:
        """Value at a share of the range."""
        return self.minimum + share * (self.maximum - self.minimum)

    def share_of(self, value: float) -> float:
        """Inverse of ``at``."""
        return (value - self.minimum) / (self.maximum - self.minimum)


def _parameters_in(owner: Any, path: str = "") -> Iterator[DriverParameter]:
    for one in fields(owner):
        value, name = getattr(owner, one.name), f"{path}{one.name}"
        if is_dataclass(value):
            yield from _parameters_in(value, f"{name}.")
        elif one.metadata:
            about = one.metadata
            yield DriverParameter(name, about["description"], value, float(about["minimum"]), float(about["maximum"]))


DRIVER_PARAMETERS: Final[Mapping[str, DriverParameter]] = {one.name: one for one in _parameters_in(DriverParameters())}
"""Every parameter by its dotted name."""


def check_driver_value(name: str, value: float, where: str = "") -> None:
    """Refuses a name that is no parameter of drivers, and a value out of its range.

    Raises:
        InputError: Names the place ``where`` it is written, or else the parameter.
    """
    known, where = DRIVER_PARAMETERS.get(name), where or name
    if known is None:
        raise InputError(where, value, f"a parameter of drivers: {', '.join(DRIVER_PARAMETERS)}")
    if not known.minimum <= value <= known.maximum:
        raise InputError(where, value, f"a number from {known.minimum:g} to {known.maximum:g}")


def driver_parameters(preset: Mapping[str, float], values: Mapping[str, float]) -> DriverParameters:
    """The parameters of an episode: the values of its template take precedence over those of its preset."""
    own = {name: value for name, value in values.items() if name in DRIVER_PARAMETERS}
    return DriverParameters().with_values({**preset, **own})
