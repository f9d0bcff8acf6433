"""Chooses where an episode happens: among sites with all that a template needs, by the seed."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from itertools import pairwise
from typing import Final

import shapely

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.errors import InputError, MapError
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.roads.maps.amended_map import amended_map, places_for
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import MAPS_KEPT, LaneKind, RoadNetwork, right_hand_image
from siren_ros.simulation.roads.routing import (
    EdgeGraph,
    civilian_movements,
    crossing_connections,
    driving_lanes,
    quiet_reach_m,
)
from siren_ros.simulation.roads.site_finder import find_sites, places_without_site
from siren_ros.simulation.roads.sites import EXIT_M, REQUIREMENTS, Control, Lack, Site, SiteKind, bridges, overlaps
from siren_ros.simulation.scenario.scenario import EmvDemand, GroupAnchor, Placement, StartReference, Template
from siren_ros.simulation.traffic.demand.demand import plan_traffic
from siren_ros.simulation.traffic.demand.emv_start import (
    LEAST_QUEUE_M,
    LITTLE_BEHIND,
    Approach,
    approach_to,
    stays_inside,
)
from siren_ros.simulation.traffic.demand.group_rows import QUEUED_CAR_M, connection_from
from siren_ros.simulation.traffic.demand.plan import DriverPopulation, TrafficPlan
from siren_ros.simulation.traffic.demand.road_users import Dimensions
from siren_ros.simulation.world.actors import ActorClass

_RESCUE_M: Final = 6.6
"""Least width of two lanes with a rescue lane: an ambulance (2.1 m) with 0.2 m on each side, and two vans (2.02 m)."""
_NO_BRIDGE_M: Final = 300.0
"""Motorway stretches without a bridge within this distance are preferred: traffic starts within it (``DISTRICT_M``),
and where roads cross, traffic of both waits in this flat world."""
_JUNCTION_M: Final = 10.0
"""Length of road behind a site that its junction may cover."""
_NO_SHOULDER: Final = frozenset({SiteKind.MULTI_LANE_ROAD, SiteKind.QUEUED_APPROACH})
"""Kinds of sites at which the EMV needs others to make way; on a free shoulder it could pass without that."""
_ROW_M: Final = 4.0 * QUEUED_CAR_M
"""Road for a row that crosses until the EMV comes."""
_CROSSED: Final = frozenset({SiteKind.SIGNAL_JUNCTION, SiteKind.STOP_JUNCTION})


@dataclass(frozen=True)
class SitesToTry:
    """Sites in the order in which an episode tries them."""

    sites: tuple[Site, ...]
    best: Site
    """The best-rated site of the kind; errors name it."""
    shown_map: str


def ranked_sites(network: RoadNetwork, template: Template) -> tuple[tuple[Site, int], ...]:
    """All sites of a template's kind with the rank of their approach (``Approach``), best first."""
    return tuple((site, approach.rank) for site, approach in _approached(network, template.site_kind, template.emv))


@lru_cache(maxsize=MAPS_KEPT)
def _approached(network: RoadNetwork, kind: SiteKind, emv: EmvDemand) -> tuple[tuple[Site, Approach], ...]:
    sites = [(site, approach_to(network, site, emv)) for site in find_sites(network, kind)]
    return tuple(sorted(sites, key=lambda site_and_approach: site_and_approach[1].rank))


def good_sites(network: RoadNetwork, template: Template) -> tuple[Site, ...]:
    """Sites with all that a template needs, best first. A seed draws only among these."""
    return tuple(site for site, lacking in shortcomings(network, template).items() if not lacking)


