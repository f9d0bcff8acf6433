"""Made records, films and LiDAR frames for the tests of the training."""

import numpy as np
from made_records import moving, record_with
from synthetic_episode import NET_XML

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.lab.training.detection.samples import BagFrames, joined_frames
from siren_ros.lab.training.risk import FILM_STEPS, Film
from siren_ros.running.studies.risk_set.candidate import Candidate
from siren_ros.scoring.evaluation.detection.pillar_detector import PillarGrid
from siren_ros.scoring.evaluation.risk.labels import Evidence, Moments, RiskClass, RiskThresholds, SeenContact, label_of
from siren_ros.scoring.evaluation.risk.sequence_model import HEIGHT, WIDTH
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.scenario.episode import EpisodeRequest


def made_record(seed: int, template: str = "S2") -> EpisodeRecord:
    """Four vehicles that brake or speed up, each as its place says, so that there is something to learn."""
    random = np.random.default_rng(seed)
    tracks = {
        number: moving(20.0 + 15.0 * number, -5.25, 8.0, accel_mps2=0.8 * float(random.uniform(-1.0, 1.0)), steps=181)
        for number in range(1, 5)
    }
    tracks[5] = moving(5.0, -1.75, 10.0, is_emv=True, steps=181)
    return record_with(tracks, parse_road_network(NET_XML.encode()), template)


FIRST_STEP = 8


def hand_made_film(kind: RiskClass, at: int = 60, length: int = 120, seed: int = 0) -> Film:
    """A film whose conflict, if any, is at a picture."""
    random = np.random.default_rng(seed)
    frames = random.integers(90, 110, (length, HEIGHT, WIDTH), dtype=np.uint8)
    middle = FIRST_STEP + at * FILM_STEPS
    steps = np.arange(middle - 4, middle + 4 if kind is not RiskClass.NORMAL else middle - 4)
    count = len(steps)
    if count:
        for back in range(8):
            half = 24 - 3 * back
            frames[at - back, 30 - half // 2 : 30 + half // 2, 80 - half : 80 + half] = 250
    measures = (np.full(count, value) for value in (1.0, 5.0, 2.5, 5.0, 4.0))
    moments = Moments(steps, np.full(count, 3, np.uint32), *measures)
    contacts = (SeenContact(3, middle, 4.0),) if kind is RiskClass.COLLISION else ()
    evidence = Evidence(moments, (), contacts)
    return Film(frames, Candidate(EpisodeRequest(), FIRST_STEP, label_of(evidence, RiskThresholds()), evidence))


SMALL_GRID = PillarGrid(half_width_m=16.0, cells=64, points=6, pillars=500)


def made_episode(seed: int, frames: int = 6) -> BagFrames:
    """Each frame has one vehicle of 4.4 m on flat ground, with returns on all its sides."""
    random = np.random.default_rng(seed)
    points, boxes = [], []
    for _ in range(frames):
        place, yaw = random.uniform(-10.0, 10.0, 2), float(random.uniform(-3.0, 3.0))
        along, across, up = random.uniform(-1.0, 1.0, (3, 150)) * np.array([[2.2], [0.9], [0.7]])
        x = place[0] + np.cos(yaw) * along - np.sin(yaw) * across
        y = place[1] + np.sin(yaw) * along + np.cos(yaw) * across
        rows = np.stack((x, y, up - 1.0, np.full(150, 0.4), np.zeros(150)), axis=-1)
        ground = np.column_stack((random.uniform(-16.0, 16.0, (400, 2)), np.tile([-1.9, 0.1, 0.05], (400, 1))))
        points.append(np.vstack((rows, ground)).astype(np.float32))
        boxes.append(np.array([[*place, -1.0, 4.4, 1.8, 1.4, yaw, 0.0, 0.0, 0.0, 150.0]], dtype=np.float32))
    about = {"template": "S2", "level": "L2", "seed": seed, "map": "made", "key": f"made S2 {seed}"}
    return joined_frames(about, points, boxes)
