from dataclasses import replace

import pytest

from siren_ros.errors import InputError
from siren_ros.lab.benchmarks.study_sizes import sizes_of
from siren_ros.running.studies.episode_row import EpisodeRow, Status

_EPISODE = ("S1_seed0", "own", "S1", "L3", 0, "town", "paper", "none", "clear", 0, "", "", Status.COMPLETE)
RECORDED = EpisodeRow(*_EPISODE, bag="episodes/S1_seed0", bag_bytes=2_000_000, cpu_s=3.6)


def test_sizes_are_means_over_the_episodes_that_were_made() -> None:
    changes = ({}, {"bag_bytes": 4_000_000, "cpu_s": 7.2}, {"bag": "", "cpu_s": 100.0})
    rows = [replace(RECORDED, **changed) for changed in changes]
    sizes = sizes_of(rows)
    assert sizes == pytest.approx(
        {"episodes": 2, "processor_s": 5.4, "bag_mb": 3.0, "core_hours_of_10000": 15.0, "gb_of_10000": 30.0}
    )
    with pytest.raises(InputError, match="episodes that were made"):
        sizes_of(rows[2:])
