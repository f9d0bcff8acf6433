"""Reads scenarios with scenariogeneration, and checks them against the schemas that come with it."""

import contextlib
import io
import json
import re
import sys
from pathlib import Path

import scenariogeneration
from scenariogeneration import xosc
from schema_errors import schema_errors


def told(file: str) -> dict:
    """What is found in a scenario."""
    document = Path(file).read_bytes()
    minor = re.search(rb'revMinor="(\d)"', document).group(1).decode()
    schema = next(Path(scenariogeneration.__file__).parent.parent.rglob(f"OpenSCENARIO_1_{minor}.xsd"))
    with contextlib.redirect_stdout(io.StringIO()):
        scenario = xosc.ParseOpenScenario(file)
    act = scenario.storyboard.stories[0].acts[0]
    paths = {}
    for group in act.maneuvergroup:
        for event in group.maneuvers[0].events:
            action = event.action[0].action
            if isinstance(action, xosc.FollowTrajectoryAction):
                line = action.trajectory.shapes
                places = [[place.x, place.y, place.h] for place in line.positions]
                paths[group.actors.actors[0].entity] = [list(map(float, line.time)), places]
    return {
        "errors": schema_errors(schema, document)[:10],
        "entities": [entity.name for entity in scenario.entities.scenario_objects],
        "kinds": {
            entity.name: [type(entity.entityobject).__name__, getattr(entity.entityobject, kind).name]
            for entity in scenario.entities.scenario_objects
            for kind in ("vehicle_type", "category")
            if hasattr(entity.entityobject, kind)
        },
        "road": scenario.roadnetwork.road_file,
        "init": len(scenario.storyboard.init.initactions),
        "paths": paths,
    }


print(json.dumps([told(file) for file in sys.argv[1:]]))
