"""Parameters of drivers that users can set: by dotted names in presets, templates and ``values``, each default once."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Final

from siren_ros.base.params.parameter_field import parameter
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.paper import PAPER_SPEEDS, TargetSpeeds


def number(default: float | None, low: float, high: float, meaning: str) -> Any:
    """A field with what a user has to know to set it; None stands for what the meaning says."""
    return parameter(default, meaning, minimum=low, maximum=high)


def _falling(owner: object, *names: str) -> None:
    """Refuse margins that do not fall in the order of their names."""
    for wider, narrower in pairwise(names):
        if not getattr(owner, wider) > getattr(owner, narrower):
            raise InputError(narrower, getattr(owner, narrower), f"less than {wider}, {getattr(owner, wider):g}")


@dataclass(frozen=True)
class NavigatorConfig:
    """How the waypoint navigator tracks a path, keeps a speed and watches for others."""

    preview_time_s: float = 0.6
    """Time scale of the lateral feedback: its length is this times the speed."""
    preview_min_m: float = 3.0
    damping: float = 1.0
    """Damping ratio of the lateral feedback."""
    lateral_error_max_m: float = 1.0
    """Errors beyond it are corrected no more steeply."""
    lateral_accel_mps2: float = number(3.0, 1, 5, "lateral acceleration in bends")
    steer_rate_share: float = 0.8
    """Part of the vehicle's steering rate that a path may ask for."""
    comfort_brake_mps2: float = number(3.0, 1, 6, "deceleration towards other vehicles")
    path_brake_mps2: float = number(3.0, 0.5, 5, "deceleration before bends and stops")
    comfort_accel_mps2: float = number(2.5, 0.8, 4, "acceleration")
    ease_off_mps2: float = number(
        1.5, 0.3, 4, "deceleration towards a lower target speed, where nothing else asks for more"
    )
    speed_gain_1ps: float = 2.0
    speed_integral_1ps2: float = 0.3
    standstill_gap_m: float = number(2.0, 0.5, 10, "standing distance to the vehicle ahead")
    headway_s: float = number(0.8, 0.2, 3, "time kept to the vehicle ahead")
    reaction_s: float = number(0.5, 0.1, 2, "time ahead at which the speed limit of the path is looked up")
    side_margin_m: float = number(0.25, 0.05, 1, "free space on each side of the swept path")
    watch_min_m: float = 20.0
    watch_max_m: float = 70.0
    standstill_mps: float = 0.3
    """Speed below which a vehicle that shall stop is held by the brake."""
    stop_target_mps: float = 0.05
    """Lower target speeds mean a stop."""
    hold_brake: float = 0.6
    """Brake pedal of a vehicle that is held, 0–1."""
    integral_limit_mps2: float = 0.8
    """Greatest integral of the speed control."""
    integral_band_mps: float = 1.0
    """Error of the speed within which the integral grows."""
    firm_braking: float = 1.3
    """Braking towards a lower speed, relative to the comfortable deceleration of the path's speed profile."""
    coast_mps2: float = 0.05
    """Decelerations below it come from rolling alone."""
    crossing_cosine: float = 0.9
    """Vehicles that move at more than about 25° to the path cross it; the others move along it."""
    moving_mps: float = 1.0
    """Slower vehicles are leaders whichever way they look."""
    drift_sine: float = 0.035
    """Sideways drift of less than about 2° is noise of lane keeping."""
    drift_time_s: float = 1.5
    """Time over which a vehicle that drifts sideways is expected to go on."""
    turning_sine: float = 0.17
    """Vehicles that come on at more than about 10° to the path turn across it."""
    own_accel_mps2: float = number(1.5, 0.5, 4, "acceleration that the driver counts with on the way to a conflict")
    others_time_s: float = 6.0
    """How far ahead others are followed, at their present speed…"""
    others_more_m: float = 10.0
    """…with this much more…"""
    others_most_m: float = 60.0
    """…and this much at most."""
    rolling_mps: float = 0.3
    """Slower vehicles come to a stand without more braking."""
    path_creep_mps: float = number(1.5, 0.5, 5, "speed at which any path may be steered")
    winding: float = 40.0
    """Change of curvature that the length of a lateral move is laid out for, times length³ over lateral distance."""
    steepest: float = 0.6
    """Largest tangent of the angle between pose and reference line with which a lateral move starts."""


