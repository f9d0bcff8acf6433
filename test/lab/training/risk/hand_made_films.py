"""Films without an episode: a bright square grows before a conflict."""

import numpy as np

from siren_ros.lab.training.risk.samples import FILM_STEPS, Film
from siren_ros.running.studies.risk_set.candidate import Candidate
from siren_ros.scoring.evaluation.risk.labels import Evidence, Moments, RiskClass, RiskThresholds, SeenContact, label_of
from siren_ros.scoring.evaluation.risk.sequence_model import HEIGHT, WIDTH
from siren_ros.simulation.scenario.episode import EpisodeRequest

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
