"""Clips and their classes."""

import numpy as np
import pytest
from training.risk.hand_made_films import hand_made_film

from siren_ros.evaluation.risk.labels import RiskThresholds
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.training.risk.film_fit import (
    CLIP_FRAMES,
    FilmFitConfig,
    clip_of,
    drawn_first,
    films_with,
    labelled,
    validation_clips,
)

CONFIG = FilmFitConfig()
NORMAL, NEAR_MISS, COLLISION = RiskClass


def test_pictures_near_a_conflict_have_its_class() -> None:
    one = labelled(hand_made_film(COLLISION, at=60), CONFIG)
    assert np.flatnonzero(one.severity == COLLISION).tolist() == [57, 58, 59, 60, 61, 62, 63]
    assert set(np.flatnonzero(one.severity == NEAR_MISS).tolist()) <= {56, 64}
    assert not one.severity[:56].any()


def test_a_clip_has_the_class_of_its_time() -> None:
    one = labelled(hand_made_film(NEAR_MISS, at=60), CONFIG)
    limits = RiskThresholds()
    assert clip_of(one, 30, 40, limits).label is NEAR_MISS
    assert clip_of(one, 62, 40, limits).label is NORMAL
    late = clip_of(one, 100, 40, limits)
    assert late.frames.shape[0] == 40
    assert (late.frames[20:] == one.film.frames[-1]).all()


@pytest.mark.parametrize("seed", range(5))
def test_a_clip_that_is_drawn_for_a_class_has_it(seed: int) -> None:
    one = labelled(hand_made_film(COLLISION, at=15 + 20 * seed), CONFIG)
    first = drawn_first(one, COLLISION, 40, np.random.default_rng(seed))
    assert 0 <= first <= 80
    assert clip_of(one, first, 40, RiskThresholds()).label is COLLISION


def test_films_are_found_by_their_classes() -> None:
    films = [labelled(hand_made_film(kind), CONFIG) for kind in RiskClass]
    assert films_with(films, COLLISION) == films[2:]
    assert films_with(films, NORMAL) == films
    assert len(validation_clips(films, CONFIG.thresholds)) == 9
    assert all(len(clip.frames) == CLIP_FRAMES for clip in validation_clips(films, CONFIG.thresholds))