@dataclass(frozen=True)
class LaneChangeConfig:
    """Geometry and gap acceptance of forced lane changes."""

    duration_s: float = number(2.5, 1, 8, "length of the change over the speed at its start")
    length_min_m: float = number(14.0, 5, 40, "least length of the change")
    front_gap_m: float = number(2.0, 0.5, 10, "free way to the vehicle ahead at equal speeds")
    front_time_s: float = number(0.3, 0, 3, "time before one brakes for the vehicle ahead")
    rear_gap_m: float = number(2.0, 0.5, 10, "free way to the vehicle behind at equal speeds")
    rear_time_s: float = number(0.5, 0, 3, "time before the vehicle behind brakes")
    front_brake_mps2: float = number(4.0, 0.5, 8, "deceleration that one accepts towards the vehicle ahead")
    brake_mps2: float = number(4.0, 0.5, 8, "deceleration that the vehicle behind is expected to accept")
    own_brake_mps2: float = number(1.5, 0.3, 4, "deceleration towards the target speed during the change")
    return_room_m: float = 60.0
    """Lane left after the change, where the target lane does not lead on along the route."""
    bend_max_1pm: float = 0.02
    """Difference between the curvatures of path and target lane above which the EMV is still turning onto the road."""
    entered_tolerance_m: float = 0.15
    """How far the footprint may reach over the lane's edge when it counts as inside."""
    gap_range_m: float = 60.0
    """Distance within which vehicles in a lane are looked at."""
    eased_off: float = 0.75
    """Part of the present speed that is left on average, where the target speed is lower."""
    speed_up_mps: float = 2.5
    """Gain of speed that a lane change is laid out for."""
    steer_share: float = 0.7
    """Part of the steering range that a lane change may use."""


@dataclass(frozen=True)
class YieldConfig:
    """How civilians change lanes to make way, and return."""

    speed_mps: float = number(
        PAPER_SPEEDS.civilian_yield_lane_change_mps, 0.5, 10, "greatest speed during the lane change (paper: 10 km/h)"
    )

    standing_mps: float = 0.2
    """Slower civilians stand."""
    queue_m: float = number(80.0, 0, 200, "distance to an EMV in their queue within which drivers who stand notice it")
    off_path_grace_s: float = 1.0
    """Time off the EMV's path before a yield that has not started is dropped."""
    path_ahead_m: float = 120.0
    """How far the EMV's path is followed."""
    path_behind_m: float = 5.0
    seek_after_s: float = number(0.5, 0, 10, "time without an open gap after which the driver begins to make one")
    seek_for_s: float = number(4.0, 0.5, 30, "time for which a gap is sought")
    seek_pause_s: float = number(4.0, 0, 30, "time for which the driver then goes on at the pace of the road")
    seek_soon_s: float = 2.0
    """A driver who will have the gap within this time goes on seeking it."""
    seek_speed_mps: float = number(
        3.0, 0.5, 8, "difference of speed to the vehicle that is in the way while a gap is sought"
    )
    seek_least_mps: float = number(2.0, 0.5, 8, "least speed while a gap is sought")
    seek_again_s: float = 1.5
    """Time after which the driver thinks again whether to draw ahead or to fall back."""
    seek_pace: float = number(1.2, 0.8, 1.5, "share of the speed limit that a driver uses to draw ahead")
    seek_room_m: float = 20.0
    """Road left before the next junction below which no gap is sought."""
    seek_free_m: float = 15.0
    """Free way in the present lane with which a driver draws ahead of a vehicle behind…"""
    seek_gain_mps: float = 1.5
    """…and how much slower than the speed limit that vehicle is: the search gains a car's length."""
    rejoin_speed_mps: float = number(5.0, 1, 15, "speed on the way back to the lane")
    rejoin_offset_m: float = 0.3
    """Distance from the lane's centre line at which a vehicle counts as back in its lane."""
    rejoin_lengths: float = 1.5
    """Way back to the lane's centre, at least, in lengths of the vehicle: a long one that turns in sharply comes near
    to others beside it that come back as well."""
    rejoin_blocked_s: float = number(2.0, 0.5, 20, "standstill on the way back after which SUMO takes over")
    rejoin_ahead_m: float = 60.0
    """How far the path of a vehicle that rejoins leads."""
    seek_ahead_m: float = 80.0
    """How far the path of a vehicle that seeks a gap leads."""
    goes_on_mps: float = 1.0
    """Faster drivers go on with a lane change: a stop half-way would take both lanes."""
    followed_s: float = 1.0
    """Time for which the EMV is in the new lane after which a driver yields again."""
    edges_kept: int = 3
    """Number of edges that the EMV has left and that still count as its road."""


