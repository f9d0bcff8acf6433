"""Films in files, and what is missing."""

from pathlib import Path

import numpy as np
import pytest
from processes.stand_in import processes_of
from training.risk.hand_made_films import FIRST_STEP, hand_made_film

from siren_ros.errors import EpisodeError
from siren_ros.evaluation.risk.labels import RiskClass, RiskThresholds
from siren_ros.training import data_files
from siren_ros.training.risk.plan import FilmPlanSize, PlannedFilm, plan_films
from siren_ros.training.risk.samples import film_path, make_films, read_film, write_film


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


def test_what_is_there_is_not_made_again_and_what_fails_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_films(FilmPlanSize(1, 1), ["S2", "S4"])
    asked = []

    def made(_retries: int, _function: object, planned: PlannedFilm, path: Path) -> None:
        asked.append(planned.name)
        if planned.template == "S4":
            raise EpisodeError("no way")
        write_film(path, hand_made_film(RiskClass.NORMAL))

    monkeypatch.setattr(data_files, "attempt_processes", processes_of(made))
    write_film(film_path(tmp_path, plan[0]), hand_made_film(RiskClass.NORMAL))
    told: list[int] = []
    result = make_films(plan, tmp_path, 2, lambda: told.append(1))
    assert len(told) == len(plan)
    assert plan[0].name not in asked
    assert [planned.template for planned, _ in result.files] == ["S2", "S2"]
    assert [(planned.template, reason) for planned, reason in result.missing] == [("S4", "no way")] * 4
    assert all(np.array_equal(read_film(path).frames.shape, (120, 60, 160)) for _, path in result.files)