def shortcomings(network: RoadNetwork, template: Template) -> dict[Site, tuple[Lack, ...]]:
    """What each site of a template's kind lacks, best first; empty for good ones.

    * The EMV drives up without a junction on the way and without sharp bends, and has road behind the site.
    * Under a signal it goes straight on. In a turn it meets oncoming vehicles, too, and waits for them inside.
    * Another lane leads on beside its own, where vehicles of the template drive there. Vehicles that need only have its
      direction drive ahead of it where no site of the map has a second lane.
    * The junction is so large that who passes at the end of the green is inside when the EMV comes. No signal or stop
      sign right behind it holds up those who pass. Both hold where a map has such a site.
    * Nobody stands inside before a signal or stop sign right behind. A row of vehicles fits on a road from which others
      come across, and not all of these are held up behind the junction; both hold where a map has such a site.
    * A stream with which the EMV comes has green for longer at the lines close behind, where they are of one signal.
    * Of those who come across, somebody crosses the EMV's lane, and not only lanes that lead on beside it.
    * Where nobody has to stop, the EMV uses its right only before traffic that the template brings. Of all-way stops,
      two-way stops, give-way lines and junctions without any control, the first kind that a map has is taken.
    * No other road crosses a motorway on a bridge: vehicles of both would meet, since the world is flat.
    * No other road lies over it: drivers can make way for each other there, but not for the EMV, too.
    * Roads are long enough and do not end at a stop sign, from which one vehicle after the other would go.
    * Queues are on a road that is long enough without a junction and without a turning lane, which would stay empty.
      Beside a shoulder, a signal or a stop sign holds them.
    * Roads and queues without a shoulder are taken alone where there are any; so are roads that are long enough without
      a junction, from which others join and to which drivers who make way cannot turn.
    """
    found, needs_m = {}, needed_m(template)
    for site, approach in _approached(network, template.site_kind, template.emv):
        lacking = (text for text, has in _CONDITIONS.items() if not has(network, site, template))
        lacks = (Lack(text.format(needed_m=needs_m)) for text in lacking)
        found[site] = tuple(dict.fromkeys(filter(None, (approach.flaw, *lacks))))
    if _has_group(template, Placement.SAME_DIRECTION):
        _prefer(found, _ONE_LANE, lambda site: len(site.connections) > 1)
        _prefer(found, _SMALL, lambda site: all(stays_inside(network, site, group) for group in template.demand.groups))
    if template.site_kind in _CROSSED:
        _prefer(found, _HELD_UP, lambda site: _exit_m(network, site) >= LEAST_QUEUE_M)
    if _has_group(template, Placement.CROSSING):
        _prefer(found, _SHORT_SIDE, lambda site: _side_m(network, site) >= _ROW_M)
        _prefer(found, _HELD_ACROSS, lambda site: any(not _is_held_up(network, index) for index in site.crossing))
    for control in Control:
        _prefer(found, WEAKER, partial(_is_controlled, control))
    if template.site_kind in _NO_SHOULDER:
        _prefer(found, _SHOULDER, lambda site: not has_shoulder(network, site))
    if template.site_kind is SiteKind.MOTORWAY_STRETCH:
        _prefer(found, _BRIDGE, lambda site: _far_from_bridges(network, site))
        _prefer(found, LITTLE_BEHIND, lambda site: _behind_m(network, site) >= EXIT_M - _JUNCTION_M)
    if template.site_kind is SiteKind.MULTI_LANE_ROAD:
        _prefer(found, _JOINED, lambda site: quiet_reach_m(network, site.approach_lane, needs_m) >= needs_m)
    return found


def count_lacks(
    network: RoadNetwork, template: Template, found: Mapping[Site, tuple[Lack, ...]]
) -> tuple[Counter[str], Counter[str]]:
    """How many places of a map lack what for a template, and how many sites lack this alone.

    The places are the sites that are not good, and the roads or junctions that are no site. Of the latter the first
    missing thing counts, and nobody knows whether they lack more. ``found`` is what the sites lack (``shortcomings``).
    """
    sites = [{lack.text for lack in lacking} for lacking in found.values()]
    places = Counter(place.lacking for place in places_without_site(network, template.site_kind))
    places.update(text for lacking in sites for text in lacking)
    return places, Counter(text for lacking in sites if len(lacking) == 1 for text in lacking)


def _prefer(found: dict[Site, tuple[Lack, ...]], text: str, preferred: Callable[[Site], bool]) -> None:
    """Add a shortcoming to good sites that are not preferred, if a preferred site is good."""
    good = [(site, preferred(site)) for site, lacking in found.items() if not lacking]
    if any(is_preferred for _, is_preferred in good):
        found.update({site: (Lack(text),) for site, is_preferred in good if not is_preferred})


_MADE_BY: Final[Mapping[SiteKind, str]] = {
    SiteKind.QUEUED_APPROACH: "signal",
    SiteKind.SIGNAL_JUNCTION: "signal",
    SiteKind.STOP_JUNCTION: "all_way_stop",
    SiteKind.SHOULDER_RIGHT_TURN: "shoulder",
}
"""Additions to a map (``ADDITIONS``) that make sites of a kind."""
_TRIED: Final = 3
"""Sites that are tried for a proposal."""


