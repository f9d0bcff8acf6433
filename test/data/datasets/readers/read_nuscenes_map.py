"""Loads a dataset's vector map with nuscenes-devkit, asks it about places, and draws the input of its predictors."""

import json
import sys

import numpy as np
from nuscenes import NuScenes
from nuscenes.map_expansion import map_api
from nuscenes.map_expansion.utils import get_egoposes_on_drivable_ratio
from nuscenes.prediction import PredictHelper
from nuscenes.prediction.input_representation.static_layers import StaticLayerRasterizer

root = sys.argv[1]
nusc = NuScenes("v1.0-siren", root, verbose=False)
helper = PredictHelper(nusc)
row = next(annotation for annotation in nusc.sample_annotation if annotation["prev"] or annotation["next"])
name = helper.get_map_name_from_sample_token(row["sample_token"])
try:
    map_api.NuScenesMap(root, name)
    refused = False
except AssertionError:
    refused = True
map_api.locations[:] = [name]  # the devkit knows its own four maps alone
nusc_map = map_api.NuScenesMap(root, name)
ego = nusc.get("ego_pose", nusc.get("sample_data", nusc.sample[0]["data"]["LIDAR_TOP"])["ego_pose_token"])
x, y = ego["translation"][:2]
lane = nusc_map.get_closest_lane(x, y)
centre = np.array(nusc_map.discretize_lanes([lane], 0.5)[lane])
nearest = int(np.hypot(*(centre[:, :2] - (x, y)).T).argmin())
followers = {key: nusc_map.get_outgoing_lane_ids(key) for key in nusc_map.connectivity}
paths = nusc_map.arcline_path_3
ends = [
    float(np.hypot(*np.subtract(paths[key][-1]["end_pose"][:2], paths[other][0]["start_pose"][:2])))
    for key, others in followers.items()
    for other in others
]
rasterizer = StaticLayerRasterizer(helper)
for loaded in (nusc_map, *rasterizer.maps.values()):
    loaded.map_name = "boston-seaport"  # the devkit asks for the size of one of its own maps, and does not use it
mask = nusc_map.get_map_mask((x, y, 100.0, 100.0), 0.0, ["drivable_area", "lane", "walkway"], (200, 200))
picture = rasterizer.make_representation(row["instance_token"], row["sample_token"])
answer = {
    "name": name,
    "refused": refused,
    "rows": {layer: len(getattr(nusc_map, layer)) for layer in nusc_map.layer_names},
    "layers": {layer: bool(key) for layer, key in nusc_map.layers_on_point(x, y).items()},
    "off_lane_m": float(np.hypot(*(centre[nearest, :2] - (x, y)))),
    "on_road": get_egoposes_on_drivable_ratio(nusc, nusc_map, nusc.scene[0]["token"]),
    "steps_m": ends,
    "known": all(other in nusc_map.connectivity for others in followers.values() for other in others),
    "cues": sorted({cue["traffic_light_type"] for line in nusc_map.stop_line for cue in line["cue"]}),
    "shares": mask.mean(axis=(1, 2)).tolist(),
    "picture": [*picture.shape, float(picture.std())],
}
print(json.dumps(answer))