@dataclass(frozen=True)
class PullOverConfig:
    """The pull-over to the lane's edge."""

    speed_mps: float = number(PAPER_SPEEDS.civilian_pull_over_mps, 1, 10, "speed to the edge (paper: 15 km/h)")

    corridor_half_m: float = number(1.4, 1, 2.5, "free width that a vehicle tries to leave on its inner side")
    shoulder_free_m: float = number(2.6, 2, 3.5, "width that an EMV on the shoulder needs next to a standing vehicle")
    overhang_max_m: float = number(0.5, 0, 1.5, "how far a vehicle may reach beyond its lane's edge to make space")
    shoulder_overhang_max_m: float = number(1.0, 0, 2, "the same where a shoulder lies there")
    duration_s: float = number(2.0, 1, 6, "length of the way back to the lane over the speed")
    length_min_m: float = 6.0
    curvature_max_1pm: float = 0.15
    reached_m: float = 0.15
    """Distance from the intended offset at which the target counts as reached."""
    blocked_hold_s: float = number(
        1.0, 0.2, 10, "standstill behind another vehicle after which a partly finished pull-over is held"
    )
    resume_gap_m: float = number(3.5, 1, 10, "free space ahead with which a partly finished pull-over goes on")
    emv_crawls_mps: float = number(1.5, 0.2, 5, "speed below which an EMV counts as held up")
    room_after_s: float = number(
        1.5, 0, 10, "time for which the EMV is held up behind a driver who then goes on to make space"
    )
    room_range_m: float = 60.0
    """Distance to that EMV within which a driver makes room."""
    room_gap_m: float = number(2.5, 0.5, 10, "free space ahead with which a driver goes on to make space")
    room_standstill_gap_m: float = number(1.0, 0.3, 5, "gap to the vehicle ahead at which that driver stops")
    room_over_line_m: float = number(12.0, 0, 20, "how far the front then reaches over the stop line of a red light")
    head_over_line_m: float = number(
        9.0, 0, 20, "how far the front of the first one in a queue reaches over the stop line"
    )
    beyond_junction_m: float = 2.0
    """Way from the junction to the rear of a vehicle that has cleared it to make room."""
    in_the_way_m: float = 2.0
    """A vehicle that is farther in the way of others than this crosses the junction at a red light too."""
    stays_behind_m: float = number(20.0, 0, 100, "distance to an EMV that has passed below which the driver holds on…")
    stays_behind_mps: float = number(3.0, 0, 10, "…while that EMV is slower than this")
    turned_off_m: float = 15.0
    """Distance to an EMV whose way does not lead past a vehicle any more from which on that has nobody to yield to."""
    settle_length_m: float = 4.0
    """Straight piece after the lateral move, at least; long vehicles take their own length to come straight."""
    stick_out_m: float = 0.33
    """How far an end of a vehicle may stick out sideways, by its heading, for it to count as aligned: what the paper's
    8° are for a car of 4.7 m."""
    behind_cosine: float = 0.5
    """Cosine between a vehicle's direction and the one from the EMV to it above which the EMV counts as behind."""
    stays_below_mps: float = 1.5
    """Slower vehicles next to a shoulder that they leave free stop where they are."""
    alongside_m: float = 15.0
    """Distance along the road within which the driver next to a vehicle gives it space to move sideways."""
    start_mps: float = number(1.5, 0.3, 5, "speed that a vehicle at rest gets up to on its way to the edge")
    settled_m: float = 0.5
    """Way before the end of the lateral move at which the move counts as ended."""
    at_edge_m: float = 0.05
    """Distance from the intended offset at which the target counts as reached before the lateral move has ended."""
    least_way_m: float = 2.0
    """Least way for which a driver starts."""
    straight_rad: float = 0.04
    """Heading against the lane below which a vehicle gets no straighter by driving on: an end sticks out by 0.1 m."""
    leader_stands_mps: float = 1.0
    """Slower vehicles ahead stand, or are about to."""
    creep_mps: float = number(1.0, 0.3, 5, "speed on a way that is only as long as the lateral move")
    look_again_s: float = 0.5
    """Time between two looks of a driver who waits."""
    mirror_m: float = number(0.2, 0, 0.8, "distance from the lane's edge at which a driver keeps a rescue lane open")
    kept_within_m: float = 0.25
    """Distance from there within which a driver has made way already."""
    flows_mps: float = number(8.3, 2, 20, "speed of traffic above which there is no rescue lane")


