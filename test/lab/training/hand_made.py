"""Records for the tests of the training."""

import numpy as np
from made_records import moving, record_with
from synthetic_episode import NET_XML

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.simulation.roads.net_parser import parse_road_network


def made_record(seed: int, template: str = "S2") -> EpisodeRecord:
    """Four vehicles that brake or speed up, each as its place says, so that there is something to learn."""
    random = np.random.default_rng(seed)
    tracks = {
        number: moving(20.0 + 15.0 * number, -5.25, 8.0, accel_mps2=0.8 * float(random.uniform(-1.0, 1.0)), steps=181)
        for number in range(1, 5)
    }
    tracks[5] = moving(5.0, -1.75, 10.0, is_emv=True, steps=181)
    return record_with(tracks, parse_road_network(NET_XML.encode()), template)
