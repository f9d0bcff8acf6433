"""Loads a dataset with nuscenes-devkit, draws a keyframe, and scores its own annotations as detections."""

import json
import sys
from pathlib import Path

import numpy as np
from nuscenes import NuScenes
from nuscenes.eval.common.config import config_factory
from nuscenes.eval.detection.evaluate import DetectionEval
from nuscenes.eval.detection.utils import category_to_detection_name
from nuscenes.utils.data_classes import LidarPointCloud
from nuscenes.utils.geometry_utils import points_in_box

root, split, out = sys.argv[1:4]
nusc = NuScenes("v1.0-siren", root, verbose=False)
scene = nusc.scene[0]
samples = [sample for sample in nusc.sample if sample["scene_token"] == scene["token"]]
last = max(samples, key=lambda sample: sample["timestamp"])

hits, without_velocity = [], []
for sample in samples:
    path, boxes, _ = nusc.get_sample_data(sample["data"]["LIDAR_TOP"])
    cloud = LidarPointCloud.from_file(path)
    for box in boxes:
        found = nusc.get("sample_annotation", box.token)
        hits.append([int(points_in_box(box, cloud.points[:3]).sum()), found["num_lidar_pts"]])
        if np.isnan(nusc.box_velocity(box.token)).any():
            without_velocity.append([found["prev"], found["next"]])
lidar_token = last["data"]["LIDAR_TOP"]
path = nusc.get_sample_data_path(lidar_token)
cloud = LidarPointCloud.from_file(path)
raw = np.fromfile(path, dtype=np.float32)
history, times = LidarPointCloud.from_file_multisweep(nusc, last, "LIDAR_TOP", "LIDAR_TOP", nsweeps=10)
for channel in ("LIDAR_TOP", "CAM_FRONT"):
    nusc.render_sample_data(last["data"][channel], out_path=f"{out}/{channel}.png", verbose=False)
nusc.explorer.render_pointcloud_in_image(last["token"], camera_channel="CAM_FRONT", out_path=f"{out}/points.png")

results = {}
for sample in samples:
    results[sample["token"]] = []
    for token in sample["anns"]:
        found = nusc.get("sample_annotation", token)
        name = category_to_detection_name(found["category_name"])
        if name is None or found["num_lidar_pts"] == 0:
            continue  # the devkit does not ask for boxes without a point
        attributes = [nusc.get("attribute", key)["name"] for key in found["attribute_tokens"]]
        speed = np.nan_to_num(nusc.box_velocity(token)[:2])
        results[sample["token"]].append(
            {
                "sample_token": sample["token"],
                "translation": found["translation"],
                "size": found["size"],
                "rotation": found["rotation"],
                "velocity": speed.tolist(),
                "detection_name": name,
                "detection_score": 0.9,
                "attribute_name": attributes[0],
            }
        )
meta = {"use_camera": False, "use_lidar": True, "use_radar": False, "use_map": False, "use_external": False}
answer = Path(out) / "results.json"
answer.write_text(json.dumps({"meta": meta, "results": results}))
evaluation = DetectionEval(
    nusc, config_factory("detection_cvpr_2019"), str(answer), split, str(Path(out) / "eval"), verbose=False
)
metrics, _ = evaluation.evaluate()
ego = nusc.get("ego_pose", nusc.get("sample_data", lidar_token)["ego_pose_token"])
mask = nusc.map[0]["mask"]
answer = {
    "samples": len(samples),
    "channels": sorted(last["data"]),
    "hits": hits,
    "without_velocity": without_velocity,
    "floats": len(raw) // 5 if len(raw) % 5 == 0 else -1,
    "points": cloud.nbr_points(),
    "sweeps": len(set(np.round(times[0], 3).tolist())),
    "history_s": float(times.max()),
    "car_ap": metrics.serialize()["mean_dist_aps"]["car"],
    "car_errors": metrics.serialize()["label_tp_errors"]["car"],
    "on_road": bool(mask.is_on_mask(ego["translation"][0], ego["translation"][1])[0]),
    "categories": sorted({row["category_name"] for row in nusc.sample_annotation}),
    "speeds": [
        [float(np.hypot(*nusc.box_velocity(t)[:2])), nusc.get("sample_annotation", t)["instance_token"]]
        for t in samples[1]["anns"]
    ],
}
print(json.dumps(answer))
