"""Messages that a record must not hold, each at its limit."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, NORTHBOUND, Driven, crossing, hand_made

from siren_ros.errors import BagError
from siren_ros.recording.record_checks import (
    LAST_STEP,
    LONGEST_S,
    check_commands,
    check_description,
    check_states,
    check_traffic,
)
from siren_ros.world.commands import VehicleCommands

RECORD = hand_made(crossing(), {EMV: Driven(NORTHBOUND, np.zeros(3)), 2: Driven(NORTHBOUND, np.full(3, 30.0))})


def indices(*values):
    return np.array(values, dtype=np.int32)


@pytest.mark.parametrize("duration", [0.0, 30.0, LONGEST_S])
def test_durations_that_are_allowed(duration):
    check_description(replace(RECORD.description, duration_s=duration))


@pytest.mark.parametrize("duration", [-0.1, math.nextafter(LONGEST_S, math.inf), math.inf, -math.inf, math.nan])
def test_durations_that_are_refused(duration):
    with pytest.raises(BagError, match="duration_s"):
        check_description(replace(RECORD.description, duration_s=duration))


@pytest.mark.parametrize(("step", "allowed"), [(0, True), (LAST_STEP - 1, True), (-1, False), (LAST_STEP, False)])
def test_steps(step, allowed):
    for check, message in (
        (check_states, replace(RECORD.states[0], step=step)),
        (check_commands, replace(VehicleCommands.empty(0, "node"), step=step)),
        (check_traffic, replace(RECORD.traffic[0], step=step)),
    ):
        if allowed:
            check(message)
        else:
            with pytest.raises(BagError, match="steps from 0"):
                check(message)


@pytest.mark.parametrize("column", ["x_m", "actor_id", "residual_m"])
def test_columns_have_one_length(column):
    with pytest.raises(BagError, match="columns of one length"):
        check_states(replace(RECORD.states[0], **{column: getattr(RECORD.states[0], column)[:1]}))


def traffic_of(actors, offsets, edges):
    """Traffic of so many actors with these routes."""
    plain = RECORD.traffic[0]
    columns = {
        name: np.zeros(actors, value.dtype)
        for name, value in vars(plain).items()
        if isinstance(value, np.ndarray) and name not in {"removed", "route_offset", "route_edges"}
    }
    return replace(plain, **columns, route_offset=indices(*offsets), route_edges=indices(*range(edges)))


@pytest.mark.parametrize(
    ("actors", "offsets", "edges"), [(0, (), 0), (2, (), 0), (0, (0,), 0), (2, (0, 3, 5), 5), (2, (1, 1, 4), 5)]
)
def test_routes_that_lie_within_their_list(actors, offsets, edges):
    check_traffic(traffic_of(actors, offsets, edges))


@pytest.mark.parametrize(
    ("actors", "offsets", "edges"),
    [(2, (0, 3, 6), 5), (2, (-1, 3, 5), 5), (2, (0, 4, 3), 5), (2, (0, 3), 5), (2, (0, 1, 2, 3), 5), (1, (0,), 5)],
)
def test_routes_that_do_not(actors, offsets, edges):
    with pytest.raises(BagError, match="routes that lie within route_edges"):
        check_traffic(traffic_of(actors, offsets, edges))
