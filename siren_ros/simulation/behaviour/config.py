"""Parameters of the behaviour beyond the paper's tables, each with its default once."""

from dataclasses import dataclass, field

from siren_ros.simulation.conflicts.yielding import YieldingConfig


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
    lateral_accel_mps2: float = 3.0
    """Limit in curves; comfort limit of urban driving."""
    steer_rate_share: float = 0.8
    """Part of the vehicle's steering rate that a path may ask for."""
    curvature_rate_1pms: float = 0.1
    """Limit of the change of curvature per time; ``StepView.navigator_config`` sets it from the vehicle's steering."""
    comfort_brake_mps2: float = 3.0
    """Deceleration towards other vehicles."""
    path_brake_mps2: float = 3.0
    """Deceleration before bends and stops."""
    comfort_accel_mps2: float = 2.5
    ease_off_mps2: float = 1.5
    """Deceleration towards a lower target speed, where nothing else asks for more."""
    speed_gain_1ps: float = 2.0
    speed_integral_1ps2: float = 0.3
    standstill_gap_m: float = 2.0
    headway_s: float = 0.8
    reaction_s: float = 0.5
    """Lead by which the speed limit of the path is looked up: delay of the speed loop."""
    side_margin_m: float = 0.25
    """Free space beside the swept path."""
    watch_min_m: float = 20.0
    watch_max_m: float = 70.0
    conflicts: YieldingConfig = field(default_factory=YieldingConfig)
    """Where the ways of others meet the path."""
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
    own_accel_mps2: float = 1.5
    """Acceleration that the driver counts with on the way to a conflict."""
    others_time_s: float = 6.0
    """How far ahead others are followed, at their present speed…"""
    others_more_m: float = 10.0
    """…with this much more…"""
    others_most_m: float = 60.0
    """…and this much at most."""
    rolling_mps: float = 0.3
    """Slower vehicles come to a stand without more braking."""
    path_creep_mps: float = 1.5
    """The steering keeps up with any path at this speed well enough."""
    winding: float = 40.0
    """Change of curvature that the length of a lateral move is laid out for, times length³ over lateral distance."""
    steepest: float = 0.6
    """Largest tangent of the angle between pose and reference line with which a lateral move starts."""


