"""Quotas of the templates, before and after the searches."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.studies.risk_set.balance import Balance, Finding, papers_balance, quotas, settled, shifted

TEMPLATES = ("S1", "S2", "S3", "S4", "S5", "S6", "S7")
PAPER = Balance((74, 25, 6), 15)


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
    wanted = dict(quotas(PAPER, TEMPLATES))
    hopeless = Finding((15, 4, 0), frozenset({RiskClass.COLLISION}))
    findings = dict.fromkeys(TEMPLATES, hopeless) | {"S4": Finding((9, 5, 1)), "S6": Finding((9, 5, 2))}
    shares = dict(shifted(wanted, findings, PAPER))
    assert totals(shares) == PAPER.total
    assert {key for key, share in shares.items() if share[2]} == {"S4", "S6"}
    assert abs(shares["S4"][2] - shares["S6"][2]) <= 1
    assert dict(shifted(shares, findings, PAPER)) == shares


def test_nobody_is_able_to() -> None:
    wanted = dict(quotas(PAPER, TEMPLATES))
    findings = dict.fromkeys(TEMPLATES, Finding((15, 4, 0), frozenset({RiskClass.COLLISION})))
    shares = dict(shifted(wanted, findings, PAPER))
    assert totals(shares) == (80, 25, 0)


@given(st.lists(st.tuples(*[st.integers(0, 20)] * 3), min_size=7, max_size=7))
def test_what_is_settled_was_found_and_is_never_too_much(found: list[tuple[int, int, int]]) -> None:
    have = dict(zip(TEMPLATES, found, strict=True))
    shares = settled(quotas(PAPER, TEMPLATES), have, 15)
    for key, share in shares.items():
        assert sum(share) <= 15
        assert all(0 <= taken <= there for taken, there in zip(share, have[key], strict=True))
    assert totals(dict(shares))[2] <= PAPER.total[2]
    assert totals(dict(shares))[1] <= PAPER.total[1]


def test_a_surplus_makes_up_for_a_lack() -> None:
    wanted = {"A": (1, 1, 1), "B": (1, 1, 1)}
    assert settled(wanted, {"A": (5, 0, 3), "B": (5, 3, 0)}, 3) == {"A": (1, 0, 2), "B": (1, 2, 0)}


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


def test_a_template_that_is_full_of_rare_ones_gets_no_more() -> None:
    """B has given collisions up; A may have three videos, of which two are near-misses."""
    wanted = {"A": (0, 2, 1), "B": (0, 1, 2)}
    findings = {"A": Finding((3, 2, 3)), "B": Finding((3, 1, 1), frozenset({RiskClass.COLLISION}))}
    assert shifted(wanted, findings, Balance((0, 3, 3), 3)) == {"A": (0, 2, 1), "B": (1, 1, 1)}
    roomy = {"A": (2, 0, 1), "B": (0, 1, 2)}
    assert shifted(roomy, findings, Balance((2, 1, 3), 3)) == {"A": (1, 0, 2), "B": (1, 1, 1)}


def test_what_was_found_before_giving_up_is_kept() -> None:
    wanted = {"A": (0, 0, 3)}
    given_up = {"A": Finding((9, 0, 2), frozenset({RiskClass.COLLISION}))}
    assert shifted(wanted, given_up, Balance((0, 0, 3), 3)) == {"A": (1, 0, 2)}


def test_what_is_lacking_is_dealt_from_the_first_template_that_can() -> None:
    """C has given one collision up; A and B can find them, and A comes first."""
    wanted = {"A": (2, 0, 1), "B": (2, 0, 1), "C": (2, 0, 1)}
    findings = {
        "A": Finding((9, 0, 1)),
        "B": Finding((9, 0, 1)),
        "C": Finding((9, 0, 0), frozenset({RiskClass.COLLISION})),
    }
    assert shifted(wanted, findings, Balance((6, 0, 3), 3)) == {"A": (1, 0, 2), "B": (2, 0, 1), "C": (3, 0, 0)}


def test_a_surplus_is_given_as_far_as_there_are_videos_left() -> None:
    """A lacks two collisions; B has found five, and of its four videos one is a near-miss and one a collision."""
    wanted = {"A": (0, 1, 3), "B": (2, 1, 1)}
    assert settled(wanted, {"A": (9, 1, 0), "B": (9, 1, 5)}, 4) == {"A": (3, 1, 0), "B": (0, 1, 3)}
    # Near-misses come after collisions: what these took is no more there.
    lacking = {"A": (0, 3, 1), "B": (1, 1, 2)}
    assert settled(lacking, {"A": (9, 0, 1), "B": (9, 5, 2)}, 4) == {"A": (3, 0, 1), "B": (0, 2, 2)}


def test_who_lacks_normal_videos_exchanges_with_who_has_more() -> None:
    wanted = {"A": (3, 1, 0), "B": (2, 2, 0), "C": (3, 1, 0)}
    found = {"A": (1, 9, 0), "B": (9, 2, 0), "C": (3, 1, 0)}
    assert settled(wanted, found, 4) == {"A": (1, 3, 0), "B": (4, 0, 0), "C": (3, 1, 0)}
    nobody_has_more = found | {"B": (2, 2, 0)}
    assert settled(wanted, nobody_has_more, 4) == {"A": (1, 1, 0), "B": (2, 2, 0), "C": (3, 1, 0)}


def test_a_collision_is_exchanged_where_there_are_no_near_misses() -> None:
    found = {"A": (1, 0, 5), "B": (9, 0, 1)}
    assert settled({"A": (2, 0, 0), "B": (1, 0, 1)}, found, 2) == {"A": (1, 0, 1), "B": (2, 0, 0)}


@given(st.lists(st.tuples(*[st.integers(0, 20)] * 3), min_size=7, max_size=7))
def test_no_template_lacks_videos_that_another_could_exchange(found: list[tuple[int, int, int]]) -> None:
    have = dict(zip(TEMPLATES, found, strict=True))
    shares = settled(quotas(PAPER, TEMPLATES), have, 15)
    for risk in (RiskClass.NEAR_MISS, RiskClass.COLLISION):
        lack = [key for key, share in shares.items() if sum(share) < 15 and have[key][risk] > share[risk]]
        spare = [key for key, share in shares.items() if share[risk] > 0 and have[key][0] > share[0]]
        assert not (lack and spare)
