"""Derives each scenario's road boundary with CommonRoad's drivability checker; tells who touches it, and when."""

import json
import sys

from commonroad.common.file_reader import CommonRoadFileReader
from commonroad_dc.boundary.boundary import create_road_boundary_obstacle
from commonroad_dc.collision.collision_detection.pycrcc_collision_dispatch import create_collision_object

answers = []
for file in sys.argv[1:]:
    scenario, _ = CommonRoadFileReader(file).open()
    _, boundary = create_road_boundary_obstacle(scenario)
    touching = {}
    for obstacle in scenario.dynamic_obstacles:
        body = create_collision_object(obstacle)
        steps = range(body.time_start_idx(), body.time_end_idx() + 1)
        touched = [step for step in steps if boundary.collide(body.obstacle_at_time(step))]
        if touched:
            touching[obstacle.obstacle_id - 6_000_000] = touched
    answers.append({"obstacles": len(scenario.dynamic_obstacles), "touching": touching})
print(json.dumps(answers))