@dataclass(frozen=True)
class LaneChangeConfig:
    """Geometry and gap acceptance of forced lane changes."""

    duration_s: float = 2.5
    """Length of the change over the speed at its start."""
    length_min_m: float = 14.0
    front_gap_m: float = 2.0
    """Free way at equal speeds, as ``rear_gap_m``."""
    front_time_s: float = 0.3
    """Time before one brakes for the vehicle ahead."""
    rear_gap_m: float = 2.0
    rear_time_s: float = 0.5
    """Time before the vehicle behind brakes; longer for slow changes, as others react once the lane line is crossed."""
    front_brake_mps2: float = 4.0
    """Deceleration that one accepts towards the vehicle ahead."""
    brake_mps2: float = 4.0
    """Deceleration that the vehicle behind is expected to accept."""
    own_brake_mps2: float = 1.5
    """Deceleration towards the target speed, the navigator's ``ease_off_mps2``."""
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
    """Civilian response."""

    standing_mps: float = 0.2
    """Slower civilians stand."""
    queue_m: float = 80.0
    """Distance to an EMV in their queue, within which drivers who stand notice it: about a dozen vehicles."""
    off_path_grace_s: float = 1.0
    """Time off the EMV's path before a yield that has not started is dropped."""
    path_ahead_m: float = 120.0
    """How far the EMV's path is followed."""
    path_behind_m: float = 5.0
    seek_after_s: float = 0.5
    """Time without an open gap after which the driver begins to make one."""
    seek_for_s: float = 4.0
    """Time for which a gap is sought. Then the driver does not hold up the EMV for a while."""
    seek_pause_s: float = 4.0
    """Time for which the driver then goes on at the pace of the road."""
    seek_soon_s: float = 2.0
    """A driver who will have the gap within this time goes on seeking it."""
    seek_speed_mps: float = 3.0
    """Difference of speed to the vehicle that is in the way while a gap is sought."""
    seek_least_mps: float = 2.0
    """Least speed while a gap is sought."""
    seek_again_s: float = 1.5
    """Time after which the driver thinks again whether to draw ahead or to fall back."""
    seek_pace: float = 1.2
    """Share of the speed limit that a driver uses to draw ahead: nobody keeps to it with an EMV behind."""
    seek_room_m: float = 20.0
    """Road left before the next junction below which no gap is sought."""
    seek_free_m: float = 15.0
    """Free way in the present lane with which a driver draws ahead of a vehicle behind…"""
    seek_gain_mps: float = 1.5
    """…and how much slower than the speed limit that vehicle is: the search gains a car's length."""
    rejoin_speed_mps: float = 5.0
    rejoin_offset_m: float = 0.3
    """Distance from the lane's centre line at which a vehicle counts as back in its lane."""
    rejoin_lengths: float = 1.5
    """Way back to the lane's centre, at least, in lengths of the vehicle: a long one that turns in sharply comes near
    to others beside it that come back as well."""
    rejoin_blocked_s: float = 2.0
    """Standstill while rejoining after which SUMO takes over at the present pose."""
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
    """Geometry of the pull-over to the lane's edge."""

    corridor_half_m: float = 1.4
    """Free width that a vehicle tries to leave on its inner side, where standing at the lane's edge leaves less."""
    shoulder_free_m: float = 2.6
    """Width up to the outer edge of a shoulder that an EMV, 2.2 m wide, needs next to a standing vehicle."""
    overhang_max_m: float = 0.5
    """How far a vehicle may reach beyond its lane's edge for it."""
    shoulder_overhang_max_m: float = 1.0
    """The same where a shoulder lies there."""
    duration_s: float = 2.0
    length_min_m: float = 6.0
    curvature_max_1pm: float = 0.15
    reached_m: float = 0.15
    """Distance from the intended offset at which the target counts as reached."""
    blocked_hold_s: float = 1.0
    """Standstill behind another vehicle after which a partly finished pull-over is held."""
    resume_gap_m: float = 3.5
    """Free space ahead with which a partly finished pull-over goes on."""
    emv_crawls_mps: float = 1.5
    """A slower EMV is held up."""
    room_after_s: float = 1.5
    """Time for which the EMV is held up behind a vehicle after which its driver goes on along the edge to make room."""
    room_range_m: float = 60.0
    """Distance to that EMV within which a driver makes room."""
    room_gap_m: float = 2.5
    """Free space ahead with which a driver goes on to make room."""
    room_standstill_gap_m: float = 1.0
    """Gap to the vehicle ahead at which the driver then stops."""
    room_over_line_m: float = 12.0
    """How far the front then reaches over the stop line of a red light, at most: a car's length and the lateral move.
    It stays clear of those who may come on the junction."""
    head_over_line_m: float = 9.0
    """How far the front of the first one in a standing queue reaches over the stop line to have space for the move."""
    beyond_junction_m: float = 2.0
    """Way from the junction to the rear of a vehicle that has cleared it to make room."""
    in_the_way_m: float = 2.0
    """A vehicle that is farther in the way of others than this crosses the junction at a red light too."""
    stays_behind_m: float = 20.0
    """Nearer to an EMV that has passed…"""
    stays_behind_mps: float = 3.0
    """…and is slower than this, a driver holds on: who drove on would pass it, and it may have to move aside."""
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
    start_mps: float = 1.5
    """Speed that a vehicle at rest gets up to on its way to the edge."""
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
    creep_mps: float = 1.0
    """Speed on a way that is only as long as the lateral move: slow enough for the steering."""
    look_again_s: float = 0.5
    """Time between two looks of a driver who waits."""
    mirror_m: float = 0.2
    """Distance from the lane's edge at which a driver keeps a rescue lane open: the mirror stays inside."""
    kept_within_m: float = 0.25
    """Distance from there within which a driver has made way already."""
    flows_mps: float = 8.3
    """Faster traffic has no rescue lane: above 30 km/h it flows."""


