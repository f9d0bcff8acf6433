"""Reasons as columns."""

import numpy as np
import pytest
from episode_page.made_decisions import GAP, decision
from episode_page.unpacked import unpacked

from siren_ros.reports.episode_page.columns import ColumnFile
from siren_ros.reports.episode_page.reasons import add_reasons
from siren_ros.simulation.behaviour.driving.free_space import SpeedLimit


def test_reasons_are_sorted_by_actor_and_step_with_the_limits_that_limit() -> None:
    file = ColumnFile()
    limits = {"leader": SpeedLimit(5.0, blocker_id=7), "path": SpeedLimit(), "target": SpeedLimit(70.0)}
    head = add_reasons(
        file,
        [
            (3, {2: decision(6.0, path=SpeedLimit(6.0))}),
            (4, {2: decision(5.0, (GAP,), **limits)}),
            (9, {1: decision(np.nan)}),
        ],
    )
    _, columns = unpacked(file.packed({}))
    assert head == {"why": {"mechanisms": ["leader", "path"], "texts": ["gap", "is free"]}}
    assert columns["why.actor"].tolist() == [1, 2, 2]
    assert columns["why.step"].tolist() == [9, 3, 4]
    assert columns["why.limits"].tolist() == [0, 1, 1]
    assert columns["limit.mechanism"].tolist() == [1, 0]
    assert columns["limit.speed_mps"] == pytest.approx([6.0, 5.0])
    assert columns["limit.blocker"].tolist() == [0, 7]
    assert columns["why.target_mps"] == pytest.approx([-1.0, 6.0, 5.0])
    assert columns["why.guards"].tolist() == [0, 0, 1]
    assert columns["guard.name"].tolist() == [0]
    assert columns["guard.acts"].tolist() == [1]
    assert columns["guard.why"].tolist() == [1]


def test_without_reasons_nothing_is_said() -> None:
    file = ColumnFile()
    assert add_reasons(file, []) == {}
    assert unpacked(file.packed({}))[0]["columns"] == []
