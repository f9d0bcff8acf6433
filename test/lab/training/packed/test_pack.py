"""The samples of each task."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hand_made_record import EASTBOUND, NORTHBOUND, SOUTHBOUND, Driven, at_speed, crossing, hand_made, with_states

from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import InputError
from siren_ros.lab.training.packed import pack, prediction
from siren_ros.lab.training.packed.pack import RiskPack, pack_risk
from siren_ros.lab.training.packed.parquet_samples import PackedSamples
from siren_ros.lab.training.packed.prediction import prediction_samples
from siren_ros.scoring.evaluation.prediction.samples import Population
from siren_ros.scoring.evaluation.risk.sequence_model import read_small_frames
from siren_ros.scoring.evaluation.risk.video_set import read_set
from siren_ros.simulation.roads.road_network import JunctionKind, LaneKind
from siren_ros.simulation.world.actors import ActorClass


def samples_in(path):
    file = PackedSamples(path)
    assert file.task == path.parent.name
    return [file[number] for number in range(len(file))]


def all_of(folder):
    return [item for path in sorted(folder.glob("*.parquet")) for item in samples_in(path)]


def column(sample, name, columns=prediction.COLUMNS):
    return dict(zip(columns[name].names, np.moveaxis(sample[name], -1, 0), strict=True))


def test_samples_of_left_hand_traffic_are_those_of_the_mirror_image(drives):
    record = read_episode(drives[0])
    for have, want in zip(prediction_samples(record.mirrored()), prediction_samples(record), strict=True):
        for name in prediction.COLUMNS:
            if name not in {"episode", "map"}:
                np.testing.assert_array_equal(have[name], want[name], err_msg=name)


SPEED_MPS = {1: 10.0, 2: 7.0, 3: 5.0, 4: 4.0, 5: 6.0}
LATE_STEP = 50
"""First step of vehicle 4."""


def place(key: int, time_s: float) -> tuple[float, float, float]:
    """x, y and heading of a vehicle: 1 and 2 go north, 3 and 5 south, 4 east; each at its own speed."""
    driven = SPEED_MPS[key] * time_s
    return {
        1: (5.25, -100.0 + driven, 0.5 * np.pi),
        2: (5.25, -60.0 + driven, 0.5 * np.pi),
        3: (-1.75, 10.0 - driven, -0.5 * np.pi),
        4: (-30.0 + driven, -5.25, 0.0),
        5: (-1.75, 50.0 - driven, -0.5 * np.pi),
    }[key]


def in_frame_of(key: int, time_s: float, x: float, y: float) -> tuple[float, float]:
    own_x, own_y, yaw = place(key, time_s)
    along, across = (np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))
    return tuple(float(axis[0] * (x - own_x) + axis[1] * (y - own_y)) for axis in (along, across))


CLASSES = {1: 8, 2: 1, 3: 6, 4: 4, 5: 9}
LIGHTS = {1: 8 | 16, 2: 1 | 2, 3: 4, 4: 1, 5: 8}
BITS = {"beacon": 8, "siren": 16, "brake": 1, "indicator_left": 2, "indicator_right": 4}
LETTERS = {60: "rGyuYgs", 62: "GryYgsr"}
CODES = {"r": 1, "u": 1, "y": 2, "Y": 2, "g": 3, "G": 4, "s": 0}


def five_vehicles():
    """Two samples each of 1, 2, 3 and 5; 1 and 5 are EMVs; the speed limit of lane k is 5 + k / 10 m/s."""
    lines = {1: NORTHBOUND, 2: NORTHBOUND, 3: SOUTHBOUND, 4: EASTBOUND, 5: SOUTHBOUND}
    starts = {1: 20.0, 2: 60.0, 3: 100.0, 4: 90.0, 5: 60.0}
    network = crossing()
    lanes = tuple(replace(lane, speed_limit_mps=5.0 + 0.1 * lane.index) for lane in network.lanes)
    vehicles = {
        key: Driven(lines[key], at_speed(starts[key], SPEED_MPS[key], 163 - late), first_step=late)
        for key in lines
        for late in (LATE_STEP * (key == 4),)
    }
    record = hand_made(replace(network, lanes=lanes), vehicles, lambda step: LETTERS.get(step, "rrrrrrr"))
    record = with_states(
        record, lights=lambda state: np.array([LIGHTS[key] for key in state.actor_id.tolist()], dtype=np.uint8)
    )
    bodies = {
        key: replace(
            body,
            actor_class=ActorClass(CLASSES[key]),
            is_emv=key in {1, 5},
            length_m=4.0 + key,
            width_m=1.5 + 0.1 * key,
        )
        for key, body in record.actors.items()
    }
    return replace(record, actors=bodies, description=replace(record.description, template="S6", seed=7))


ORDERS = {1: [1, 2, 3, 4], 2: [2, 1, 5, 3, 4], 3: [3, 5, 1, 4, 2], 5: [5, 3, 4, 2]}
"""The target, the EMVs within 80 m, then the others: by their distance at 3 s."""


def test_each_column_of_a_sample_says_what_its_vehicles_do() -> None:
    got = [*prediction_samples(five_vehicles(), Population.ALL)]
    assert [(int(item["step"]), int(item["actor_id"])) for item in got] == [
        (step, key) for step in (60, 62) for key in (1, 2, 3, 5)
    ]
    for item in got:
        key, step = int(item["actor_id"]), int(item["step"])
        assert (item["episode"], item["template"]) == ("S6_L1_seed7_crossing", "S6")
        now_s, order = 0.05 * step, ORDERS[key]
        history, observed = np.zeros((13, 16, 6)), np.zeros((13, 16), np.bool_)
        size_m, classes, flags = np.zeros((13, 2)), np.zeros(13), np.zeros((13, 7), np.bool_)
        for row, other in enumerate(order):
            size_m[row], classes[row] = (4.0 + other, 1.5 + 0.1 * other), CLASSES[other]
            flags[row] = True, other in {1, 5}, *(LIGHTS[other] & bit > 0 for bit in BITS.values())
            for point in range(16):
                time_s = now_s - 0.2 * (15 - point)
                observed[row, point] = other != 4 or time_s > 0.05 * LATE_STEP - 1e-9
                if observed[row, point]:
                    x, y, yaw = place(other, time_s)
                    turned = yaw - place(key, now_s)[2]
                    facing = np.cos(turned), np.sin(turned)
                    velocity = (SPEED_MPS[other] * facing[0], SPEED_MPS[other] * facing[1])
                    history[row, point] = *in_frame_of(key, now_s, x, y), *facing, *velocity
        future = [in_frame_of(key, now_s, *place(key, now_s + 0.2 * point)[:2]) for point in range(1, 26)]
        expected = {
            "history": history,
            "observed": observed,
            "size_m": size_m,
            "actor_class": classes,
            "flags": flags,
            "future": future,
        }
        for name, values in expected.items():
            np.testing.assert_allclose(item[name], values, atol=1e-4, err_msg=f"{key} at {step}: {name}")


def test_lanes_and_signals_are_those_around_the_target() -> None:
    """12 roads of 100 m have 4 pieces each, 5 ways across the junction have 2, and both turns have 1."""
    record = five_vehicles()
    ways = {item.via[0]: item for item in record.network.connections}
    for item in prediction_samples(record, Population.ALL):
        key, step = int(item["actor_id"]), int(item["step"])
        rows = []
        for lane in record.network.lanes:
            pieces = int(np.ceil(lane.length_m / 25.0))
            kinds = [lane.kind is kind for kind in (LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL)]
            signal = CODES[LETTERS[step][ways[lane.index].signal_link]] if lane.index in ways else 0
            for number in range(pieces):
                arcs = lane.length_m * (number + np.arange(10) / 9.0) / pieces
                points = np.array([in_frame_of(key, 0.05 * step, *lane.centre.at(arc)) for arc in arcs])
                rows.append((points, [True, *kinds, False, False], 5.0 + 0.1 * lane.index, signal))
        assert len(rows) == 12 * 4 + 5 * 2 + 2
        distance = np.hypot(*np.moveaxis(item["lanes"][:60], -1, 0)).min(axis=1)
        assert all(before <= after + 1e-4 for before, after in pairwise(distance))
        for number in range(60):
            apart = [abs(item["lanes"][number] - points).max() for points, *_ in rows]
            _, *rest = rows.pop(int(np.argmin(apart)))
            assert min(apart) < 1e-3
            have = item["lane_flags"][number].tolist(), item["lane_limit_mps"][number], item["lane_signal"][number]
            assert have == (rest[0], pytest.approx(rest[1]), rest[2])
        assert not any(item[name][60:].any() for name in ("lanes", "lane_flags", "lane_limit_mps", "lane_signal"))
    stopped = hand_made(crossing(JunctionKind.PRIORITY_STOP), {1: Driven(NORTHBOUND, at_speed(20.0, 5.0, 161))})
    flags = column(next(iter(prediction_samples(stopped, Population.ALL))), "lane_flags")
    assert {name: int(flags[name].sum()) for name in flags} == {
        "there": 60,
        "driving": 40,
        "shoulder": 8,
        "across_junction": 12,
        "must_stop": 6,
        "gives_way": 0,
    }


def test_the_command_packs_what_the_library_reads(packed, drives):
    got = all_of(packed("prediction"))
    wanted = [item for bag in drives for item in prediction_samples(read_episode(bag))]
    assert len(got) == len(wanted)
    assert {item["episode"] for item in got} == {item["episode"] for item in wanted}
    key = lambda item: (item["episode"], item["step"], item["actor_id"])  # noqa: E731
    for have, want in zip(sorted(got, key=key), sorted(wanted, key=key), strict=True):
        for name in prediction.COLUMNS:
            np.testing.assert_array_equal(have[name], want[name])


def test_frames_have_sweeps_and_boxes(packed):
    got = all_of(packed("detection"))
    assert len(got) >= 2
    for item in got:
        boxes = column(item, "boxes", pack.DETECTION_COLUMNS)
        assert boxes["length"].tolist() == [4.0, 12.0]
        assert boxes["points"].tolist() == [5.0, 0.0]
        points = column(item, "points", pack.DETECTION_COLUMNS)
        assert len(points["x_m"]) > 6
        assert points["age_s"].min() == 0.0
        assert points["age_s"].max() > 0.0


def test_films_have_the_labels_of_their_set(packed, video_set_folder):
    videos = read_set(video_set_folder)
    got = {item["video"]: item for item in all_of(packed("risk"))}
    assert set(got) == set(videos.videos)
    listed = [
        (one["split"], one["id"]) for one in json.loads((packed("risk") / "dataset.json").read_text())["episodes"]
    ]
    in_files = [(path.stem, item["video"]) for path in packed("risk").glob("*.parquet") for item in samples_in(path)]
    assert sorted(listed) == sorted(in_files)
    for key, item in got.items():
        video = videos.videos[key]
        assert item["label"] == video.label.risk
        np.testing.assert_array_equal(item["frames"], read_small_frames(video_set_folder / video.file, video.frames))
    assert pack.RISK_COLUMNS["frames"].shape == got["S4_000"]["frames"].shape


def test_a_set_is_not_packed_twice(video_set_folder, tmp_path):
    with pytest.raises(InputError, match="without a video in common"):
        pack_risk(RiskPack((video_set_folder, video_set_folder), tmp_path / "out"))
    assert not (tmp_path / "out").exists()