@dataclass(frozen=True)
class ManoeuvringConfig:
    """Margins of a civilian who goes to the lane's edge or comes back from it."""

    squeezes: tuple[tuple[float, float], ...] = ((0.3, 4.2), (0.15, 1.5))
    """Distances to others in metres, and the speed from each on in m/s."""
    clearance_m: float = 0.1
    """Distance below which a driver stops."""
    stop_short_m: float = 0.3
    brake_mps2: float = 2.0
    """Deceleration laid out for."""
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


@dataclass(frozen=True)
class CorridorConfig:
    """The copied rescue corridor."""

    length_m: float = 80.0
    replan_s: float = 0.4
    side_clearance_m: float = 0.2
    """Kept to the vehicles beside the corridor."""
    shoulder_reach_m: float = 160.0
    """How far beyond the present edge a right turn may be for which the EMV takes the shoulder that leads into it."""
    influence_m: float = 6.0
    """Distance along the road over which a vehicle shapes the corridor before and behind itself."""
    leave_after_s: float = 1.0
    """Time without a reacting or braking vehicle before ``copy_sumo`` ends."""
    squeezes: tuple[tuple[float, float], ...] = ((0.3, 8.4), (0.2, 5.0), (0.1, 2.5))
    """Distances to the vehicles beside, in metres, and the speed from each on in m/s."""
    clearance_m: float = 0.1
    """Places with less than this on a side are left to the gap escape."""
    straight_below_m: float = 25.0
    """Free way along the corridor below which the EMV looks at its present path and at the way straight on."""
    keep_gain_m: float = 3.0
    """Free way that keeping the present path must gain: a new one turns into the corridor later."""
    keep_above_mps: float = 1.0
    """Slower, a new path is taken in any case: stopping for it needs no hard braking."""
    straight_gain_m: float = 8.0
    """Free way that going straight on must gain."""
    stop_short_m: float = 5.0
    """Distance kept from the place where the corridor becomes too narrow for the EMV's footprint."""
    standing_mps: float = 0.5
    """Slower vehicles stand."""
    road_half_width_m: float = 8.0
    """Vehicles farther from the reference line are on another road."""
    along_cosine: float = 0.5
    """Cosine above which a vehicle counts as one of the EMV's own direction."""
    amid_m: float = 0.5
    """A vehicle whose centre is nearer to the corridor's line stands in its middle."""
    merge_s: float = 1.5
    """Time of the lateral move into the corridor, at the present speed."""
    merge_min_m: float = 8.0
    """Least length of that move."""
    line_smoothing_m: float = 5.0
    """Way before and after the place where a lane begins over which the corridor's line moves aside, at least."""
    same_offset_m: float = 0.5
    """Two corridors that lie nearer to each other than this lead to the same place."""


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
    squeezes: tuple[tuple[float, float], ...] = ((0.3, 5.6), (0.15, 1.8), (0.08, 0.8))
    """Margins around the footprint in metres, the wider first, and the speed with each in m/s."""
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
    crossing_s: float = 3.75
    """The same for vehicles that cross the EMV's direction."""
    oncoming_s: float = 6.5
    """The same for oncoming vehicles: the EMV's time to the horizon at its target speed, and one second."""
    oncoming_watch_s: float = 3.0
    """The same in the watch: two vehicles at 20 and 50 km/h can stop before each other in it."""
    oncoming_m: float = 90.0
    """How far beyond the horizon vehicles are looked for in the search: 50 km/h for that time."""
    brake_mps2: float = 2.5
    """Deceleration laid out for tight places and stops on the path."""
    bend_accel_mps2: float = 1.2
    """Lateral acceleration in the bends of an escape path: slow enough to keep the margins."""
    steer_share: float = 0.5
    """Part of the steering's rate that an escape path may ask for, relative to other paths."""
    off_path_m: float = 0.3
    """Distance from the path at which another one is looked for."""
    edge_overhang_m: float = 0.3
    """How far the body may overhang the edge of the road."""
    touch_m: float = 0.06
    """Margin below which the path counts as blocked: more than the EMV strays from it."""
    stop_short_m: float = 0.4
    """Distance kept from the place on its path at which the EMV would touch somebody."""
    leader_brake_mps2: float = 4.0
    """Deceleration expected of vehicles ahead that move in the EMV's direction."""
    blocker_range_m: float = 15.0
    """While the escape is active: free way in the EMV's lane below which the vehicle ahead still blocks it."""
    opposite_cost_m: float = 30.0
    """Free length that a path in the opposite lane must gain to be preferred."""
    shoulder_cost_m: float = 4.0
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