@dataclass(frozen=True)
class ManoeuvringConfig:
    """Margins of a civilian who goes to the lane's edge or comes back from it."""

    narrow_gap_m: float = number(0.3, 0.05, 2, "distance to others below which a driver goes at `narrow_mps`")
    narrow_mps: float = number(1.5, 0.3, 5, "speed where others are nearer than `narrow_gap_m`")
    clearance_m: float = number(0.1, 0, 1, "distance to others at which a driver stops")
    stop_short_m: float = 0.3
    brake_mps2: float = number(2.0, 0.5, 6, "deceleration laid out for towards tight places")
    leader_brake_mps2: float = 4.0
    """Deceleration expected of vehicles ahead."""
    watch_s: float = 1.0
    """Time over which vehicles that come on at the side are swept ahead."""
    watch_m: float = 8.0
    """Distance at the side and behind within which they are seen."""
    reach_m: float = 8.0
    """How far ahead a driver at walking pace looks."""
    along_cosine: float = 0.7
    """Cosine above which a vehicle counts as one of the same direction."""
    still_mps: float = 0.3
    """Slower vehicles stand."""

    @property
    def squeezes(self) -> tuple[tuple[float, float], ...]:
        """Margins, the wider first, and the speed with each."""
        return (self.narrow_gap_m, math.inf), (self.clearance_m, self.narrow_mps)


@dataclass(frozen=True)
class CorridorConfig:
    """The copied rescue corridor."""

    length_m: float = 80.0
    replan_s: float = 0.4
    side_clearance_m: float = number(0.2, 0, 1, "distance kept to the vehicles on both sides of the corridor")
    shoulder_reach_m: float = 160.0
    """How far beyond the present edge a right turn may be for which the EMV takes the shoulder that leads into it."""
    influence_m: float = 6.0
    """Distance along the road over which a vehicle shapes the corridor before and behind itself."""
    leave_after_s: float = number(1.0, 0.2, 10, "time without a reacting or braking vehicle before the corridor ends")
    speed_mps: float = number(PAPER_SPEEDS.emv_copy_sumo_mps, 2, 20, "target speed in the corridor (paper: 30 km/h)")
    narrow_gap_m: float = number(0.3, 0.2, 2, "space on a side below which the EMV goes at `narrow_mps`")
    narrow_mps: float = number(5.0, 0.5, 15, "speed where a side has less than `narrow_gap_m`")
    tight_gap_m: float = number(0.2, 0.05, 1, "space on a side, below `narrow_gap_m`, at which it goes at `tight_mps`")
    tight_mps: float = number(2.5, 0.3, 10, "speed where a side has less than `tight_gap_m`")
    clearance_m: float = number(0.1, 0, 0.5, "distance on a side below which a place is impassable")
    straight_below_m: float = 25.0
    """Free way along the corridor below which the EMV looks at its present path and at the way straight on."""
    keep_gain_m: float = 3.0
    """Free way that keeping the present path must gain: a new one turns into the corridor later."""
    keep_above_mps: float = 1.0
    """Slower, a new path is taken in any case: stopping for it needs no hard braking."""
    straight_gain_m: float = 8.0
    """Free way that going straight on must gain."""
    stop_short_m: float = number(5.0, 0, 20, "distance kept from an impassable place")
    standing_mps: float = 0.5
    """Slower vehicles stand."""
    road_half_width_m: float = 8.0
    """Vehicles farther from the reference line are on another road."""
    along_cosine: float = 0.5
    """Cosine above which a vehicle counts as one of the EMV's own direction."""
    amid_m: float = 0.5
    """A vehicle whose centre is nearer to the corridor's line stands in its middle."""
    merge_s: float = number(1.5, 0.5, 6, "time of the lateral move into the corridor")
    merge_min_m: float = 8.0
    """Least length of that move."""
    line_smoothing_m: float = 5.0
    """Way before and after the place where a lane begins over which the corridor's line moves aside, at least."""
    same_offset_m: float = 0.5
    """Two corridors that lie nearer to each other than this lead to the same place."""

    def __post_init__(self) -> None:
        """Refuse margins in another order."""
        _falling(self, "narrow_gap_m", "tight_gap_m")

    @cached_property
    def squeezes(self) -> tuple[tuple[float, float], ...]:
        """Margins, the wider first, and the speed with each."""
        return (self.narrow_gap_m, math.inf), (self.tight_gap_m, self.narrow_mps), (self.clearance_m, self.tight_mps)


