"""Checks a database with MetaDrive's own description, and replays it."""

import importlib.metadata
import importlib.util
import json
import logging
import sys
from pathlib import Path

import numpy as np

# MetaDrive fetches models and textures when it first starts. A replay that draws nothing needs none of them; empty
# files in their place keep it from asking for them.
home = Path(importlib.util.find_spec("metadrive").origin).parent
if not (home / "assets").exists():
    (home / "assets" / "textures" / "grass1").mkdir(parents=True)
    (home / "assets" / "textures" / "grass1" / "GroundGrassGreen002_COL_1K.jpg").touch()
    (home / "assets" / "version.txt").write_text(importlib.metadata.version("metadrive-simulator"))

from metadrive.engine.logger import set_log_level
from metadrive.envs.scenario_env import ScenarioEnv
from metadrive.policy.replay_policy import ReplayEgoCarPolicy
from metadrive.scenario.scenario_description import ScenarioDescription
from metadrive.scenario.utils import read_dataset_summary, read_scenario_data

folder = sys.argv[1]
set_log_level(logging.ERROR)
summary, names, _ = read_dataset_summary(folder)
scenario = read_scenario_data(f"{folder}/{names[0]}")
ScenarioDescription.sanity_check(scenario.to_dict(), check_self_type=True, valid_check=True)
ego = scenario["tracks"][scenario["metadata"]["sdc_id"]]["state"]["position"]
env = ScenarioEnv(
    {
        "data_directory": folder,
        "num_scenarios": 1,
        "agent_policy": ReplayEgoCarPolicy,
        "reactive_traffic": False,
        "use_render": False,
        "log_level": logging.ERROR,
        "no_static_vehicles": False,
    }
)
places, others = [], 0
try:
    env.reset(seed=0)
    offset = None
    for _ in range(scenario["length"] - 1):
        _, _, ended, cut, info = env.step([0.0, 0.0])
        places.append(list(map(float, env.agent.position)))
        others = max(others, len(env.engine.traffic_manager.spawned_objects))
        if ended or cut:
            break
finally:
    env.close()
replayed = np.array(places)
travelled = float(np.hypot(*np.diff(replayed, axis=0).T).sum())
recorded = float(np.hypot(*np.diff(ego[: len(replayed) + 1, :2], axis=0).T).sum())
answer = {
    "scenarios": len(names),
    "length": scenario["length"],
    "tracks": len(scenario["tracks"]),
    "types": {name: track["type"] for name, track in scenario["tracks"].items()},
    "features": len(scenario["map_features"]),
    "lights": len(scenario["dynamic_map_states"]),
    "steps": len(places),
    "travelled": travelled,
    "recorded": recorded,
    "others": others,
}
print(json.dumps(answer))