@dataclass(frozen=True)
class AnticipationConfig:
    """How the EMV approaches the vehicles ahead on its path."""

    brake_mps2: float = 1.2
    """Deceleration that is laid out for: a third of what a driver accepts as comfortable."""
    headway_s: float = 1.0
    standstill_gap_m: float = 6.0
    """The collision handling's own gap and a little more, so that it need not brake."""
    ease_off_mps2: float = 2.0
    """Greatest deceleration for anticipation alone."""
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

    speed_mps: float | None = None
    """Of a calibrated driver, in place of the draw and of what the view allows."""
    brake_mps2: float = 1.2
    """Deceleration laid out for, as for vehicles ahead."""
    ease_off_mps2: float = 2.0
    """Greatest deceleration for it, as for vehicles ahead."""
    stop_mps2: float = 3.0
    """Deceleration for somebody who comes into view, the navigator's comfortable one."""
    reaction_s: float = 0.5
    """Of a driver who expects somebody, with the foot at the brake."""
    standoff_m: float = 1.0
    """Distance kept from the nearest lane of the street from the side, as from conflicts."""
    least_mps: float = 2.5
    """Speed with which a driver noses out where the view allows less: who comes can see the EMV then."""
    view_m: float = 40.0
    """Distance before the line from which on the view counts."""
    view_step_m: float = 0.5


@dataclass(frozen=True)
class EmvConfig:
    """Route following of the emergency vehicle."""

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
    pass_from_m: float = 50.0
    """Distance from slow traffic ahead at which the EMV looks for a free lane or shoulder."""
    slow_below_mps: float = 3.0
    """Speed of the vehicle ahead below which traffic counts as slow."""
    pass_gain_m: float = 20.0
    """Free road that it must gain."""
    pass_return_m: float = 30.0
    """What is left of it ahead of the slow traffic, where it does not lead on: 4 s at 30 km/h for the way back."""
    escape_gap_m: float = 6.0
    """Standstill gap at levels with gap escape: room to pull out past the vehicle ahead without reversing."""
    stop_before_route_end_m: float = 3.0
    navigator: NavigatorConfig = field(
        default_factory=lambda: NavigatorConfig(
            standstill_gap_m=4.0,
            comfort_accel_mps2=2.0,
            path_brake_mps2=2.0,
            # From here the EMV needs the time that it leaves behind others who have just crossed.
            conflicts=YieldingConfig(room_m=2.0),
        )
    )
    replan_s: float = 1.0
    """Least time between two plans where SUMO's route and the path disagree."""
    aligned_rad: float = 0.3
    """Heading errors below it are left to the path tracking."""
    intent_pause_s: float = 1.0
    """SUMO's intent comes and goes from step to step; a request ends after a pause of this length."""


@dataclass(frozen=True)
class BehaviourConfig:
    """All parameters of the behaviour."""

    emv: EmvConfig = field(default_factory=EmvConfig)
    lane_change: LaneChangeConfig = field(default_factory=lambda: LaneChangeConfig(front_brake_mps2=2.0))
    """Of the EMV."""
    civilian_lane_change: LaneChangeConfig = field(
        default_factory=lambda: LaneChangeConfig(duration_s=2.0, length_min_m=12.0, rear_time_s=1.0, own_brake_mps2=1.0)
    )
    anticipation: AnticipationConfig = field(default_factory=AnticipationConfig)
    junction_entry: JunctionEntryConfig = field(default_factory=JunctionEntryConfig)
    yielding: YieldConfig = field(default_factory=YieldConfig)
    pull_over: PullOverConfig = field(default_factory=PullOverConfig)
    manoeuvring: ManoeuvringConfig = field(default_factory=ManoeuvringConfig)
    corridor: CorridorConfig = field(default_factory=CorridorConfig)
    gap_escape: GapEscapeConfig = field(default_factory=GapEscapeConfig)
    civilian_navigator: NavigatorConfig = field(default_factory=lambda: NavigatorConfig(ease_off_mps2=1.0))