def proposed(net: bytes, template: Template, shown: str) -> tuple[str, str, tuple[str, ...]]:
    """What could be added to a compiled map that has no good site for a template.

    All places get the same addition, which shows where good sites could be; then the best ones alone are tried.

    Args:
        net: The map.
        template: The template.
        shown: The map's name in errors.

    Returns:
        The name of the site that becomes good, what it lacks, and texts for ``amended_map``; empty without one.
    """
    network = right_hand_image(parse_road_network(net))
    lacks = {site.name: "; ".join(map(str, lacking)) for site, lacking in shortcomings(network, template).items()}
    others = {place.edge: place.lacking for place in places_without_site(network, template.site_kind)}
    for kind in (_MADE_BY.get(template.site_kind, ""), "longer" if lacks else ""):
        places = places_for(network).get(kind, ())
        for name, names in _good_after(net, [f"{kind}:{place}" for place in places], template, shown)[:_TRIED]:
            additions = tuple(f"{kind}:{place}" for place in names if place in places)
            if name in dict(_good_after(net, additions, template, shown)):
                edge = network.edge_by_id[name.partition("..")[0]].index
                return name, lacks.get(name) or others.get(edge, ""), additions
    return "", "", ()


def _good_after(
    net: bytes, additions: Sequence[str], template: Template, shown: str
) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """The names of the good sites of an amended map, each with those of its junction and of the edges on its way."""
    if not additions:
        return ()
    try:
        network = right_hand_image(parse_road_network(amended_map(net, additions, shown)))
    except MapError:  # netconvert refuses it
        return ()
    found = []
    for site in good_sites(network, template):
        turn = (site.site_edge, *site.beyond[:1])
        edges = turn if site.kind is SiteKind.SHOULDER_RIGHT_TURN else site.route
        found.append(
            (site.name, (site.junction or "", *(network.edges[edge].edge_id for edge in dict.fromkeys(edges))))
        )
    return tuple(found)


def needed_m(template: Template) -> float:
    """Length of road that a template needs for the rows of vehicles with which it begins, at its default values.

    Before a stop line these start between the line and the EMV. On a road they start ahead of the EMV, each vehicle
    with its spacing, and with the mean length of the template's classes. Where the EMV has to pass some of those in its
    lane, it needs the way on which it comes past them at its speed, while they drive at the limit.
    """
    groups = [group for group in template.demand.groups if group.anchor is GroupAnchor.EMV and not group.optional]
    if template.emv.start_from is StartReference.STOP_LINE:
        return max((-template.emv.start_m - group.first_gap_m for group in groups), default=0.0)
    mean_m = sum(share * _lengths_m()[member] for member, share in template.demand.classes)
    rows_m = [group.first_gap_m + group.vehicles * (group.spacing_m + mean_m) for group in groups]
    passed, emv_mps = template.predicate.thresholds.get("passed_min", 0.0), template.emv.speed_mps
    closing_mps = emv_mps - template.demand.speed_factor * template.demand.speed_limit_mps
    for group in groups if passed and closing_mps > 0.0 else ():
        ahead_m = group.first_gap_m + passed * mean_m + (passed - 1.0) * group.spacing_m
        rows_m += [ahead_m * emv_mps / closing_mps] * (group.placement is Placement.EMV_LANE)
    return template.emv.start_m + max(rows_m, default=0.0)


@cache
def _lengths_m() -> Mapping[ActorClass, float]:
    return {member: vehicle.length_m for member, vehicle in load_vehicle_parameters().items()}


def _is_controlled(control: Control, site: Site) -> bool:
    return site.control is control


def has_shoulder(network: RoadNetwork, site: Site) -> bool:
    """Whether a shoulder runs along part of the site's stretch of road."""
    lanes = (network.lanes[lane] for edge in site.stretch for lane in network.edges[edge].lanes)
    return any(lane.kind is LaneKind.SHOULDER for lane in lanes)


def _road_fits(_: RoadNetwork, site: Site, template: Template) -> bool:
    return site.kind is not SiteKind.MULTI_LANE_ROAD or site.length_m >= needed_m(template)


