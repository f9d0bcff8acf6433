"""Whole networks and what is derived from them, of the made maps, as stored next to this file."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from known_outputs import assert_known
from made_crossing import ARMS, CROSSING, made_net
from made_district import write_district
from repository import REPOSITORY

from siren_ros.simulation.roads.maps.map_compiler import (
    CompiledMap,
    compile_map,
    mirrored_map,
    with_shoulders_in_use,
    with_speed_limit,
)
from siren_ros.simulation.roads.maps.road_space import with_space
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import Connection, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import (
    EdgeGraph,
    civilian_movements,
    crossing_connections,
    has_right_of_way,
    is_out_of_town,
    is_plain_joint,
    movement_turn_rad,
    opposite_edges,
    path_centre,
    quiet_reach_m,
    rescue_boundary_m,
    rescue_sides,
    route_path,
    same_direction_connections,
)
from siren_ros.simulation.roads.site_finder import find_sites, places_without_site
from siren_ros.simulation.roads.sites import SiteKind, bridges, middle_of_site, overlaps

KNOWN = Path(__file__).parent / "known"
MAPS = REPOSITORY / "test" / "maps"


@pytest.fixture(name="networks", scope="module")
def _networks(town, district, cache):
    """By name, each with the stride with which its lanes and movements are stored."""
    crossing = parse_road_network(made_net(cache, CROSSING, ARMS, narrow="n"))
    by_file = {
        name: parse_road_network(compile_map(MAPS / name, cache).read_bytes()) for name in ("bends.xodr", "signs.osm")
    }
    return {
        "crossing": (crossing, 1), "bends": (by_file["bends.xodr"], 1), "signs": (by_file["signs.osm"], 2),
        "district": (district, 9), "town": (town, 11),
        "motorway": (parse_road_network(compile_map(Path("motorway"), cache).read_bytes()), 6),
        "city": (parse_road_network(compile_map(Path("city"), cache).read_bytes()), 17),
    }  # fmt: skip


def of_lane(network: RoadNetwork, lane: Lane) -> list[object]:
    heading = [float(lane.centre.heading_rad(share * lane.length_m)) for share in (0.0, 0.5)]
    flags = "".join("ec"[k] for k, allowed in enumerate((lane.emergency_allowed, lane.civilian_allowed)) if allowed)
    driving = lane.kind is LaneKind.DRIVING
    return [
        lane.lane_id, lane.kind, flags, lane.width_m, lane.speed_limit_mps, lane.length_m, *lane.centre.at(1.0),
        *heading,        len(lane.centre.points), rescue_boundary_m(network, lane.index) if driving else None,
        quiet_reach_m(network, lane.index, 500.0), int(rescue_sides(network)[lane.index]),
    ]  # fmt: skip


def of_movement(network: RoadNetwork, movement: Connection) -> list[object]:
    crossed = crossing_connections(network, movement)
    first = [other for other in crossed if has_right_of_way(network, movement, network.connections[other])]
    flags = [movement.must_stop, movement.gives_way, movement.alternates, is_plain_joint(network, movement)]
    return [
        network.lanes[movement.from_lane].lane_id, network.lanes[movement.to_lane].lane_id, movement.direction,
        movement.signal_id, movement.signal_link, movement.yellow_s, "".join("01"[flag] for flag in flags),
        network.length_m(movement.via), movement_turn_rad(network, movement), crossed, first,
        same_direction_connections(network, movement),
    ]  # fmt: skip


def of_network(network: RoadNetwork, stride: int) -> dict[str, object]:
    graph = EdgeGraph.of(network)
    roads = [edge for edge in network.edges if not edge.internal][::stride]
    ways = (f"{way.direction} {way.signal_id is not None:d}{way.must_stop:d}" for way in network.connections)
    all_kinds = (one.kind for one in network.lanes), (one.kind for one in network.junctions.values()), ways
    cycles = [of_movement(network, one) for one in network.cycle_connections[::stride]]
    return {
        "frame": [network.sumo_offset_m, network.projection, network.origin_lat_lon_deg, network.left_hand],
        "lanes": [of_lane(network, lane) for lane in network.lanes[::stride]],
        "roads": [
            [
                edge.edge_id,
                edge.from_junction,
                edge.to_junction,
                edge.name,
                edge.prolonged_m,
                is_out_of_town(network, edge.index),
                opposite_edges(network).get(edge.index),
            ]
            for edge in roads
        ],
        "endless": graph.endless_edges,
        "kinds": [sorted(Counter(kinds).items()) for kinds in all_kinds],
        "movements": [of_movement(network, one) for one in network.connections[::stride]],
        "cycle movements": cycles,
        "junctions": [
            [one.junction_id, one.kind, one.x_m, one.y_m, len(one.outline), *one.outline.mean(axis=0)]
            for one in [*network.junctions.values()][::stride]
            if len(one.outline)
        ],
        "crossings": [[len(outline), *outline.mean(axis=0)] for outline in network.crossings],
        "bridges": [[a, b, *points.mean(axis=0)] for a, b, points in bridges(network)],
        "overlaps": [[*lanes, *ways] for lanes, ways in [*overlaps(network).items()][:: 2 * stride]],
    }


@pytest.mark.parametrize("name", ["crossing", "bends", "signs", "district", "town", "motorway", "city"])
def test_networks(networks, name: str) -> None:
    assert_known(KNOWN / f"{name}.json", of_network(*networks[name]), digits=5, decimals=3)


def of_sites(network: RoadNetwork, kind: SiteKind) -> list[object]:
    """The best two sites of a kind with the way over them, the number of all, and what other places lack."""
    rows: list[object] = []
    sites = find_sites(network, kind)
    for site in sites[:2]:
        first = route_path(network, site.route, site.approach_lane) if site.site_position == 0 else ()
        way = path_centre(network, first) if first else None
        ahead = civilian_movements(network, site.site_edge, site.beyond[0]) if site.beyond else ()
        middle = middle_of_site(
            network, {"junction": site.junction or "", "stretch": [network.edges[k].edge_id for k in site.stretch]}
        )
        rows.append([site, way and [way.length_m, *way.at(way.length_m / 2)], len(ahead), middle])
    return [len(sites), *rows, sorted(Counter(place.lacking for place in places_without_site(network, kind)).items())]


@pytest.mark.parametrize("name", ["signs", "district", "town", "motorway"])
def test_sites(networks, name: str) -> None:
    network, _ = networks[name]
    known = {kind.value: of_sites(network, kind) for kind in SiteKind}
    assert_known(KNOWN / f"sites_{name}.json", known, digits=5, decimals=3)


def of_map(compiled: CompiledMap) -> dict[str, object]:
    """Lanes by kind, limit and permission with their total length, and movements by direction."""
    network = parse_road_network(compiled.read_bytes())
    lengths: dict[str, list[float]] = {}
    for lane in network.lanes:
        allowed = f"{lane.emergency_allowed:d}{lane.civilian_allowed:d}"
        key = f"{lane.kind} {lane.speed_limit_mps:.1f} {lane.width_m:.2f} {allowed}"
        row = lengths.setdefault(key, [0, 0.0, 0.0, 0.0])
        row[0] += 1
        row[1:] = np.add(row[1:], [lane.length_m, *lane.centre.at(lane.length_m / 2) / 100.0]).tolist()
    directions = Counter(f"{one.direction} {one.signal_link >= 0:d}" for one in network.connections)
    return {"lanes": dict(sorted(lengths.items())), "movements": dict(sorted(directions.items()))}


def test_changed_maps(cache) -> None:
    """What episodes do to maps before they drive on them."""
    town, bends = compile_map(None, cache), compile_map(MAPS / "bends.xodr", cache)
    for_people = compile_map(write_district(cache), cache, for_people=True)
    known = {
        "for people": of_map(for_people), "slow": of_map(with_speed_limit(town, 8.0)),
        "shoulders in use": of_map(with_shoulders_in_use(town)), "mirrored": of_map(mirrored_map(for_people)),
        "wide lanes": of_map(with_space(bends, "wide_lane", None)),
    }  # fmt: skip
    assert_known(KNOWN / "changed_maps.json", known, digits=5, decimals=3)
