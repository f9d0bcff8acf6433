"""The samples of each task."""

import json
from itertools import islice, pairwise

import numpy as np
import pytest
from recorded_episode import tracked_recording

from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import InputError
from siren_ros.lab.training.packed import pack, prediction
from siren_ros.lab.training.packed.pack import RiskPack, pack_risk
from siren_ros.lab.training.packed.parquet_samples import PackedSamples
from siren_ros.lab.training.packed.prediction import LANES, prediction_samples
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.scoring.evaluation.risk.sequence_model import read_small_frames
from siren_ros.scoring.evaluation.risk.video_set import read_set


def samples_in(path):
    file = PackedSamples(path)
    return [file[number] for number in range(len(file))]


def all_of(folder):
    return [item for path in sorted(folder.glob("*.parquet")) for item in samples_in(path)]


def column(sample, name, columns=prediction.COLUMNS):
    return dict(zip(columns[name].names, np.moveaxis(sample[name], -1, 0), strict=True))


def test_samples_are_those_of_the_evaluation_in_the_frame_of_the_target(drives):
    """The road leads along x at constant heading, so that places are differences."""
    record = read_episode(drives[0])
    wanted = samples_of(record, HistoryWindow(), Population.REGION)
    assert len(wanted) > 50
    for item, row in zip(prediction_samples(record), range(len(wanted)), strict=True):
        batch = wanted.batch
        assert (item["step"], item["actor_id"]) == (batch.sample_step[row], batch.actor_id[row])
        states = column(item, "history")
        assert (states["x_m"][0, -1], states["y_m"][0, -1]) == (0.0, 0.0)
        assert (states["cos_yaw"][0, -1], states["sin_yaw"][0, -1]) == (1.0, 0.0)
        own = batch.actors.xy_m[batch.target[row]]
        np.testing.assert_allclose(item["history"][0, :, :2], (own - own[-1]) * item["observed"][0, :, None], atol=1e-4)
        np.testing.assert_allclose(item["future"], wanted.future_xy_m[row] - own[-1], atol=1e-4)
        assert states["vx_mps"][0, -1] == pytest.approx(batch.speed_mps[row], abs=1e-5)
        flags = column(item, "flags")
        there = int(flags["there"].sum())
        assert not any(item[name][there:].any() for name in ("history", "size_m", "flags"))
        assert flags["is_emv"][0] == record.actors[int(item["actor_id"])].is_emv
        if there > 1 and not flags["is_emv"][0]:
            assert flags["is_emv"][1]
        assert (item["size_m"][:there, 0] > 3.0).all()


def test_samples_of_left_hand_traffic_are_those_of_the_mirror_image(drives):
    record = read_episode(drives[0])
    for have, want in zip(prediction_samples(record.mirrored()), prediction_samples(record), strict=True):
        for name in prediction.COLUMNS:
            if name not in {"episode", "map"}:
                np.testing.assert_array_equal(have[name], want[name], err_msg=name)


def test_lanes_are_the_nearest_ones_in_driving_direction(drives):
    record = read_episode(drives[0])
    item = next(iter(prediction_samples(record)))
    there = int(column(item, "lane_flags")["there"].sum())
    assert 0 < there <= LANES
    distance = np.hypot(*np.moveaxis(item["lanes"][:there], -1, 0)).min(axis=1)
    assert all(before <= after + 1e-4 for before, after in pairwise(distance))
    assert distance[0] < 3.0
    assert not item["lanes"][there:].any()
    spacing = np.hypot(*np.moveaxis(np.diff(item["lanes"][:there], axis=1), -1, 0))
    assert (spacing < 25.0 / 9.0 + 1e-3).all()
    assert (item["lane_limit_mps"][:there] > 0.0).all()


def test_signals_have_the_meaning_of_their_letters(record_at_signals):
    """Each way across the junction shows what SUMO's letters say at that step."""
    network, letters = record_at_signals.network, {"r": 1, "u": 1, "y": 2, "Y": 2, "g": 3, "G": 4}
    ways = {lane: item for lane, items in network.connections_over.items() for item in items if item.signal_id}
    shown = {
        traffic.step: {signal.signal_id: signal.state for signal in traffic.signals}
        for traffic in record_at_signals.traffic
    }
    seen = set()
    for item in islice(prediction_samples(record_at_signals, Population.ALL), 0, None, 7):
        states = shown[int(item["step"])]
        allowed = {0} | {letters.get(states[way.signal_id][way.signal_link], 0) for way in ways.values()}
        assert set(item["lane_signal"].tolist()) <= allowed
        assert not item["lane_signal"][~column(item, "lane_flags")["across_junction"]].any()
        seen |= set(item["lane_signal"].tolist())
    assert len(seen) >= 3


@pytest.fixture(scope="session")
def record_at_signals(tmp_path_factory):
    return read_episode(tracked_recording(tmp_path_factory))


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
