"""Reads a scenario with commonroad-io and checks it against CommonRoad's schema.

The schema that comes with commonroad-io 2026.1 still has the names of intersections that the library warns of.
"""

import json
import logging
import sys
import warnings
from pathlib import Path

import commonroad
import xmlschema
from commonroad.common.file_reader import CommonRoadFileReader

file = sys.argv[1]
told = []
listener = logging.Handler(logging.WARNING)
listener.emit = lambda record: told.append(record.getMessage())
logging.getLogger().addHandler(listener)
with warnings.catch_warnings(record=True) as warned:
    warnings.simplefilter("always")
    scenario, problems = CommonRoadFileReader(file).open()
network = scenario.lanelet_network
lanelets = {lanelet.lanelet_id: lanelet for lanelet in network.lanelets}
problem = next(iter(problems.planning_problem_dict.values()))
schema = xmlschema.XMLSchema(next(Path(commonroad.__file__).parent.rglob("XML_commonRoad_XSD.xsd")))
text = Path(file).read_text(encoding="utf-8").replace("<outgoing", "<successors")
errors = sorted({f"{error.path} {error.reason}"[:200] for error in schema.iter_errors(text)})
print(
    json.dumps(
        {
            "id": str(scenario.scenario_id),
            "dt": scenario.dt,
            "errors": errors[:20],
            "warnings": [*told, *(str(one.message) for one in warned)],
            "behind_arms": [
                sum(len(getattr(arm, f"outgoing_{side}")) for one in network.intersections for arm in one.incomings)
                for side in ("right", "straight", "left")
            ],
            "crossed": [key for key, one in lanelets.items() if not one.polygon.shapely_object.is_valid],
            "lanelets": len(lanelets),
            "successors": sum(len(one.successor) for one in lanelets.values()),
            "both_ways": sum(
                key in lanelets[after].predecessor for key in lanelets for after in lanelets[key].successor
            ),
            "adjacent": sum(bool(one.adj_left_same_direction) for one in lanelets.values() if one.adj_left),
            "opposite": sum(not one.adj_left_same_direction for one in lanelets.values() if one.adj_left),
            "lights": len(network.traffic_lights),
            "signs": len(network.traffic_signs),
            "intersections": len(network.intersections),
            "light_cycles": [
                [[str(element.state.value), element.duration] for element in light.traffic_light_cycle.cycle_elements]
                for light in network.traffic_lights
            ],
            "obstacles": {
                str(one.obstacle_id - 6_000_000): [
                    one.obstacle_type.value,
                    one.initial_state.time_step,
                    one.prediction.trajectory.final_state.time_step,
                    one.prediction.trajectory.final_state.position.tolist(),
                ]
                for one in scenario.dynamic_obstacles
            },
            "on_lanelet": sum(
                bool(network.find_lanelet_by_position([one.initial_state.position])[0])
                for one in scenario.dynamic_obstacles
            ),
            "start": problem.initial_state.position.tolist(),
            "goal_reached_by": problem.goal.state_list[0].time_step.end,
            "goal": list(problem.goal.state_list[0].position.shapely_object.centroid.coords[0]),
        }
    )
)
