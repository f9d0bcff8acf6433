"""Quotas of the templates, before and after the searches."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.running.studies.risk_set.candidate import Candidate, Outcome, Rejected
from siren_ros.running.studies.risk_set.search import (
    Balance,
    Journal,
    Search,
    Trial,
    balanced,
    continue_search,
    enlarged,
    outcome_as_json,
    papers_balance,
    quotas,
    settled,
    shifted,
)
from siren_ros.scoring.evaluation.risk.labels import (
    Evidence,
    Moments,
    Reason,
    RiskClass,
    RiskLabel,
    SeenContact,
    SeenEncroachment,
)
from siren_ros.simulation.scenario.episode import EpisodeRequest

TEMPLATES = ("S1", "S2", "S3", "S4", "S5", "S6", "S7")
PAPER = Balance((74, 25, 6), 15)
NONE = frozenset[RiskClass]()
NORMAL, NEAR_MISS, COLLISION = RiskClass
GIVEN_UP = frozenset({COLLISION})


def totals(shares: dict[str, tuple[int, int, int]]) -> tuple[int, ...]:
    return tuple(sum(column) for column in zip(*shares.values(), strict=True))


def test_the_papers_balance_is_dealt_evenly() -> None:
    shares = dict(quotas(PAPER, TEMPLATES))
    assert totals(shares) == PAPER.total
    assert {sum(share) for share in shares.values()} == {15}
    assert {share[2] for share in shares.values()} == {0, 1}
    assert {share[1] for share in shares.values()} == {3, 4}


@pytest.mark.parametrize("total", [(74, 25, 7), (15, 0, 0)])
def test_counts_that_do_not_add_up_are_refused(total: tuple[int, int, int]) -> None:
    with pytest.raises(InputError, match="7 templates x 15"):
        quotas(Balance(total, 15), TEMPLATES)


def test_others_find_what_one_has_given_up() -> None:
    given = dict(quotas(PAPER, TEMPLATES))
    hopeless = ((15, 4, 0), GIVEN_UP)
    findings = dict.fromkeys(TEMPLATES, hopeless) | {"S4": ((9, 5, 1), NONE), "S6": ((9, 5, 2), NONE)}
    shares = dict(shifted(given, findings, PAPER))
    assert totals(shares) == PAPER.total
    assert {key for key, share in shares.items() if share[2]} == {"S4", "S6"}
    assert abs(shares["S4"][2] - shares["S6"][2]) <= 1
    assert dict(shifted(shares, findings, PAPER)) == shares


@given(st.lists(st.tuples(*[st.integers(0, 20)] * 3), min_size=7, max_size=7))
def test_what_is_settled_was_found_and_is_never_too_much(found: list[tuple[int, int, int]]) -> None:
    have = dict(zip(TEMPLATES, found, strict=True))
    shares = settled(quotas(PAPER, TEMPLATES), have, 15)
    for key, share in shares.items():
        assert sum(share) <= 15
        assert all(0 <= taken <= there for taken, there in zip(share, have[key], strict=True))
    assert totals(dict(shares))[2] <= PAPER.total[2]
    assert totals(dict(shares))[1] <= PAPER.total[1]
    for risk in (NEAR_MISS, COLLISION):
        lack = [key for key, share in shares.items() if sum(share) < 15 and have[key][risk] > share[risk]]
        spare = [key for key, share in shares.items() if share[risk] > 0 and have[key][0] > share[0]]
        assert not (lack and spare), "a template lacks videos that another one could exchange"


def test_the_papers_shares_of_other_numbers() -> None:
    assert papers_balance(7) == PAPER
    # 2 templates of 15: 25/105 and 6/105 of 30 videos are 7.1 and 1.7.
    assert papers_balance(2) == Balance((21, 7, 2), 15)
    assert papers_balance(1, 3) == Balance((2, 1, 0), 3)


def test_the_rare_ones_are_dealt_from_where_the_rarer_ones_end() -> None:
    """Two collisions go to A and B; of four near-misses C has the first, and so on in turn."""
    assert dict(quotas(Balance((3, 4, 2), 3), ("A", "B", "C"))) == {"A": (1, 1, 1), "B": (1, 1, 1), "C": (1, 2, 0)}


def test_more_rare_ones_than_a_template_has_videos_are_refused() -> None:
    with pytest.raises(InputError, match="at most 2 rare videos for A"):
        quotas(Balance((0, 6, 0), 2), ("A", "B", "A"))


@pytest.mark.parametrize(
    ("shares", "findings", "total", "expected"),
    [
        # B has given collisions up; A may have three videos, of which two are near-misses: it is full.
        ([(0, 2, 1), (0, 1, 2)], [((3, 2, 3), NONE), ((3, 1, 1), GIVEN_UP)], (0, 3, 3), [(0, 2, 1), (1, 1, 1)]),
        ([(2, 0, 1), (0, 1, 2)], [((3, 2, 3), NONE), ((3, 1, 1), GIVEN_UP)], (2, 1, 3), [(1, 0, 2), (1, 1, 1)]),
        # What was found before giving up is kept.
        ([(0, 0, 3)], [((9, 0, 2), GIVEN_UP)], (0, 0, 3), [(1, 0, 2)]),
        # C has given one collision up; A and B can find them, and A comes first.
        (
            [(2, 0, 1), (2, 0, 1), (2, 0, 1)],
            [((9, 0, 1), NONE), ((9, 0, 1), NONE), ((9, 0, 0), GIVEN_UP)],
            (6, 0, 3),
            [(1, 0, 2), (2, 0, 1), (3, 0, 0)],
        ),
        # A has found none, and has not given up.
        (
            [(2, 0, 1), (2, 0, 1), (2, 0, 1)],
            [((9, 0, 0), NONE), ((9, 0, 1), NONE), ((9, 0, 0), GIVEN_UP)],
            (6, 0, 3),
            [(2, 0, 1), (1, 0, 2), (3, 0, 0)],
        ),
    ],
)
def test_quotas_are_shifted_to_templates_that_find_a_class_and_have_room(shares, findings, total, expected) -> None:
    before, found = dict(zip("ABC", shares, strict=False)), dict(zip("ABC", findings, strict=False))
    assert shifted(before, found, Balance(total, 3)) == dict(zip("ABC", expected, strict=False))


@pytest.mark.parametrize(
    ("shares", "found", "per_template", "expected"),
    [
        # A surplus makes up for a lack, as far as there are videos left. Near-misses come after collisions.
        ([(1, 1, 1), (1, 1, 1)], [(5, 0, 3), (5, 3, 0)], 3, [(1, 0, 2), (1, 2, 0)]),
        ([(0, 1, 3), (2, 1, 1)], [(9, 1, 0), (9, 1, 5)], 4, [(3, 1, 0), (0, 1, 3)]),
        ([(0, 3, 1), (1, 1, 2)], [(9, 0, 1), (9, 5, 2)], 4, [(3, 0, 1), (0, 2, 2)]),
        # A template that lacks normal videos exchanges with one that has more, if there is one.
        ([(3, 1, 0), (2, 2, 0), (3, 1, 0)], [(1, 9, 0), (9, 2, 0), (3, 1, 0)], 4, [(1, 3, 0), (4, 0, 0), (3, 1, 0)]),
        ([(3, 1, 0), (2, 2, 0), (3, 1, 0)], [(1, 9, 0), (2, 2, 0), (3, 1, 0)], 4, [(1, 1, 0), (2, 2, 0), (3, 1, 0)]),
        # It exchanges a collision where there are no near-misses.
        ([(2, 0, 0), (1, 0, 1)], [(1, 0, 5), (9, 0, 1)], 2, [(1, 0, 1), (2, 0, 0)]),
    ],
)
def test_templates_give_what_others_lack(shares, found, per_template, expected) -> None:
    quota, have = dict(zip("ABC", shares, strict=False)), dict(zip("ABC", found, strict=False))
    assert settled(quota, have, per_template) == dict(zip("ABC", expected, strict=False))


EMPTY = Evidence(Moments(*(np.empty(0) for _ in range(7))), (), ())


def candidate(risk: RiskClass, seed: int = 0) -> Candidate:
    return Candidate(EpisodeRequest(seed=seed), 0, RiskLabel(risk), EMPTY)


def after(quota: tuple[int, int, int], *outcomes: Outcome, budget: int = 50, patience: int = 25) -> Search:
    search = Search(quota, budget, patience)
    for outcome in outcomes:
        search = search.with_trial(Trial(search.looking_for, outcome))
    return search


def test_it_looks_for_what_is_lacking_most_until_nothing_is_or_the_budget_ends() -> None:
    assert after((4, 2, 1)).looking_for is COLLISION
    assert after((4, 2, 1), candidate(COLLISION)).looking_for is NEAR_MISS
    assert after((4, 2, 1), candidate(COLLISION), candidate(NEAR_MISS)).looking_for is NORMAL
    assert after((4, 2, 0), candidate(NORMAL)).looking_for is NEAR_MISS
    assert not after((1, 1, 0), candidate(NORMAL), candidate(NORMAL)).finished
    assert after((1, 1, 0), candidate(NORMAL), candidate(NEAR_MISS)).finished
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
    assert {number: video.request.seed for number, video in search.chosen((2, 1, 0)).items()} == {0: 0, 2: 2, 3: 3}
    assert search.found == (2, 2, 0)


@pytest.mark.parametrize("before", [0, 2])
def test_a_search_that_goes_on_asks_for_the_same_candidates(before: int) -> None:
    risks = [NORMAL, NEAR_MISS, NORMAL, COLLISION, NORMAL]
    asked: list[tuple[RiskClass, int]] = []

    def request(looking_for: RiskClass, number: int) -> EpisodeRequest:
        asked.append((looking_for, number))
        return EpisodeRequest(seed=number)

    start = after((2, 1, 1), *(candidate(risk, seed) for seed, risk in enumerate(risks[:before])))
    kept: list[Search] = []
    search = continue_search(start, request, lambda _, asked: candidate(risks[asked.seed], asked.seed), kept.append)
    assert [number for _, number in asked] == list(range(before, 4))
    assert [len(now.trials) for now in kept] == list(range(before + 1, 5))
    assert asked[-1] == (COLLISION, 3)
    assert search.finished


def collision() -> Candidate:
    values = ([1 / 3, 0.1, 2.9], [5.0, 5.1, 1.0], [2.0, 3.4, 0.1], [3.0, 2.0, 9.0], [0.0, 3.4, 1.2])
    moments = Moments(np.arange(5, 8), np.array([4, 4, 9], np.uint32), *map(np.array, values))
    evidence = Evidence(moments, (SeenEncroachment(4, 6, 0.35),), (SeenContact(9, 7, 1.7),))
    label = RiskLabel(RiskClass.COLLISION, Reason.CONTACT, 9, 7, 1.7)
    return Candidate(EpisodeRequest(template="S4", seed=12, values="emv.speed_mps=14.25"), 40, label, evidence)


def noted(trials: list[Trial]) -> list[tuple[RiskClass, dict[str, object]]]:
    return [(trial.looking_for, outcome_as_json(trial.outcome)) for trial in trials]


OUTCOMES: list[Outcome] = [collision(), Rejected(EpisodeRequest(template="S6"), "SUMO failed")]
TRIALS = [Trial(COLLISION, OUTCOMES[0]), Trial(NEAR_MISS, OUTCOMES[1])]


def test_outcomes_in_the_order_of_the_candidates(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "search" / "S4.jsonl")
    assert journal.read() == []
    for number, trial in enumerate(TRIALS):
        journal.note(number, trial)
    assert noted(journal.read()) == noted(TRIALS)
    journal.note(0, TRIALS[1])
    assert noted(journal.read()) == noted([TRIALS[1], TRIALS[1]])


def test_a_line_that_was_cut_off_is_left_out_and_written_over(tmp_path: Path) -> None:
    path = tmp_path / "S4.jsonl"
    journal = Journal(path)
    for number in range(2):
        journal.note(number, TRIALS[number])
    path.write_bytes(path.read_bytes()[:-20])
    assert noted(journal.read()) == noted(TRIALS[:1])
    journal.note(1, TRIALS[0])
    assert noted(journal.read()) == noted([TRIALS[0], TRIALS[0]])


def test_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "S4.jsonl"
    path.write_text('{"number": 1}\n')
    with pytest.raises(InputError, match=r"S4\.jsonl"):
        Journal(path).read()


def test_balanced_templates_have_the_same_shares() -> None:
    """What a template lacks of one class costs it the others; the template then tells nothing about the class."""
    shares = {"A": (6, 4, 2), "B": (6, 4, 2), "C": (6, 4, 2)}
    found = {"A": (9, 9, 9), "B": (9, 9, 1), "C": (9, 9, 0)}
    assert balanced(shares, found) == {"A": (6, 4, 2), "B": (3, 2, 1), "C": (0, 0, 0)}


def test_templates_that_find_all_find_what_is_lacking() -> None:
    balance, gave_up = Balance((18, 12, 6), 12, within=True), frozenset({RiskClass.COLLISION})
    shares = dict.fromkeys("ABC", (6, 4, 2))
    findings = {"A": ((6, 5, 2), frozenset()), "B": ((8, 4, 1), gave_up), "C": ((6, 4, 2), frozenset())}
    changed = {"A": (8, 5, 3), "B": (3, 2, 1), "C": (7, 5, 2)}
    assert enlarged(shares, findings, balance) == changed
    findings = {"A": ((8, 5, 3), frozenset()), "B": ((8, 4, 1), gave_up), "C": ((7, 4, 2), gave_up)}
    assert enlarged(changed, findings, balance) == {"A": (10, 6, 4), "B": (3, 2, 1), "C": (5, 4, 1)}
    nobody = {key: (found, gave_up) for key, (found, _) in findings.items()}
    assert enlarged(changed, nobody, balance) == {"A": (8, 5, 3), "B": (3, 2, 1), "C": (5, 4, 1)}


@given(st.lists(st.tuples(*[st.integers(0, 12)] * 3), min_size=2, max_size=4))
def test_balanced_takes_no_more_than_was_found(found: list[tuple[int, int, int]]) -> None:
    names = [str(number) for number in range(len(found))]
    given_to = balanced(dict.fromkeys(names, (6, 4, 2)), dict(zip(names, found, strict=True)))
    for name, have in zip(names, found, strict=True):
        assert all(part <= least for part, least in zip(given_to[name], have, strict=True))
        share = min(1.0, *(part / want for part, want in zip(have, (6, 4, 2), strict=True)))
        assert given_to[name] == tuple(int(share * want + 1e-9) for want in (6, 4, 2))