@dataclass(frozen=True)
class GapEscapeConfig:
    """Search of the gap escape."""

    replan_s: float = 0.5
    replan_below_m: float = 15.0
    """A free path is kept while more than this is left of it."""
    horizon_m: float = 30.0
    progress_min_m: float = 8.0
    """Shortest free path worth driving."""
    usable_m: float = 1.0
    """Free way with which the present path is driven on where no other one is found."""
    speed_mps: float = number(PAPER_SPEEDS.emv_gap_escape_mps, 1, 15, "target speed of the escape (paper: 20 km/h)")
    wide_gap_m: float = number(0.3, 0.15, 2, "margin around the EMV that an escape path keeps where it can")
    narrow_gap_m: float = number(0.15, 0.08, 1, "next smaller margin…")
    narrow_mps: float = number(1.8, 0.3, 10, "…and the speed with it")
    tight_gap_m: float = number(0.08, 0.06, 0.5, "least margin…")
    tight_mps: float = number(0.8, 0.2, 5, "…and the speed with it")
    squeeze_cost_m: float = 6.0
    """Way that a tighter margin must gain."""
    station_m: float = 1.5
    """Distance between the stations of the search."""
    slope_step: float = 0.1
    """Steps in the direction of a path, relative to the road."""
    way_worth: float = 2.0
    """What a metre of way is worth against the prices below."""
    slope_cost: float = 0.5
    turn_cost: float = 0.15
    offset_cost: float = 0.02
    sweep_s: float = 1.5
    """Time over which moving vehicles are swept ahead in the search."""
    watch_s: float = 0.8
    """The same for the watch on the path that is driven."""
    crossing_s: float = number(3.75, 0.5, 10, "the same of vehicles that cross the EMV's direction")
    oncoming_s: float = number(
        6.5, 1, 15, "time over which oncoming vehicles are foreseen before the opposite lane is taken"
    )
    oncoming_watch_s: float = number(3.0, 0.5, 10, "the same while it is driven on")
    oncoming_m: float = 90.0
    """How far beyond the horizon vehicles are looked for in the search: 50 km/h for that time."""
    brake_mps2: float = number(2.5, 0.5, 6, "deceleration laid out for tight places and stops, also in the corridor")
    bend_accel_mps2: float = number(1.2, 0.3, 4, "lateral acceleration in the bends of an escape path")
    steer_share: float = 0.5
    """Part of the steering's rate that an escape path may ask for, relative to other paths."""
    off_path_m: float = 0.3
    """Distance from the path at which another one is looked for."""
    edge_overhang_m: float = number(0.3, 0, 1, "how far the body may overhang the edge of the road")
    touch_m: float = 0.06
    """Margin below which the path counts as blocked: more than the EMV strays from it."""
    stop_short_m: float = number(0.4, 0.1, 3, "distance kept from the place at which the EMV would touch somebody")
    leader_brake_mps2: float = 4.0
    """Deceleration expected of vehicles ahead that move in the EMV's direction."""
    blocker_range_m: float = 15.0
    """While the escape is active: free way in the EMV's lane below which the vehicle ahead still blocks it."""
    opposite_cost_m: float = number(30.0, 0, 200, "free length that a path in the opposite lane must gain")
    shoulder_cost_m: float = number(4.0, 0, 100, "the same of a path on the shoulder")
    steer_range_share: float = 0.85
    """Part of the steering range that an escape path may use."""
    behind_m: float = 5.0
    """The reference line begins this far behind the EMV's centre, beyond its rear axle."""
    same_offset_m: float = 0.5
    """Two paths that lead nearer to each other than this lead to the same place."""
    smoothing_m: float = 0.7
    """Standard deviation of the Gaussian that rounds the steps in a path's curvature."""
    steepest: float = 0.8
    """Largest slope of a path against the reference line."""
    level: float = 0.11
    """A path that ends before the horizon may end with this slope at most, so that it can be continued."""
    attempts: int = 5
    """Paths with one margin that are looked at as a whole before the next margin is tried."""
    along_cosine: float = 0.7
    """Cosine above which a vehicle counts as one of the EMV's own direction."""
    crossing_mps: float = 1.0
    """Faster vehicles that cross the EMV's path are the collision handling's, where that is on."""
    beside_m: float = 30.0
    """How far beyond the horizon vehicles are looked at."""

    def __post_init__(self) -> None:
        """Refuse margins in another order."""
        _falling(self, "wide_gap_m", "narrow_gap_m", "tight_gap_m")

    @cached_property
    def squeezes(self) -> tuple[tuple[float, float], ...]:
        """Margins, the wider first, and the speed with each."""
        return (self.wide_gap_m, math.inf), (self.narrow_gap_m, self.narrow_mps), (self.tight_gap_m, self.tight_mps)


