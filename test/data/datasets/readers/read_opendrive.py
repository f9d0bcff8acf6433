"""Loads an OpenDRIVE map with CARLA's own library and finds places on it (y to the right)."""

import json
import sys
from pathlib import Path

import carla

file, places = sys.argv[1], json.loads(sys.argv[2])
world = carla.Map("map", Path(file).read_text(encoding="utf-8"))
on_lanes = []
for x, y in places:
    place = carla.Location(x=x, y=-y, z=0.0)
    waypoint = world.get_waypoint(place, project_to_road=True, lane_type=carla.LaneType.Driving)
    there = waypoint.transform
    on_lanes.append(
        [there.location.x, -there.location.y, -there.rotation.yaw, waypoint.lane_width, waypoint.is_junction]
    )
print(json.dumps({"places": on_lanes, "topology": len(world.get_topology())}))
