"""nuScenes' tables and files: categories, channels, the map, bytes of sweeps, and what nuscenes-devkit reads."""

import io
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from datasets import made_bag
from hand_made_record import crossing
from PIL import Image
from reader_environments import read_with
from scipy.spatial.transform import Rotation

from siren_ros.data.datasets import nuscenes_tables
from siren_ros.data.datasets.nuscenes import map_corners, mask_png, sweep_bytes, visible_fractions
from siren_ros.data.episode_source import MountedCamera, lidar_frames, open_source
from siren_ros.sensing.specification import Mount
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import CameraIntrinsics


def test_emergency_vehicles_are_cars_unless_they_have_their_own():
    car, emergency = nuscenes_tables.CAR, nuscenes_tables.EMERGENCY
    for member in ActorClass:
        own = nuscenes_tables.CATEGORY_OF_CLASS[member]
        found = [nuscenes_tables.category_of(member, *asked) for asked in ((car,), (emergency,), (emergency, car))]
        if member.is_emergency:
            assert found == [car, own, own]
            assert own.startswith("vehicle.emergency.")
        elif member is ActorClass.PEDESTRIAN:
            assert set(found) == {"human.pedestrian.adult"}
        else:
            assert found == [own, own, car]


@pytest.mark.parametrize(
    ("fraction", "level"), [(0.0, "1"), (0.39, "1"), (0.4, "2"), (0.6, "3"), (0.79, "3"), (0.8, "4"), (1.0, "4")]
)
def test_levels_of_visibility(fraction, level):
    assert nuscenes_tables.visibility_of(fraction) == level


def test_who_is_slower_than_a_foot_per_second_stands():
    attribute_of = nuscenes_tables.attribute_of
    assert attribute_of(ActorClass.BICYCLE, 0.31) == "cycle.with_rider"
    walks = ["pedestrian.moving", "pedestrian.standing"]
    assert [attribute_of(ActorClass.PEDESTRIAN, speed_mps) for speed_mps in (0.31, 0.29)] == walks
    drives = ["vehicle.moving", "vehicle.stopped"]
    assert [attribute_of(ActorClass.SEDAN, speed_mps) for speed_mps in (0.31, 0.29)] == drives


def test_fixed_tables_number_the_categories_from_one():
    tables = nuscenes_tables.fixed_tables()
    names = sorted(set(nuscenes_tables.CATEGORY_OF_CLASS.values()))
    assert {"human.pedestrian.adult", "vehicle.bicycle", "vehicle.motorcycle"} <= set(names)
    assert [(row["index"], row["name"]) for row in tables["category"]] == list(enumerate(names, start=1))
    assert tables["visibility"][1]["description"] == "visible fraction 40-60 %"
    assert tables["attribute"][0]["token"] == nuscenes_tables.token("attribute", "vehicle.moving")


def camera(name: str, yaw_deg: float) -> MountedCamera:
    mount = Mount(1.0, 0.0, 1.5, yaw_rad=np.radians(yaw_deg)).base_from_sensor
    optical = mount @ np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    model = CameraIntrinsics(8, 6, 4.0, 4.0, 4.0, 3.0)
    return MountedCamera(name=name, topic=name, base_from_sensor=optical, model=model, truth_topic="")


def test_channels_are_where_cameras_look():
    directions_deg = {
        "CAM_FRONT": (0.0, 29.0),
        "CAM_FRONT_LEFT": (55.0, 84.0),
        "CAM_FRONT_RIGHT": (-55.0,),
        "CAM_BACK_LEFT": (86.0, 149.0),
        "CAM_BACK_RIGHT": (-110.0,),
        "CAM_BACK": (151.0, 180.0, -175.0),
    }
    for channel, yaws_deg in directions_deg.items():
        for yaw_deg in yaws_deg:
            assert nuscenes_tables.channels((camera("one", yaw_deg),)) == {"one": channel}


def test_a_second_camera_of_a_direction_is_numbered():
    names = nuscenes_tables.channels((camera("a", 0.0), camera("b", 5.0), camera("c", -5.0), camera("d", 50.0)))
    assert names == {"a": "CAM_FRONT", "b": "CAM_FRONT_2", "c": "CAM_FRONT_3", "d": "CAM_FRONT_LEFT"}


