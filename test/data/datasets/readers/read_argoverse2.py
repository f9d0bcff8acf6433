"""Loads a scenario and its map with av2 and draws it."""

import json
import sys
from pathlib import Path

import numpy as np
from av2.datasets.motion_forecasting import scenario_serialization
from av2.map.map_api import ArgoverseStaticMap

folder = Path(sys.argv[1])
(file,) = folder.glob("scenario_*.parquet")
scenario_id = file.stem.split("_")[-1]
scenario = scenario_serialization.load_argoverse_scenario_parquet(file)
static_map = ArgoverseStaticMap.from_json(folder / f"log_map_archive_{scenario_id}.json")
focal = next(track for track in scenario.tracks if track.track_id == scenario.focal_track_id)
places = np.array([state.position for state in focal.object_states])
segments = static_map.vector_lane_segments
linked = sum(index in segments[after].predecessors for index, lane in segments.items() for after in lane.successors)
on_road = static_map.get_nearby_lane_segments(places[49], 5.0)
crossings = static_map.get_scenario_ped_crossings()
areas = static_map.get_scenario_vector_drivable_areas()


def inside(area, place):
    """Whether a place lies in an outline, by crossings of a ray."""
    x, y = area.xyz[:-1, 0], area.xyz[:-1, 1]
    a, b = np.roll(x, -1), np.roll(y, -1)
    crosses = (y > place[1]) != (b > place[1])
    at = x + (place[1] - y) / np.where(b == y, 1.0, b - y) * (a - x)
    return bool((crosses & (place[0] < at)).sum() % 2)


answer = {
    "id": scenario.scenario_id,
    "focal": scenario.focal_track_id,
    "timesteps": [state.timestep for state in focal.object_states],
    "observed": sum(state.observed for state in focal.object_states),
    "places": places.tolist(),
    "headings": [state.heading for state in focal.object_states],
    "categories": {track.track_id: int(track.category.value) for track in scenario.tracks},
    "type_of": {track.track_id: track.object_type.name for track in scenario.tracks},
    "period_s": float(np.diff(scenario.timestamps_ns).mean() / 1e9),
    "lanes": len(segments),
    "links": sum(len(lane.successors) for lane in segments.values()),
    "links_both_ways": linked,
    "neighbours": sum(lane.left_neighbor_id is not None for lane in segments.values()),
    "neighbours_both_ways": sum(
        segments[lane.left_neighbor_id].right_neighbor_id == index
        for index, lane in segments.items()
        if lane.left_neighbor_id is not None
    ),
    "junction_lanes": sum(lane.is_intersection for lane in segments.values()),
    "near": len(on_road),
    "crossings": len(crossings),
    "driven_inside": sum(any(inside(area, place) for area in areas) for place in places),
}
print(json.dumps(answer))
