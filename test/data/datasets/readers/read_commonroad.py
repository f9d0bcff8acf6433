"""Reads a scenario with commonroad-io and checks it against CommonRoad's schema.

The schema that comes with commonroad-io 2026.1 still has the names of intersections that the library warns of.
"""

import json
import logging
import sys
import warnings
from pathlib import Path

import commonroad
from commonroad.common.file_reader import CommonRoadFileReader
from schema_errors import schema_errors

file = sys.argv[1]
logged = []
listener = logging.Handler(logging.WARNING)
listener.emit = lambda record: logged.append(record.getMessage())
logging.getLogger().addHandler(listener)
with warnings.catch_warnings(record=True) as warned:
    warnings.simplefilter("always")
    scenario, problems = CommonRoadFileReader(file).open()
network = scenario.lanelet_network
lanelets = {lanelet.lanelet_id: lanelet for lanelet in network.lanelets}
problem = next(iter(problems.planning_problem_dict.values()))
schema = next(Path(commonroad.__file__).parent.rglob("XML_commonRoad_XSD.xsd"))
errors = schema_errors(schema, Path(file).read_bytes().replace(b"<outgoing", b"<successors"))
answer = {
    "id": str(scenario.scenario_id),
    "dt": scenario.dt,
    "errors": errors[:20],
    "warnings": [*logged, *(str(warning.message) for warning in warned)],
    "behind_arms": [
        sum(
            len(getattr(arm, f"outgoing_{side}"))
            for intersection in network.intersections
            for arm in intersection.incomings
        )
        for side in ("right", "straight", "left")
    ],
    "crossed": [key for key, lanelet in lanelets.items() if not lanelet.polygon.shapely_object.is_valid],
    "lanelets": len(lanelets),
    "successors": sum(len(lanelet.successor) for lanelet in lanelets.values()),
    "both_ways": sum(key in lanelets[after].predecessor for key in lanelets for after in lanelets[key].successor),
    "adjacent": sum(bool(lanelet.adj_left_same_direction) for lanelet in lanelets.values() if lanelet.adj_left),
    "opposite": sum(not lanelet.adj_left_same_direction for lanelet in lanelets.values() if lanelet.adj_left),
    "lights": len(network.traffic_lights),
    "signs": len(network.traffic_signs),
    "intersections": len(network.intersections),
    "light_cycles": [
        [[str(element.state.value), element.duration] for element in light.traffic_light_cycle.cycle_elements]
        for light in network.traffic_lights
    ],
    "obstacles": {
        str(obstacle.obstacle_id - 6_000_000): [
            obstacle.obstacle_type.value,
            obstacle.initial_state.time_step,
            obstacle.prediction.trajectory.final_state.time_step,
            obstacle.prediction.trajectory.final_state.position.tolist(),
        ]
        for obstacle in scenario.dynamic_obstacles
    },
    "on_lanelet": sum(
        bool(network.find_lanelet_by_position([obstacle.initial_state.position])[0])
        for obstacle in scenario.dynamic_obstacles
    ),
    "start": problem.initial_state.position.tolist(),
    "goal_reached_by": problem.goal.state_list[0].time_step.end,
    "goal": list(problem.goal.state_list[0].position.shapely_object.centroid.coords[0]),
}
print(json.dumps(answer))