def test_the_lidars_axes_are_right_and_ahead():
    """A point 5 m ahead and 2 m to the left."""
    assert (nuscenes_tables.NUSCENES_FROM_LIDAR @ [5.0, 2.0, 1.0, 1.0]).tolist() == [-2.0, 5.0, 1.0, 1.0]
    turned = np.eye(4)
    turned[:3, :3] = [[0.0, -1.0, 0], [1.0, 0, 0], [0, 0, 1.0]]
    assert nuscenes_tables.rotation_wxyz(turned) == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])


def test_the_mask_is_white_where_one_drives():
    """10 pixels for each metre from the lower left corner, 60 m beyond the outermost centre lines."""
    network = crossing()
    low, high = map_corners(network)
    assert (low.tolist(), high.tolist()) == ([-170.0, -180.0], [180.0, 170.0])
    image = Image.open(io.BytesIO(mask_png(network)))
    assert image.size == (3500, 3500)

    def at(x_m: float, y_m: float) -> int:
        return int(image.getpixel((round((x_m - low[0]) * 10), round(3500 - (y_m - low[1]) * 10))))

    # The approach from the south reaches from 0 to 9.5 m; then nothing until the road of its own from 12.25 m on.
    driven = [at(x_m, -70.0) / 255 for x_m in (0.3, 5.0, 9.2, 9.8, 12.0, 12.5, 15.5, 16.0)]
    assert driven == [1, 1, 1, 0, 0, 1, 1, 0]
    assert at(-5.0, 0.0) == 255, "the junction"
    assert at(60.0, 40.0) == 0


DATASET = ("nuscenes", "sensed_bag")
MADE_DATASET = ("nuscenes", "first_made_bag")
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("instance", "<u2")])
ID = "S2_L2_seed0_straight"
ORIGIN_M = np.array([-60.0, -66.0])
"""60 m beyond the outermost centre lines, which begin at x = 0 and lie at y = −5.25, in whole metres."""
KEY_STEPS = [10, 20, 30, 40]
STEPS = list(range(10, 42, 2))
CHANNELS = {"LIDAR_TOP", "CAM_FRONT", "CAM_BACK"}
Tables = dict[str, Any]


def test_points_have_x_to_the_right_and_y_ahead():
    points = np.array([(5.0, 2.0, -1.0, 0.2, 7, 0), (-3.0, -4.0, 0.5, 1.0, 31, 9)], dtype=POINT)
    read = np.frombuffer(sweep_bytes(points), dtype="<f4").reshape(-1, 5)
    assert read == pytest.approx(np.array([(-2.0, 5.0, -1.0, 51.0, 7.0), (4.0, -3.0, 0.5, 255.0, 31.0)]))


def labels(**shares: tuple[float, float]) -> Any:
    """A camera's labels by actor: visible share of what is in the picture, and how much is cut off."""
    return SimpleNamespace(
        actor_id=np.array([int(name[1:]) for name in shares]),
        visible_fraction=np.array([share for share, _ in shares.values()]),
        truncation=np.array([cut for _, cut in shares.values()]),
    )


class Truth(SimpleNamespace):
    def __len__(self) -> int:
        return len(self.actor_id)


def test_of_several_cameras_the_one_that_sees_most_counts():
    frame: Any = SimpleNamespace(
        truth=Truth(actor_id=np.array([3, 5, 8])),
        points=np.zeros(0, dtype=POINT),
        image_truths={"front": labels(a3=(0.9, 0.5), a5=(0.2, 0.0)), "rear": labels(a5=(0.8, 0.25), a3=(0.4, 0.0))},
    )
    assert visible_fractions(frame) == pytest.approx([0.45, 0.6, 0.0])
    frame.points = None
    assert len(visible_fractions(frame)) == 0, "without a sweep"


@pytest.fixture(scope="module")
def tables(made_dataset: Path) -> Tables:
    return {path.stem: json.loads(path.read_text()) for path in (made_dataset / "v1.0-siren").glob("*.json")}


def rotation(wxyz: list[float]) -> Rotation:
    return Rotation.from_quat([*wxyz[1:], wxyz[0]])


