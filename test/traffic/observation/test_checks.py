"""The checks of every step."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, NORTHBOUND, Driven, crossing, hand_made

from siren_ros.errors import EpisodeError
from siren_ros.traffic.observation.checks import RESIDUAL_LIMIT_M, check_no_teleport, check_residual
from siren_ros.world.events import Event, EventKind

RECORD = hand_made(crossing(), {EMV: Driven(NORTHBOUND, np.zeros(2)), 2: Driven(NORTHBOUND, np.full(2, 30.0))})


def with_residuals(*residual_m):
    return replace(RECORD.states[1], residual_m=np.array(residual_m))


def test_the_largest_residual_counts():
    check_residual(with_residuals(RESIDUAL_LIMIT_M, 0.0))
    with pytest.raises(EpisodeError, match=r"actor 2 is 3\.50 m .* at step 1; the limit is 3 m"):
        check_residual(with_residuals(0.1, 3.5), limit_m=3.0)
    with pytest.raises(EpisodeError, match="actor 1 "):
        check_residual(with_residuals(RESIDUAL_LIMIT_M + 0.01, 0.0))


def test_a_teleport_fails_and_other_events_do_not():
    traffic = RECORD.traffic[0]
    check_no_teleport(replace(traffic, events=(Event(0, EventKind.COLLISION, 1, 2),)))
    events = (Event(4, EventKind.REALIGNED, 2), Event(4, EventKind.TELEPORT, 2, detail={"reason": "jump"}))
    with pytest.raises(EpisodeError, match=r"teleported actor 2 at step 4 \(jump\)"):
        check_no_teleport(replace(traffic, events=events))