def _queues_fit(network: RoadNetwork, site: Site, template: Template) -> bool:
    return site.kind is not SiteKind.QUEUED_APPROACH or _usable_m(network, site) >= needed_m(template)


def _jam_fits(_: RoadNetwork, site: Site, template: Template) -> bool:
    return site.kind is not SiteKind.MOTORWAY_STRETCH or site.length_m >= needed_m(template)


def _corridor_free(network: RoadNetwork, site: Site, _: Template) -> bool:
    leftmost = (network.lanes[network.edges[edge].lanes[-1]] for edge in site.stretch)
    corridor = site.kind in {SiteKind.MOTORWAY_STRETCH, SiteKind.QUEUED_APPROACH}
    return not corridor or all(lane.civilian_allowed or lane.kind is not LaneKind.DRIVING for lane in leftmost)


def _has_rescue_lane(network: RoadNetwork, site: Site, _: Template) -> bool:
    widths_m = (sum(lane.width_m for lane in driving_lanes(network, edge)[-2:]) for edge in site.stretch)
    return site.kind is not SiteKind.MOTORWAY_STRETCH or min(widths_m) >= _RESCUE_M


def _far_from_bridges(network: RoadNetwork, site: Site) -> bool:
    lanes = (driving_lanes(network, edge)[-1] for edge in site.stretch)
    stretch = shapely.union_all([shapely.LineString(lane.centre.points) for lane in lanes])
    places = (shapely.multipoints(points) for *_, points in bridges(network))
    return not any(shapely.dwithin(stretch, place, _NO_BRIDGE_M) for place in places)


def _no_bridge(network: RoadNetwork, site: Site, _: Template) -> bool:
    return site.kind is not SiteKind.MOTORWAY_STRETCH or not crossing_roads(network, site)


def crossing_roads(network: RoadNetwork, site: Site) -> frozenset[int]:
    """Edges that cross a site's stretch of road on a bridge, above it or below."""
    pairs = ((first, second) for first, second, _ in bridges(network))
    return frozenset(edge for pair in pairs if set(pair) & set(site.stretch) for edge in pair) - set(site.stretch)


def _lies_alone(network: RoadNetwork, site: Site, _: Template) -> bool:
    ways = {network.connections[way] for way in site.connections}
    lanes = {lane for way in ways for lane in (*way.via, way.to_lane)}
    lanes.update(lane for edge in site.stretch for lane in network.edges[edge].lanes)
    return not any(lane in lanes for lane, _ in overlaps(network))


def _leads_on(network: RoadNetwork, site: Site, template: Template) -> bool:
    spare_m = site.length_m - needed_m(template) if site.kind is SiteKind.MOTORWAY_STRETCH else 0.0
    return spare_m + _behind_m(network, site) >= EXIT_M - _JUNCTION_M


def _behind_m(network: RoadNetwork, site: Site) -> float:
    after = site.route[site.route.index(site.stretch[-1]) + 1 :]
    return sum(driving_lanes(network, edge)[-1].length_m for edge in after)


def _exit_m(network: RoadNetwork, site: Site) -> float:
    """Length of road behind a site's junction up to the next signal or stop sign."""
    length_m, after = 0.0, site.beyond
    for edge, following in zip(after, (*after[1:], None), strict=True):
        length_m += driving_lanes(network, edge)[-1].length_m
        ways = () if following is None else civilian_movements(network, edge, following)
        if length_m >= LEAST_QUEUE_M or any(way.has_stop_line for way in ways):
            break
    return length_m


def _is_held_up(network: RoadNetwork, index: int) -> bool:
    """Whether a movement leads to a short road that ends at a signal or stop sign."""
    lane = network.lanes[network.connections[index].to_lane]
    beside = driving_lanes(network, lane.edge) if lane.length_m < LEAST_QUEUE_M else []
    ways = (way for other in beside for way in network.connections_from.get(other.index, ()))
    return any(way.has_stop_line for way in ways)


def _side_m(network: RoadNetwork, site: Site) -> float:
    """Length of the longest road, without a junction, from which others come across."""
    lanes = {network.connections[index].from_lane for index in site.crossing}
    return max((quiet_reach_m(network, lane, _ROW_M) for lane in lanes), default=0.0)


