from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, NORTHBOUND, Driven, at_speed, crossing, hand_made, line

from siren_ros.judging.realisation import realisation_of
from siren_ros.recording.episode_record import EpisodeRecord

SITE = {"junction": "J"}


def test_arrival_is_when_the_emv_is_nearest_to_the_junction() -> None:
    """The junction's centre is at 110 m of the northbound way (the stop line at 100 m)."""
    slow, fast = (
        realisation_of(_at_junction({EMV: Driven(NORTHBOUND, at_speed(30.0, speed_mps, 400))}))
        for speed_mps in (5.0, 10.0)
    )
    assert slow.arrival_s == pytest.approx(2.0 * fast.arrival_s, abs=0.1)
    assert slow.emv_speed_mps == pytest.approx(5.0, abs=0.1)
    assert slow.queue == slow.yielding == 0


def test_an_emv_that_never_comes_does_not_arrive() -> None:
    found = realisation_of(_at_junction({EMV: Driven(NORTHBOUND, np.full(100, 20.0))}))
    assert np.isnan(found.arrival_s)


def test_the_queue_is_who_stands_around_the_emv_before_it_arrives() -> None:
    standing = {
        number: Driven(line((4.0, -100.0), (4.0, 100.0)), np.full(400, 60.0 + 7.0 * number)) for number in (2, 3)
    }
    rolling = {4: Driven(line((8.0, -100.0), (8.0, 100.0)), at_speed(20.0, 5.0, 400) % 190.0)}
    emv = {EMV: Driven(NORTHBOUND, at_speed(30.0, 10.0, 400))}
    assert realisation_of(_at_junction({**emv, **standing, **rolling})).queue == 2


def _at_junction(vehicles: dict[int, Driven]) -> EpisodeRecord:
    record = hand_made(crossing(), vehicles)
    return replace(record, description=replace(record.description, site=SITE))