@dataclass(frozen=True)
class AnticipationConfig:
    """How the EMV approaches the vehicles ahead on its path."""

    brake_mps2: float = number(1.2, 0.5, 3, "deceleration laid out for towards vehicles ahead")
    headway_s: float = number(1.0, 0.4, 2.5, "time kept to vehicles ahead")
    standstill_gap_m: float = number(6.0, 3, 12, "standing distance to vehicles ahead")
    ease_off_mps2: float = number(2.0, 0.5, 4, "greatest deceleration for anticipation alone")
    side_margin_m: float = 0.25
    """Lateral distance below which a vehicle is in the way."""
    leaving_min_mps: float = 0.15
    """Lateral speed above which a vehicle counts as leaving the path."""
    leaving_mps: float = 0.6
    """Mean lateral speed of a lane change: its present value rises and falls, so it says little about the end."""
    along_cosine: float = 0.7
    """Cosine above which a vehicle counts as one of the EMV's own direction."""


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
    reaction_s: float = number(0.5, 0.1, 3, "reaction time to somebody who comes into view")
    standoff_m: float = number(1.0, 0, 5, "distance kept from the nearest lane of the street from the side")
    least_mps: float = number(2.5, 0.5, 6, "speed with which a driver noses out where the view allows less")
    view_m: float = 40.0
    """Distance before the line from which on the view counts."""
    view_step_m: float = 0.5


@dataclass(frozen=True)
class EmvDriver:
    """How EMVs drive at L1 to L3, where SUMO does not drive them."""

    driving: NavigatorConfig = field(
        default_factory=lambda: NavigatorConfig(standstill_gap_m=4.0, comfort_accel_mps2=2.0, path_brake_mps2=2.0)
    )
    lane_change: LaneChangeConfig = field(default_factory=lambda: LaneChangeConfig(front_brake_mps2=2.0))
    approach: AnticipationConfig = field(default_factory=AnticipationConfig)
    lines: JunctionEntryConfig = field(default_factory=JunctionEntryConfig)
    corridor: CorridorConfig = field(default_factory=CorridorConfig)
    gap_escape: GapEscapeConfig = field(default_factory=GapEscapeConfig)
    path_ahead_m: float = 120.0
    rebuild_below_m: float = 80.0
    """The path is extended when less than this is left of it."""
    path_behind_m: float = 10.0
    off_path_m: float = 1.5
    """Distance from the path at which it is planned anew from the present pose."""
    rejoin_offset_m: float = 0.5
    """Offsets below it are left to the path tracking."""
    strategic_distance_m: float = 200.0
    """Distance before the end of a lane that leads astray at which the EMV wants to leave it…"""
    strategic_s: float = 10.0
    """…and the time before it, which is more above 72 km/h."""
    far_brake_mps2: float = 1.8
    """A fast EMV looks as far ahead as it takes to stop with this: above 61 km/h farther than the paper's 80 m."""
    pass_from_m: float = number(
        50.0, 10, 150, "distance from slow traffic ahead at which the EMV looks for a free lane or shoulder"
    )
    slow_below_mps: float = number(3.0, 0.5, 10, "speed of the vehicle ahead below which traffic counts as slow")
    pass_gain_m: float = number(20.0, 5, 100, "free road that passing must gain")
    pass_return_m: float = number(30.0, 5, 100, "free road ahead of the slow traffic that is left for the way back")
    escape_gap_m: float = number(6.0, 2, 12, "standing distance to the vehicle ahead at levels with gap escape")
    stop_before_route_end_m: float = 3.0
    replan_s: float = 1.0
    """Least time between two plans where SUMO's route and the path disagree."""
    aligned_rad: float = 0.3
    """Heading errors below it are left to the path tracking."""
    intent_pause_s: float = 1.0
    """SUMO's intent comes and goes from step to step; a request ends after a pause of this length."""


