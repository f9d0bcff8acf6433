"""Errors that cross from one process to another."""

import pickle

import pytest

from siren_ros.errors import BagError, EpisodeError, InputError, MapError, SirenError


@pytest.mark.parametrize(
    "error",
    [
        InputError("template", "S9", "one of S1, S2"),
        MapError("town.xodr", "a map that can be read"),
        BagError("bags/x", "a folder that exists"),
        EpisodeError("SUMO has gone"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_of_workers_arrive_whole(error: SirenError) -> None:
    arrived = pickle.loads(pickle.dumps(error))  # noqa: S301 - made here
    assert type(arrived) is type(error)
    assert str(arrived) == str(error)
    assert arrived.exit_code == error.exit_code
    assert vars(arrived) == vars(error)