def chain(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows in the order of their links; each points to the one after it, and that one back."""
    by_token = {row["token"]: row for row in rows}
    (first,) = [row for row in rows if not row["prev"]]
    linked = [first]
    while linked[-1]["next"]:
        follower = by_token[linked[-1]["next"]]
        assert follower["prev"] == linked[-1]["token"]
        linked.append(follower)
    assert len(linked) == len(rows)
    return linked


def test_keyframes_are_at_2_hz_from_the_first_labelled_one(tables):
    samples = chain(tables["sample"])
    assert [row["timestamp"] for row in samples] == [500_000, 1_000_000, 1_500_000, 2_000_000]
    (scene,) = tables["scene"]
    assert {row["scene_token"] for row in samples} == {scene["token"]}
    assert (scene["name"], scene["nbr_samples"]) == (ID, 4)
    assert (scene["first_sample_token"], scene["last_sample_token"]) == (samples[0]["token"], samples[-1]["token"])
    assert scene["description"].endswith("global frame = map frame − (-60, -66) m")


@pytest.mark.parametrize("channel", sorted(CHANNELS))
def test_every_sweep_and_picture_is_there_and_belongs_to_the_last_keyframe(tables, made_dataset, channel):
    key_of_step = {step: nuscenes_tables.token("sample", ID, step // 10 * 10) for step in STEPS}
    rows = chain([row for row in tables["sample_data"] if f"__{channel}__" in row["filename"]])
    assert [row["timestamp"] for row in rows] == [50_000 * step for step in STEPS]
    for row, step in zip(rows, STEPS, strict=True):
        key = step in KEY_STEPS
        kind = "samples" if key else "sweeps"
        suffix = "pcd.bin" if channel == "LIDAR_TOP" else "jpg"
        assert row["is_key_frame"] is key
        assert row["sample_token"] == key_of_step[step]
        assert row["filename"] == f"{kind}/{channel}/{ID}__{channel}__{step:08d}.{suffix}"
        camera = {"CAM_FRONT": made_bag.FRONT, "CAM_BACK": made_bag.REAR}.get(channel)
        expected = sweep_bytes(made_bag.sweep_of(step)) if camera is None else made_bag.jpeg_of(step, camera)
        assert (made_dataset / row["filename"]).read_bytes() == expected
        size = (0, 0) if camera is None else (64, 48)
        assert (row["width"], row["height"]) == size
        assert row["fileformat"] == ("pcd" if camera is None else "jpg")
        assert row["calibrated_sensor_token"] == nuscenes_tables.token("calibrated_sensor", ID, channel)


def test_poses_are_those_of_the_steps_from_the_maps_lower_left_corner(tables):
    poses = {row["token"]: row for row in tables["ego_pose"]}
    assert len(poses) == len(tables["sample_data"]) == 3 * len(STEPS)
    for row in tables["sample_data"]:
        pose, step = poses[row["ego_pose_token"]], row["timestamp"] // 50_000
        assert pose["timestamp"] == row["timestamp"]
        x_m, y_m, z_m = made_bag.place_of(step)
        assert pose["translation"] == pytest.approx([x_m - ORIGIN_M[0], y_m - ORIGIN_M[1], z_m])
        assert rotation(pose["rotation"]).as_euler("ZYX") == pytest.approx([made_bag.yaw_of(step), 0.0, 0.0])


def test_boxes_are_where_the_labels_are_in_the_global_frame(tables):
    poses = {row["timestamp"]: row for row in tables["ego_pose"]}
    instances = {row["token"]: row for row in tables["instance"]}
    assert len(tables["sample_annotation"]) == 2 * len(KEY_STEPS)
    for actor, row_of_truth in ((made_bag.CAR, 0), (made_bag.BUS, 1)):
        instance = instances[nuscenes_tables.token("instance", ID, actor)]
        rows = chain([row for row in tables["sample_annotation"] if row["instance_token"] == instance["token"]])
        assert instance["nbr_annotations"] == len(rows) == len(KEY_STEPS)
        assert instance["first_annotation_token"] == rows[0]["token"]
        assert instance["last_annotation_token"] == rows[-1]["token"]
        for row, step in zip(rows, KEY_STEPS, strict=True):
            truth, pose = made_bag.truth_of(step), poses[50_000 * step]
            local = np.array([truth.x_m[row_of_truth], truth.y_m[row_of_truth], truth.z_m[row_of_truth]])
            expected = rotation(pose["rotation"]).apply(local + made_bag.LIDAR_M) + pose["translation"]
            assert row["translation"] == pytest.approx(expected)
            yaw = made_bag.yaw_of(step) + truth.yaw_rad[row_of_truth]
            assert rotation(row["rotation"]).as_euler("ZYX")[0] == pytest.approx(np.arctan2(np.sin(yaw), np.cos(yaw)))
            sizes = (truth.width_m, truth.length_m, truth.height_m)
            assert row["size"] == [float(values[row_of_truth]) for values in sizes]
            assert (row["num_lidar_pts"], row["num_radar_pts"]) == (int(truth.lidar_points[row_of_truth]), 0)
            assert row["sample_token"] == nuscenes_tables.token("sample", ID, step)


def test_categories_attributes_and_visibility(tables):
    """The car moves and half of it is in the front picture; the bus stands and the rear camera sees nearly all."""
    names = {row["token"]: row["name"] for row in (*tables["category"], *tables["attribute"])}
    kinds = {
        (names[instance["category_token"]], names[row["attribute_tokens"][0]], row["visibility_token"])
        for instance in tables["instance"]
        for row in tables["sample_annotation"]
        if row["instance_token"] == instance["token"]
    }
    assert kinds == {("vehicle.car", "vehicle.moving", "2"), ("vehicle.bus.rigid", "vehicle.stopped", "4")}


def test_sensors_stand_where_they_are_mounted(tables):
    modalities = {"LIDAR_TOP": "lidar", "CAM_FRONT": "camera", "CAM_BACK": "camera"}
    assert {row["channel"]: row["modality"] for row in tables["sensor"]} == modalities
    rows = {row["token"]: row for row in tables["calibrated_sensor"]}
    mounts = {channel: rows[nuscenes_tables.token("calibrated_sensor", ID, channel)] for channel in CHANNELS}
    for channel, place, ahead in (
        ("LIDAR_TOP", made_bag.LIDAR_M, (0.0, 1.0, 0.0)),
        ("CAM_FRONT", made_bag.FRONT_M, (0.0, 0.0, 1.0)),
        ("CAM_BACK", made_bag.REAR_M, (0.0, 0.0, -1.0)),
    ):
        assert mounts[channel]["translation"] == pytest.approx(place)
        assert rotation(mounts[channel]["rotation"]).apply(ahead) == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)
        assert mounts[channel]["sensor_token"] == nuscenes_tables.token("sensor", channel)
    assert mounts["LIDAR_TOP"]["camera_intrinsic"] == []
    assert mounts["CAM_BACK"]["camera_intrinsic"] == [[32.0, 0, 32], [0, 32, 24], [0, 0, 1]]


def test_episodes_of_one_map_share_it(exported, made_bags):
    out = exported("nuscenes", made_bags)
    tables = {path.stem: json.loads(path.read_text()) for path in (out / "v1.0-siren").glob("*.json")}
    (area,) = tables["map"]
    assert sorted(area["log_tokens"]) == sorted(row["token"] for row in tables["log"])
    assert len(area["log_tokens"]) == 3
    files = sorted(str(path.relative_to(out)) for path in (out / "maps").rglob("*.*"))
    assert files == sorted([area["filename"], "maps/expansion/straight-73747261.json"])
    assert area["category"] == "semantic_prior"
    assert {row["location"] for row in tables["log"]} == {"straight-73747261"}, "name and beginning of the hash"
    assert [len(tables["splits"][f"siren_{split}"]) for split in ("train", "val", "test")] == [1, 1, 1]
    card = json.loads((out / "dataset.json").read_text())
    assert card["counts"] == {"keyframes": 4 + 2 + 2, "files": 3 * (16 + 7 + 7), "labels": 2 * (4 + 2 + 2)}
    assert card["classes"] == {"vehicle.bus.rigid": 8, "vehicle.car": 8}


def test_the_papers_categories_are_one(exported, made_bags):
    out = exported("nuscenes", made_bags[1], "--vehicle-category", "vehicle.car")
    assert json.loads((out / "dataset.json").read_text())["classes"] == {"vehicle.car": 4}


def test_the_vector_map_has_the_lanes_in_the_global_frame(made_dataset, tables):
    """Two lanes of 300 m each way; the right one eastwards lies at y = -5.25."""
    (log,) = tables["log"]
    vector_map = json.loads((made_dataset / "maps" / "expansion" / f"{log['location']}.json").read_text())
    assert (vector_map["version"], vector_map["canvas_edge"]) == ("1.3", [420.0, 132.0])
    counts = {
        layer: len(vector_map[layer]) for layer in ("lane", "lane_divider", "road_block", "road_divider", "stop_line")
    }
    assert counts == {"lane": 4, "lane_divider": 2, "road_block": 2, "road_divider": 2, "stop_line": 0}
    paths = [path for lane in vector_map["lane"] for path in vector_map["arcline_path_3"][lane["token"]]]
    starts = {tuple(np.round(path["start_pose"][:2] + ORIGIN_M, 6)): path for path in paths}
    east = starts[0.0, -5.25]
    assert (east["end_pose"][:2] + ORIGIN_M).tolist() == pytest.approx([300.0, -5.25])
    assert (east["start_pose"][2], sum(east["segment_length"])) == (0.0, 300.0)
    nodes = {node["token"]: (node["x"] + ORIGIN_M[0], node["y"] + ORIGIN_M[1]) for node in vector_map["node"]}
    polygons = {polygon["token"]: polygon for polygon in vector_map["polygon"]}
    outlines = [
        {nodes[key] for key in polygons[lane["polygon_token"]]["exterior_node_tokens"]} for lane in vector_map["lane"]
    ]
    assert {(0.0, -7.0), (300.0, -7.0), (300.0, -3.5), (0.0, -3.5)} in outlines
    segments = [lane["left_lane_divider_segments"] for lane in vector_map["lane"]]
    assert sorted({part["segment_type"] for segment in segments for part in segment}) == [
        "DOUBLE_DASHED_WHITE",
        "SINGLE_SOLID_WHITE",
    ]


def test_the_devkit_reads_and_scores_a_dataset(dataset, sensed_bag, tmp_path):
    """nuScenes counts all points in a box: the ground under a vehicle too, but no mirror that sticks out of it."""
    read = read_with("nuscenes", "read_nuscenes.py", dataset, "siren_train", tmp_path)
    assert read["samples"] == 4
    assert read["channels"] == ["CAM_BACK", "CAM_BACK_LEFT", "CAM_BACK_RIGHT", "CAM_FRONT", "LIDAR_TOP"]
    assert {"vehicle.car"} <= set(read["categories"]) <= set(nuscenes_tables.CATEGORY_OF_CLASS.values())
    assert read["floats"] == read["points"] > 10_000
    assert (read["sweeps"], read["history_s"]) == (10, pytest.approx(0.45))
    hits = np.array(read["hits"])
    assert (hits[:, 1] > 0).sum() >= 12
    assert hits[:, 1].tolist() == hits[:, 0].tolist()
    assert all(links == ["", ""] for links in read["without_velocity"])
    assert read["car_ap"] == pytest.approx(1.0), "its own annotations"
    assert max(read["car_errors"].values()) == pytest.approx(0.0, abs=1e-9)
    assert read["on_road"]
    with open_source(sensed_bag) as source:
        truth = next(frame.truth for frame in lidar_frames(source) if frame.step == 10)
    recorded = sorted(np.hypot(truth.vx_mps, truth.vy_mps).tolist())
    assert sorted(speed for speed, _ in read["speeds"]) == pytest.approx(recorded, abs=0.6)


def test_the_devkits_map_and_prediction_tools_read_the_vector_map(dataset):
    read = read_with("nuscenes", "read_nuscenes_map.py", dataset)
    assert read["refused"], "the devkit takes the names of its own four maps, until its list is changed"
    assert read["name"].startswith("town-")
    assert min(count for layer, count in read["rows"].items() if layer != "carpark_area") > 0
    assert [layer for layer, there in read["layers"].items() if there][:4] == [
        *("drivable_area", "road_segment", "road_block", "lane")
    ]
    assert (read["on_road"], read["known"], read["cues"]) == (1.0, True, ["VERTICAL"])
    assert read["off_lane_m"] < 1.0
    assert max(read["steps_m"]) < 0.5, "a lane begins where the one before it ends"
    assert all(0.0 < share < 1.0 for share in read["shares"])
    assert read["picture"][:3] == [500, 500, 3]
    assert read["picture"][3] > 10.0


def test_tables_name_only_what_is_there(made_dataset, tables):
    tokens = {name: {row["token"] for row in rows} for name, rows in tables.items() if name != "splits"}
    for name, own in tokens.items():
        assert len(own) == len(tables[name])
        for row in tables[name]:
            for key, value in row.items():
                if key.endswith("_token") and not key.startswith(("first", "last")):
                    assert value in tokens[key.removesuffix("_token")], (name, key)
    names = {row["filename"] for row in tables["sample_data"]}
    files = [path for kind in ("samples", "sweeps") for path in (made_dataset / kind).rglob("*.*")]
    assert names == {str(path.relative_to(made_dataset)) for path in files}
    assert tables["splits"]["siren_train"] == [tables["scene"][0]["name"]]