@dataclass(frozen=True)
class CivilianDriver:
    """How civilians drive while they make way and return, where SUMO does not drive them."""

    driving: NavigatorConfig = field(default_factory=lambda: NavigatorConfig(ease_off_mps2=1.0))
    lane_change: LaneChangeConfig = field(
        default_factory=lambda: LaneChangeConfig(duration_s=2.0, length_min_m=12.0, rear_time_s=1.0, own_brake_mps2=1.0)
    )
    yielding: YieldConfig = field(default_factory=YieldConfig)
    pull_over: PullOverConfig = field(default_factory=PullOverConfig)
    manoeuvring: ManoeuvringConfig = field(default_factory=ManoeuvringConfig)


@dataclass(frozen=True)
class SumoEmvDriver:
    """SUMO's driver of EMVs at L0; none: what ``params/drivers/urban.yaml`` has for the vehicle's class."""

    speed_factor: float | None = number(None, 0.6, 1.0, "wished speed over the speed limit")
    tau_s: float | None = number(None, 0.5, 2.5, "time headway")
    accel_mps2: float | None = number(None, 0.8, 4.0, "acceleration")
    decel_mps2: float | None = number(None, 1.5, 6.0, "comfortable deceleration")
    min_gap_m: float | None = number(None, 1.0, 5.0, "standing distance to the vehicle ahead")


@dataclass(frozen=True)
class DriverParameters:
    """All parameters of drivers. The names of the fields, joined by dots, are those that users write."""

    emv_driver: EmvDriver = field(default_factory=EmvDriver)
    civilian_driver: CivilianDriver = field(default_factory=CivilianDriver)
    sumo: SumoEmvDriver = field(default_factory=SumoEmvDriver)

    def with_values(self, values: Mapping[str, float]) -> "DriverParameters":
        """The parameters with other values, by their dotted names.

        Raises:
            InputError: An unknown name, a value out of its range, or margins that do not fall.
        """
        changed: DriverParameters = self
        for name, value in values.items():
            check_driver_value(name, value)
        for parts in sorted({tuple(name.split(".")[:-1]) for name in values}, key=len):
            prefix = ".".join((*parts, ""))
            own = {
                name.removeprefix(prefix): values[name] for name in values if name.rpartition(".")[0] + "." == prefix
            }
            changed = _replaced(changed, parts, own)
        return changed

    def speeds(self, emv_mps: float) -> TargetSpeeds:
        """Target speeds of all modes, given that of EMVs on a free way."""
        return replace(
            PAPER_SPEEDS,
            emv_route_follow_mps=emv_mps,
            emv_lane_change_mps=emv_mps,
            emv_copy_sumo_mps=self.emv_driver.corridor.speed_mps,
            emv_gap_escape_mps=self.emv_driver.gap_escape.speed_mps,
            civilian_yield_lane_change_mps=self.civilian_driver.yielding.speed_mps,
            civilian_pull_over_mps=self.civilian_driver.pull_over.speed_mps,
        )


def _replaced(owner: Any, parts: tuple[str, ...], values: Mapping[str, float]) -> Any:
    if not parts:
        return replace(owner, **values)
    head, *rest = parts
    return replace(owner, **{head: _replaced(getattr(owner, head), tuple(rest), values)})


@dataclass(frozen=True)
class DriverParameter:
    """What a user has to know to set one parameter."""

    name: str
    meaning: str
    default: float | None
    minimum: float
    maximum: float


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
    """Refuse a name that is no parameter of drivers, and a value out of its range.

    Raises:
        InputError: Names the place ``where`` it is written, or else the parameter.
    """
    known, where = DRIVER_PARAMETERS.get(name), where or name
    if known is None:
        raise InputError(where, value, f"a parameter of drivers: {', '.join(DRIVER_PARAMETERS)}")
    if not known.minimum <= value <= known.maximum:
        raise InputError(where, value, f"a number from {known.minimum:g} to {known.maximum:g}")


def driver_parameters(preset: Mapping[str, float], values: Mapping[str, float]) -> DriverParameters:
    """The parameters of an episode, given those of its preset and all values of its template, which go first."""
    own = {name: value for name, value in values.items() if name in DRIVER_PARAMETERS}
    return DriverParameters().with_values({**preset, **own})
