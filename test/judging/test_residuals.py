from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EASTBOUND, EMV, NORTHBOUND, Driven, crossing, hand_made

from siren_ros.judging.residuals import summarise_residuals
from siren_ros.world.actors import Owner


def summary_of(residual_m, owner):
    """Of a record with two actors, whose residuals and owners are given as (steps, 2)."""
    count = len(residual_m)
    record = hand_made(crossing(), {EMV: Driven(NORTHBOUND, np.zeros(count)), 2: Driven(EASTBOUND, np.zeros(count))})
    states = tuple(
        replace(state, residual_m=np.array(residual, dtype=float), owner=np.array(owners, dtype=np.uint8))
        for state, residual, owners in zip(record.states, residual_m, owner, strict=True)
    )
    return summarise_residuals(replace(record, states=states))


def test_percentiles_are_over_the_rows_that_sumo_owns():
    """From 0 to 1 m in steps of 1 cm; what ROS owns is ten times as far away."""
    found = summary_of([(0.01 * k, 10.0) for k in range(101)], [(Owner.SUMO, Owner.ROS)] * 101)
    assert (found.median_m, found.p99_m, found.max_m) == pytest.approx((0.5, 0.99, 1.0))


def test_all_are_zero_where_sumo_owns_nobody():
    found = summary_of([(3.0, 4.0)] * 5, [(Owner.ROS, Owner.ROS)] * 5)
    assert (found.median_m, found.p99_m, found.max_m) == (0.0, 0.0, 0.0)