def _is_left_free(network: RoadNetwork, site: Site, _: Template) -> bool:
    ends = [network.lanes[network.connections[index].to_lane] for index in (*site.connections, *site.crossing)]
    short = [
        way for lane in ends if lane.length_m < QUEUED_CAR_M for way in network.connections_from.get(lane.index, ())
    ]
    held = any(way.has_stop_line for way in short)
    return site.kind not in _CROSSED or not held


def _flows_on(network: RoadNetwork, site: Site, template: Template) -> bool:
    streams = [group for group in template.demand.groups if group.anchor is GroupAnchor.ARRIVAL and not group.optional]
    if not streams:
        return True
    own, room_m, way_m = network.connections[site.connections[-1]], QUEUED_CAR_M * sum(g.vehicles for g in streams), 0.0
    longer = {number + 1 for number in own.green_phases} - own.green_phases
    for edge, following in pairwise(site.beyond):
        way_m += driving_lanes(network, edge)[-1].length_m
        if way_m > room_m:
            break
        for way in civilian_movements(network, edge, following)[-1:]:
            if way.signal_id == own.signal_id and way.alternates and way.green_phases.isdisjoint(longer):
                return False
    return True


def _is_crossed(network: RoadNetwork, site: Site, template: Template) -> bool:
    if not _has_group(template, Placement.CROSSING):
        return True
    crossing_it = crossing_connections(network, network.connections[site.connections[-1]])
    return not set(crossing_it).isdisjoint(site.crossing)


def _has_lanes(_: RoadNetwork, site: Site, template: Template) -> bool:
    least = 2 if _has_group(template, Placement.ADJACENT_LANE) else site.kind is not SiteKind.MOTORWAY_STRETCH
    return len(site.connections) >= least


def _has_group(template: Template, placement: Placement) -> bool:
    """Whether the interaction needs a group at a placement."""
    return any(group.placement is placement and not group.optional for group in template.demand.groups)


def _goes_straight_on(network: RoadNetwork, site: Site, _: Template) -> bool:
    straight = {network.connections[index].direction for index in site.connections} <= {"s"}
    return straight or site.kind is not SiteKind.SIGNAL_JUNCTION


def _is_judged(_: RoadNetwork, site: Site, template: Template) -> bool:
    stops = site.control in {None, Control.ALL_WAY_STOP, Control.TWO_WAY_STOP}
    return stops or _has_group(template, Placement.CROSSING)


def _ends_free(network: RoadNetwork, site: Site, _: Template) -> bool:
    stopping = (network.connections[index].must_stop for index in site.connections)
    return site.kind is not SiteKind.MULTI_LANE_ROAD or not any(stopping)


def _holds_queue(network: RoadNetwork, site: Site, _: Template) -> bool:
    lanes = driving_lanes(network, site.site_edge)
    ways = [way for lane in lanes for way in network.connections_from.get(lane.index, ())]
    waits = any(way.must_stop or (way.signal_id is not None and way.alternates) for way in ways)
    return waits or site.kind is not SiteKind.SHOULDER_RIGHT_TURN


_CONDITIONS: Final[Mapping[str, Callable[[RoadNetwork, Site, Template], bool]]] = {
    "less than {needed_m:.0f} m of road without a signal or a stop sign": _road_fits,
    "less than {needed_m:.0f} m of road without a junction or a turning lane on the left": _queues_fit,
    "less than {needed_m:.0f} m on which nobody joins or leaves": _jam_fits,
    f"less than {_RESCUE_M:.1f} m on its two leftmost lanes": _has_rescue_lane,
    "a bridge, where traffic of both roads meets": _no_bridge,
    "a lane on its left that is not for cars": _corridor_free,
    "a road that lies over it, without a junction": _lies_alone,
    LITTLE_BEHIND: _leads_on,
    "no second lane that leads on beside the EMV's": _has_lanes,
    "a turn, where the EMV has to go straight on": _goes_straight_on,
    "no stop sign, and no traffic of the template to give way to": _is_judged,
    "a signal or stop sign right behind it, before which a car would stand inside": _is_left_free,
    "a line of its signal close behind it that does not stay green for longer": _flows_on,
    "nobody who comes across the lane that the EMV takes": _is_crossed,
    "a stop sign at its end": _ends_free,
    "no signal or stop sign, at which a queue would wait beside the shoulder": _holds_queue,
}
"""Conditions of good sites, by the text that says what is lacking; ``needed_m`` is that of the template."""
_BRIDGE: Final = f"a bridge less than {_NO_BRIDGE_M:.0f} m away, and others have none"
WEAKER: Final = "a weaker control, and others have a stronger one"
_ONE_LANE: Final = "one lane leads on, and others have a second one"
_SMALL: Final = "a junction that vehicles leave before the EMV comes, and others have a larger one"
_HELD_UP: Final = f"a signal or stop sign less than {LEAST_QUEUE_M:.0f} m behind it, and others have none"
_HELD_ACROSS: Final = (
    f"a signal or stop sign less than {LEAST_QUEUE_M:.0f} m behind it for all who come across, and others have none"
)
_SHOULDER: Final = "a shoulder, and others have none"
_SHORT_SIDE: Final = f"less than {_ROW_M:.0f} m of road from which others come across, and others have more"
_JOINED: Final = "a junction on the way on which vehicles change lanes, and others have none"


