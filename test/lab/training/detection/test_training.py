"""The whole training with a fitter that learns nothing: card, files, what is refused."""

import json
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
from made_detections import columns_ahead, found_boxes, made_frames, truth_boxes
from made_training_data import made_episode

from siren_ros.errors import InputError
from siren_ros.lab.training.detection.samples import read_frames_file, write_frames
from siren_ros.lab.training.detection.training import DetectorTraining, JudgedEpisode, figures_of, train_detector
from siren_ros.lab.training.settings import DetectionFit, FittedNetwork
from siren_ros.scoring.evaluation.detection.pillar_detector import FORM_VERSION
from siren_ros.simulation.world.actors import ActorClass


def _training(folder, **changed) -> DetectorTraining:
    files = []
    for seed in (1, 2):
        files.append(folder / f"{seed}.npz")
        write_frames(files[-1], made_episode(seed, 3))
    settings = {"held_out": (), "out": folder / "a" / "pillars.onnx", "cache": folder / "cache", **changed}
    return DetectorTraining(bags=tuple(files), config=DetectionFit(steps=5), **settings)


def test_weights_and_card_are_written(tmp_path) -> None:
    def fitter(draws, config, threads, checkpoint, report):
        assert (len(draws), config.steps, threads, checkpoint) == (6, 5, 1, tmp_path / "cache" / "checkpoint.pt")
        assert report("step 5")
        return FittedNetwork(b"weights", 7, "made", 12.4, ((0, 5, 6),))

    lines = []
    card = train_detector(_training(tmp_path), fitter, lines.append)
    assert lines == ["6 frames of 2 episodes", "step 5"]
    assert json.loads((tmp_path / "a" / "pillars.json").read_text()) == card
    assert (tmp_path / "a" / "pillars.onnx").read_bytes() == b"weights"
    assert card["training"] == {
        "episodes": 2,
        "templates": {"S2": 2},
        "seeds_by_map": {"made": [1, 2]},
        "frames": 6,
        "frames_sha256": sha256(made_episode(1, 3).digest() + made_episode(2, 3).digest()).hexdigest(),
    }
    assert card["data"] == {"train": {"keys": ["made S2 1", "made S2 2"], "contents": []}}
    assert "--steps 5 --seed 0" in card["command"]
    assert card["fitting"] == {"processor_s": 12, "plans": [{"from_step": 0, "steps": 5, "frames": 6}]}
    assert {"fitting", "python", "siren_ros", "eclipse-sumo", "numpy"} <= {*card["made_with"]}, "to train it again"
    assert (card["form_version"], card["parameters"], card["figures"]) == (FORM_VERSION, 7, {})


def test_equal_frames_have_an_equal_digest(tmp_path) -> None:
    write_frames(tmp_path / "1.npz", made_episode(1, 3))
    assert read_frames_file(tmp_path / "1.npz").digest() == made_episode(1, 3).digest()
    assert made_episode(1, 3).digest() != made_episode(2, 3).digest()
    changed = made_episode(1, 3)
    changed.boxes[0, 9] = 1.0
    assert changed.digest() != made_episode(1, 3).digest()


def test_episodes_without_a_frame_are_refused(tmp_path) -> None:
    write_frames(tmp_path / "empty.npz", made_episode(3, 0))
    training = DetectorTraining((tmp_path / "empty.npz",), (), tmp_path / "a.onnx", tmp_path, DetectionFit())
    with pytest.raises(InputError, match="labelled sweeps"):
        train_detector(training, lambda *_: None, lambda _: None)
    assert train_detector(_training(tmp_path, minutes=0.0), lambda *called: called[-1]("step 1") or None, print) is None
    assert not (tmp_path / "a").exists(), "there was no time"
    assert np.load(tmp_path / "empty.npz")["boxes"].shape == (0, 11)


def test_figures_by_template_and_kind_are_those_worked_out_by_hand() -> None:
    """Of two labels one is found: precision 1 up to a recall of 0.5, which is 40 of the 90 points from 0.11 on."""

    def judged(number, template, found, processor_s):
        rows = [(4 * number, 10.0), (4 * number, 20.0)]
        (_, *columns), names = columns_ahead(rows), np.array(["car", "ambulance"])
        frame, kinds = np.zeros(2, dtype=np.intp), np.array([ActorClass.SEDAN, ActorClass.AMBULANCE], dtype=np.uint8)
        truth = replace(truth_boxes(frame, *columns), actor_class=kinds)
        boxes = replace(found_boxes(frame, *columns, np.array([0.9, 0.8])), label=names)
        frames = replace(made_frames().episodes[number], template=template, truth=truth)
        return JudgedEpisode(None, frames, boxes.at(found), processor_s)

    episodes = [judged(0, "S3", slice(0, 2), 2.0), judged(1, "S2", slice(0, 1), 6.0)]
    assert figures_of(episodes) == {
        "episodes": 2,
        "frames": 8,
        "labels": 4,
        "mAP": {"S2": 0.444, "S3": 1.0, "mean": 0.722},
        "mAP_of_kind": {"car": 1.0, "ambulance": 0.444},
        "processor_s_per_frame": 1.0,
    }
