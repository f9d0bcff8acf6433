"""Which films are made."""

from siren_ros.training.risk.plan import FilmPlanSize, plan_films
from siren_ros.training.settings import Split


def test_every_template_and_split_has_its_films_and_no_episode_twice() -> None:
    plan = plan_films(FilmPlanSize(train=4, validation=2))
    count = {split: sum(one.split is split for one in plan) for split in (Split.TRAIN, Split.VALIDATION)}
    assert count == {Split.TRAIN: 32, Split.VALIDATION: 16}
    assert len({one.name for one in plan}) == len(plan)
    assert len({(one.request.template, one.request.seed) for one in plan}) == len(plan)


def test_a_longer_plan_begins_with_the_shorter_one() -> None:
    short, long = (set(plan_films(FilmPlanSize(train=count, validation=1))) for count in (2, 5))
    assert short < long
    first = plan_films(FilmPlanSize(train=5, validation=2))[:16]
    assert {one.template for one in first} == {f"S{number}" for number in range(1, 8)}
    assert {one.split for one in first} == {Split.TRAIN, Split.VALIDATION}


def test_a_film_is_drawn_like_a_candidate_of_each_class_in_turn() -> None:
    films = {one.number: one for one in plan_films(FilmPlanSize(3, 1), ["S4"]) if one.split is Split.TRAIN}
    assert list(films) == [0, 1000, 1, 1001, 2, 1002]
    assert films[0].request.preset in {"paper", "realistic"}
    assert {films[number].request.preset for number in (2, 1000, 1001, 1002)} == {"reckless"}
    assert films[0].request.values == ""
    assert "response.compliance" in films[2].request.values
