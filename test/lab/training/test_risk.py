"""Training samples of risk, and the batches of them."""

from pathlib import Path

import numpy as np
import pytest
from made_training_data import FIRST_STEP, hand_made_film
from processes.stand_in import processes_of

from siren_ros.errors import EpisodeError
from siren_ros.lab.training import data_files
from siren_ros.lab.training.risk import (
    CLIP_FRAMES,
    FilmPlanSize,
    PlannedFilm,
    classes_at,
    clip_of,
    drawn_first,
    film_path,
    films_with,
    labelled,
    make_films,
    operating_point,
    plan_films,
    read_film,
    validation_clips,
    write_film,
)
from siren_ros.lab.training.settings import FilmFitConfig
from siren_ros.scoring.evaluation.risk.labels import RiskClass, RiskThresholds
from siren_ros.simulation.scenario.episode import Split


def test_a_film_is_read_as_it_was_written(tmp_path: Path) -> None:
    film = hand_made_film(RiskClass.COLLISION)
    write_film(tmp_path / "new" / "a.npz", film)
    again = read_film(tmp_path / "new" / "a.npz")
    assert (again.frames == film.frames).all()
    assert again.episode.label == film.episode.label
    assert again.episode.evidence.contacts == film.episode.evidence.contacts
    assert (again.episode.evidence.moments.step == film.episode.evidence.moments.step).all()
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.npz"]


def test_the_label_of_a_part_knows_that_part_alone() -> None:
    film, limits = hand_made_film(RiskClass.COLLISION, at=60), RiskThresholds()
    middle = film.step_of(60)
    assert middle == FIRST_STEP + 240
    assert film.label_between(middle - 40, middle + 1, limits).risk is RiskClass.COLLISION
    assert film.label_between(middle - 40, middle, limits).risk is RiskClass.NEAR_MISS
    assert film.label_between(middle + 5, middle + 80, limits).risk is RiskClass.NORMAL


def test_films_that_are_there_are_not_made_again_and_failures_are_named(tmp_path, monkeypatch) -> None:
    plan = plan_films(FilmPlanSize(1, 1), ["S2", "S4"])
    asked = []

    def make(_retries: int, _function: object, planned: PlannedFilm, path: Path) -> None:
        asked.append(planned.name)
        if planned.template == "S4":
            raise EpisodeError("no way")
        write_film(path, hand_made_film(RiskClass.NORMAL))

    monkeypatch.setattr(data_files, "attempt_processes", processes_of(make))
    write_film(film_path(tmp_path, plan[0]), hand_made_film(RiskClass.NORMAL))
    done: list[int] = []
    result = make_films(plan, tmp_path, 2, lambda: done.append(1))
    assert len(done) == len(plan)
    assert plan[0].name not in asked
    assert [planned.template for planned, _ in result.files] == ["S2", "S2"]
    assert [(planned.template, reason) for planned, reason in result.missing] == [("S4", "no way")] * 4
    assert all(np.array_equal(read_film(path).frames.shape, (120, 60, 160)) for _, path in result.files)


def test_every_template_and_split_has_its_films_and_no_episode_twice() -> None:
    plan = plan_films(FilmPlanSize(train=4, validation=2))
    count = {split: sum(film.split is split for film in plan) for split in (Split.TRAIN, Split.VAL)}
    assert count == {Split.TRAIN: 32, Split.VAL: 16}
    assert len({film.name for film in plan}) == len(plan)
    assert len({(film.request.template, film.request.seed) for film in plan}) == len(plan)
    assert {film.template for film in plan[:16]} == {f"S{number}" for number in range(1, 8)}
    assert set(plan_films(FilmPlanSize(train=2, validation=1))) < set(plan), "a longer plan has the shorter one"


def test_a_film_is_drawn_like_a_candidate_of_each_class_in_turn() -> None:
    films = {film.number: film for film in plan_films(FilmPlanSize(3, 1), ["S4"]) if film.split is Split.TRAIN}
    assert list(films) == [0, 1000, 1, 1001, 2, 1002]
    assert films[0].request.preset in {"paper", "realistic"}
    assert {films[number].request.preset for number in (2, 1000, 1001, 1002)} == {"reckless"}
    assert films[0].request.values == ""
    assert "response.compliance" in films[2].request.values


CONFIG = FilmFitConfig()
NORMAL, NEAR_MISS, COLLISION = RiskClass


def test_pictures_near_a_conflict_have_its_class() -> None:
    film = labelled(hand_made_film(COLLISION, at=60), CONFIG)
    assert np.flatnonzero(film.severity == COLLISION).tolist() == [57, 58, 59, 60, 61, 62, 63]
    assert set(np.flatnonzero(film.severity == NEAR_MISS).tolist()) <= {56, 64}
    assert not film.severity[:56].any()
    films = [labelled(hand_made_film(kind), CONFIG) for kind in RiskClass]
    assert films_with(films, COLLISION) == films[2:]
    assert films_with(films, NORMAL) == films
    clips = validation_clips(films, CONFIG.thresholds)
    assert [len(clip.frames) for clip in clips] == [CLIP_FRAMES] * 9


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


LABELS = np.array([0] * 20 + [1] * 10 + [2] * 5)


def test_separable_classes_are_separated() -> None:
    random = np.random.default_rng(0)
    logits = np.stack((np.where(LABELS >= 1, 3.0, -1.0), np.where(LABELS == 2, -2.0, -6.0)), axis=1)
    logits = (logits + random.uniform(-0.5, 0.5, logits.shape)).astype(np.float32)
    near, hit = operating_point(logits, LABELS)
    assert -0.5 <= near <= 2.5
    assert -5.5 <= hit <= -2.5
    assert (classes_at(logits, (near, hit)) == LABELS).all()
    logits = np.array([[-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]], dtype=np.float32)
    assert classes_at(logits, (0.0, 0.0)).tolist() == [2, 1, 0], "the collision question comes first"


def test_rare_answers_are_not_bought_with_many_false_ones() -> None:
    # The second question knows nothing: at the paper's balance any collision answer would be wrong 16 times of 17.
    random = np.random.default_rng(1)
    logits = np.stack((np.where(LABELS >= 1, 3.0, -1.0), random.normal(size=len(LABELS))), axis=1).astype(np.float32)
    near, hit = operating_point(logits, LABELS)
    assert np.mean(classes_at(logits, (near, hit)) == 2) < 0.2
