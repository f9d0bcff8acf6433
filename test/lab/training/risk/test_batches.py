"""Clips and their classes."""

import numpy as np
import pytest
from training.risk.hand_made_films import hand_made_film

from siren_ros.lab.training.risk.batches import (
    CLIP_FRAMES,
    classes_at,
    clip_of,
    drawn_first,
    films_with,
    labelled,
    operating_point,
    validation_clips,
)
from siren_ros.lab.training.settings import FilmFitConfig
from siren_ros.scoring.evaluation.risk.labels import RiskClass, RiskThresholds

CONFIG = FilmFitConfig()
NORMAL, NEAR_MISS, COLLISION = RiskClass


def test_pictures_near_a_conflict_have_its_class() -> None:
    film = labelled(hand_made_film(COLLISION, at=60), CONFIG)
    assert np.flatnonzero(film.severity == COLLISION).tolist() == [57, 58, 59, 60, 61, 62, 63]
    assert set(np.flatnonzero(film.severity == NEAR_MISS).tolist()) <= {56, 64}
    assert not film.severity[:56].any()


def test_a_clip_has_the_class_of_its_time() -> None:
    film = labelled(hand_made_film(NEAR_MISS, at=60), CONFIG)
    limits = RiskThresholds()
    assert clip_of(film, 30, 40, limits).label is NEAR_MISS
    assert clip_of(film, 62, 40, limits).label is NORMAL
    late = clip_of(film, 100, 40, limits)
    assert late.frames.shape[0] == 40
    assert (late.frames[20:] == film.film.frames[-1]).all()


@pytest.mark.parametrize("seed", range(5))
def test_a_clip_that_is_drawn_for_a_class_has_it(seed: int) -> None:
    film = labelled(hand_made_film(COLLISION, at=15 + 20 * seed), CONFIG)
    first = drawn_first(film, COLLISION, 40, np.random.default_rng(seed))
    assert 0 <= first <= 80
    assert clip_of(film, first, 40, RiskThresholds()).label is COLLISION


def test_films_are_found_by_their_classes() -> None:
    films = [labelled(hand_made_film(kind), CONFIG) for kind in RiskClass]
    assert films_with(films, COLLISION) == films[2:]
    assert films_with(films, NORMAL) == films
    assert len(validation_clips(films, CONFIG.thresholds)) == 9
    assert all(len(clip.frames) == CLIP_FRAMES for clip in validation_clips(films, CONFIG.thresholds))


LABELS = np.array([0] * 20 + [1] * 10 + [2] * 5)


def test_separable_classes_are_separated() -> None:
    random = np.random.default_rng(0)
    logits = np.stack((np.where(LABELS >= 1, 3.0, -1.0), np.where(LABELS == 2, -2.0, -6.0)), axis=1)
    logits = (logits + random.uniform(-0.5, 0.5, logits.shape)).astype(np.float32)
    near, hit = operating_point(logits, LABELS)
    assert -0.5 <= near <= 2.5
    assert -5.5 <= hit <= -2.5
    assert (classes_at(logits, (near, hit)) == LABELS).all()


def test_the_collision_question_comes_first() -> None:
    logits = np.array([[-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]], dtype=np.float32)
    assert classes_at(logits, (0.0, 0.0)).tolist() == [2, 1, 0]


def test_rare_answers_are_not_bought_with_many_false_ones() -> None:
    # The second question knows nothing: at the paper's balance any collision answer would be wrong 16 times of 17.
    random = np.random.default_rng(1)
    logits = np.stack((np.where(LABELS >= 1, 3.0, -1.0), random.normal(size=len(LABELS))), axis=1).astype(np.float32)
    near, hit = operating_point(logits, LABELS)
    assert np.mean(classes_at(logits, (near, hit)) == 2) < 0.2
