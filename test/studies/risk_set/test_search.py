"""The order of a search, when it ends, and what it chooses."""

import numpy as np
import pytest

from siren_ros.evaluation.risk.evidence import Evidence, Moments
from siren_ros.evaluation.risk.labels import RiskLabel
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.studies.risk_set.candidate import Candidate, Rejected
from siren_ros.studies.risk_set.search import Outcome, Search, Trial, continue_search

NORMAL, NEAR_MISS, COLLISION = RiskClass
EMPTY = Evidence(Moments(*(np.empty(0) for _ in range(6))), (), ())


def candidate(risk: RiskClass, seed: int = 0) -> Candidate:
    return Candidate(EpisodeRequest(seed=seed), 0, RiskLabel(risk), EMPTY)


def after(wanted: tuple[int, int, int], *outcomes: Outcome, budget: int = 50, patience: int = 25) -> Search:
    search = Search(wanted, budget, patience)
    for outcome in outcomes:
        search = search.with_trial(Trial(search.looking_for, outcome))
    return search


def test_it_looks_for_what_is_lacking_most() -> None:
    assert after((4, 2, 1)).looking_for is COLLISION
    assert after((4, 2, 1), candidate(COLLISION)).looking_for is NEAR_MISS
    assert after((4, 2, 1), candidate(COLLISION), candidate(NEAR_MISS)).looking_for is NORMAL
    assert after((4, 2, 0), candidate(NORMAL)).looking_for is NEAR_MISS


def test_it_ends_when_every_class_has_its_videos() -> None:
    assert not after((1, 1, 0), candidate(NORMAL), candidate(NORMAL)).finished
    assert after((1, 1, 0), candidate(NORMAL), candidate(NEAR_MISS)).finished


def test_it_ends_with_the_budget() -> None:
    rejected = Rejected(EpisodeRequest(), "no")
    assert not after((1, 1, 1), rejected, budget=2).finished
    assert after((1, 1, 1), rejected, rejected, budget=2).finished


def test_a_class_is_given_up_after_so_many_candidates_without_it() -> None:
    normal = candidate(NORMAL)
    assert after((9, 1, 1), normal, normal, patience=3).given_up == frozenset()
    search = after((9, 1, 1), candidate(NEAR_MISS), normal, normal, patience=3)
    assert search.given_up == {COLLISION}
    assert search.looking_for is NORMAL
    assert after((3, 1, 1), candidate(NEAR_MISS), normal, normal, normal, patience=3).finished


def test_candidates_that_look_for_another_class_take_no_patience() -> None:
    """A collision at once, and then many near-misses while normal videos are looked for."""
    search = after((4, 0, 1), candidate(COLLISION), *[candidate(NEAR_MISS)] * 3, patience=3)
    assert [trial.looking_for for trial in search.trials] == [COLLISION, NORMAL, NORMAL, NORMAL]
    assert search.given_up == {NORMAL}


def test_a_find_gives_patience_again() -> None:
    rejected = Rejected(EpisodeRequest(), "no")
    search = after((1, 1, 3), rejected, rejected, candidate(COLLISION), rejected, rejected, patience=3)
    assert {trial.looking_for for trial in search.trials} == {COLLISION, NEAR_MISS}
    assert COLLISION not in search.given_up


def test_the_first_of_each_class_are_chosen() -> None:
    outcomes = [candidate(NORMAL, 0), Rejected(EpisodeRequest(), "no"), candidate(NEAR_MISS, 2), candidate(NORMAL, 3)]
    search = after((1, 1, 0), *outcomes, candidate(NEAR_MISS, 4))
    assert {number: one.request.seed for number, one in search.chosen((2, 1, 0)).items()} == {0: 0, 2: 2, 3: 3}
    assert search.found == (2, 2, 0)


@pytest.mark.parametrize("before", [0, 2])
def test_a_search_that_goes_on_asks_for_the_same_candidates(before: int) -> None:
    found = [NORMAL, NEAR_MISS, NORMAL, COLLISION, NORMAL]
    asked: list[tuple[RiskClass, int]] = []

    def request(looking_for: RiskClass, number: int) -> EpisodeRequest:
        asked.append((looking_for, number))
        return EpisodeRequest(seed=number)

    start = after((2, 1, 1), *(candidate(risk, seed) for seed, risk in enumerate(found[:before])))
    told: list[int] = []
    search = continue_search(
        start, request, lambda _, one: candidate(found[one.seed], one.seed), lambda one: told.append(len(one.trials))
    )
    assert [number for _, number in asked] == list(range(before, 4))
    assert told == list(range(before + 1, 5))
    assert asked[-1] == (COLLISION, 3)
    assert search.finished
