"""Ranks of movements by their signal, stop sign and road."""

from dataclasses import replace

import pytest

from siren_ros.conflicts.right_of_way import Rank, rank_inside, rank_of
from siren_ros.roads.road_network import Connection

FREE = Connection(0, 1, (), "s", None, -1, must_stop=False, junction="j")


@pytest.mark.parametrize(
    ("state", "rank"),
    [
        ("G", Rank.PRIORITY),
        ("g", Rank.GIVES_WAY),
        ("y", Rank.CLEARING),
        ("r", Rank.RED),
        ("u", Rank.RED),
        ("s", Rank.GIVES_WAY),
        ("o", Rank.GIVES_WAY),
        ("O", Rank.PRIORITY),
        ("Y", Rank.CLEARING),
        ("?", Rank.RED),
    ],
)
def test_the_signal_decides_where_there_is_one(state, rank):
    signalled = replace(FREE, signal_id="s", signal_link=1, must_stop=True)
    assert rank_of(signalled, {"s": f"r{state}G"}) is rank


def test_signs_decide_without_a_signal():
    assert rank_of(FREE, {}) is Rank.PRIORITY
    assert rank_of(replace(FREE, gives_way=True), {}) is Rank.GIVES_WAY
    assert rank_of(replace(FREE, must_stop=True, gives_way=True), {}) is Rank.STOP_SIGN


def test_the_junction_is_left_clear_for_who_is_on_it():
    assert rank_inside(Rank.RED) is Rank.PRIORITY
    assert rank_inside(Rank.STOP_SIGN) is Rank.PRIORITY
    assert rank_inside(Rank.GIVES_WAY) is Rank.GIVES_WAY


@pytest.mark.parametrize(
    ("link", "rank"), [(0, Rank.RED), (1, Rank.PRIORITY), (2, Rank.STOP_SIGN), (-1, Rank.STOP_SIGN)]
)
def test_a_link_that_the_signal_does_not_have_leaves_it_to_the_signs(link, rank):
    connection = replace(FREE, signal_id="s", signal_link=link, must_stop=True)
    assert rank_of(connection, {"s": "rG", "t": "GG"}) is rank
    assert rank_of(connection, {"t": "GG"}) is Rank.STOP_SIGN


def test_ranks_in_their_order():
    order = [Rank.RED, Rank.STOP_SIGN, Rank.CLEARING, Rank.GIVES_WAY, Rank.PRIORITY]
    assert sorted(Rank) == order
