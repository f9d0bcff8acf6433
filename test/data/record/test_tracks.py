"""Tracks at 10 Hz, and their windows."""

from dataclasses import replace

import hand_made_record as hand
import numpy as np
import pytest
from evaluation.made_records import moving, record_with

from siren_ros.data.record.tracks import REGION, Track, tracks_of, whole_windows
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import BagError


def record(emv_ahead_m: float = 20.0) -> EpisodeRecord:
    """An EMV and a car in front of it, 41 steps; the car is not recorded at step 20."""
    tracks = {
        1: moving(0.0, 0.0, 10.0, steps=41, is_emv=True),
        5: moving(emv_ahead_m, 0.0, 10.0, accel_mps2=0.5, steps=41, without=frozenset({20})),
    }
    return record_with(tracks, hand.crossing())


def test_every_second_step_is_a_frame():
    emv, car = tracks_of(record())
    assert (emv.actor.is_emv, car.actor.actor_id) == (True, 5)
    assert emv.frame.tolist() == list(range(21))
    assert emv.x_m == pytest.approx(np.arange(21))
    assert car.frame.tolist() == [*range(10), *range(11, 21)]
    time_s = car.frame * 0.1
    assert car.x_m == pytest.approx(20.0 + 10.0 * time_s + 0.25 * time_s**2)
    assert car.speed_mps == pytest.approx(10.0 + 0.5 * time_s)
    assert len(car) == 20


def test_windows_are_whole_and_in_the_population():
    _, car = tracks_of(record())
    assert whole_windows(car, 10, "all").tolist() == [0, 11]
    assert whole_windows(car, 8, "all").tolist() == [0, 1, 2, 11, 12, 13]
    assert whole_windows(car, 21, "all").tolist() == []
    inside = car.frame != 3
    assert whole_windows(replace(car, in_region=inside), 6, REGION).tolist() == [4, 11, 12, 13, 14, 15]
    assert whole_windows(replace(car, in_region=inside), 6, "all").tolist() == [0, 1, 2, 3, 4, 11, 12, 13, 14, 15]


def test_a_part_of_a_track():
    _, car = tracks_of(record())
    part = car.window(8, 5)
    assert part.frame.tolist() == [8, 9, 11, 12]
    assert part.x_m == pytest.approx(car.x_m[8:12])
    assert isinstance(part, Track)


def test_the_region_is_around_the_emv():
    near, far = (tracks_of(record(ahead_m))[1] for ahead_m in (20.0, 300.0))
    assert near.in_region.all()
    assert not far.in_region.any()


def test_an_actor_that_nobody_describes_is_refused():
    whole = record()
    with pytest.raises(BagError, match="5 is not"):
        tracks_of(replace(whole, actors={1: whole.actors[1]}))