def _usable_m(network: RoadNetwork, site: Site) -> float:
    """Length of a queued approach on which the two leftmost lanes lead straight on, up to the next junction.

    The corridor opens between these: a turning lane on the left would be the EMV's way past both queues, one on the
    right has no part. Where the lanes of two queues grow out of one lane, the road before it has room for one queue.
    """
    plain, queues = [], {network.connections[way].from_lane for way in site.connections}
    for edge, before in zip(reversed(site.stretch), (*reversed(site.stretch[:-1]), None), strict=True):
        leftmost = {lane.index for lane in driving_lanes(network, edge)[-2:]}
        if len(queues) < 2:
            break
        plain += [edge] * (leftmost <= queues)
        steps = [] if before is None else [connection_from(network, lane, before) for lane in queues]
        queues = {step.from_lane for step in steps if step is not None}
    way_m = EdgeGraph.of(network).route_length_m(plain)
    return min(quiet_reach_m(network, site.approach_lane, way_m), way_m)


def sites_to_try(network: RoadNetwork, template: Template, seed: int, pinned: str, shown_map: str) -> SitesToTry:
    """The pinned site alone; otherwise good sites in an order drawn by the seed, then the others, best first.

    The level does not enter, nor do values that differ from the template's file.

    Raises:
        MapError: The map has no site of the template's kind.
        InputError: No site has the pinned name.
    """
    ranked = [site for site, _ in ranked_sites(network, template)]
    if not ranked:
        raise MapError(shown_map, REQUIREMENTS[template.site_kind])
    best = find_sites(network, template.site_kind)[0]
    if pinned:
        sites = tuple(site for site in ranked if site.name == pinned)
        if not sites:
            names = ", ".join(site.name for site in ranked)
            raise InputError("site", pinned, f"a site of {template.template_id} on {shown_map}: {names}")
        return SitesToTry(sites, sites[0], shown_map)
    good = good_sites(network, template)
    drawn = [good[place] for place in random_stream(seed, "site").permutation(len(good))]
    return SitesToTry((*drawn, *(site for site in ranked if site not in good)), best, shown_map)


def plan_at_site(
    network: RoadNetwork,
    to_try: SitesToTry,
    template: Template,
    seed: int,
    drivers: DriverPopulation,
    dimensions: Mapping[ActorClass, Dimensions],
) -> tuple[Site, TrafficPlan]:
    """Plan traffic at the first site at which the template's EMVs and groups can start.

    Args:
        network: The map.
        to_try: Sites in order.
        template: The scenario with its values.
        seed: The episode's seed.
        drivers: Population from which drivers are drawn.
        dimensions: Length, width and height of each vehicle class in metres.

    Raises:
        MapError: No site will do. It says what the map lacks, and what the best site does.
    """
    reasons = {}
    for site in to_try.sites:
        try:
            return site, plan_traffic(network, site, template, seed, drivers, dimensions)
        except MapError as error:
            reasons[site.name] = error.allowed
    best, count = to_try.best.name, len(to_try.sites)
    places = "the only place of this kind" if count == 1 else f"the best of {count} places of this kind"
    allowed = f"{REQUIREMENTS[template.site_kind]}, and that is {reasons[best]} ({places} is {best})"
    raise MapError(to_try.shown_map, allowed)
