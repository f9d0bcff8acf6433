"""Argoverse 2's columns of one scenario: who counts as what, and when."""

from dataclasses import replace

import numpy as np
import pytest
from datasets.made_tracks import made_tracks

from siren_ros.datasets.argoverse2.exporter import (
    FOCAL,
    FRAGMENT,
    OBSERVED,
    SCORED,
    STEPS,
    UNSCORED,
    Argoverse2Exporter,
    scenario_id,
    scenario_table,
)
from siren_ros.datasets.sources.tracks import Track
from siren_ros.errors import InputError


def lasting(track: Track, first: int, count: int) -> Track:
    """The same vehicle over other frames."""
    place = np.resize(np.arange(len(track)), count)
    arrays = {name: values[place] for name, values in vars(track).items() if isinstance(values, np.ndarray)}
    return replace(track, **{**arrays, "frame": np.arange(first, first + count)})


def test_columns_of_a_scenario_that_begins_at_frame_40() -> None:
    emv, car, bus = made_tracks()
    first = 40
    windows = [
        lasting(emv, first, STEPS),
        lasting(car, first, STEPS),
        lasting(bus, first + OBSERVED - 3, 3),
        lasting(replace(bus, actor=replace(bus.actor, actor_id=11)), first + OBSERVED, 5),
    ]
    table = scenario_table(windows, 5, 1, first, "name", "town")
    counts = [STEPS, STEPS, 3, 5]
    assert table["track_id"].tolist() == np.repeat(["AV", "5", "9", "11"], counts).tolist()
    assert table["object_type"].tolist() == np.repeat(["vehicle", "vehicle", "bus", "bus"], counts).tolist()
    # One that is there all the time, the focal track, one that is there at the present, and one that comes later.
    assert table["object_category"].tolist() == np.repeat([SCORED, FOCAL, UNSCORED, FRAGMENT], counts).tolist()
    assert (FRAGMENT, UNSCORED, SCORED, FOCAL) == (0, 1, 2, 3)
    assert table["timestep"][:STEPS].tolist() == list(range(STEPS))
    assert table["timestep"][-5:].tolist() == list(range(OBSERVED, OBSERVED + 5))
    assert table["observed"].tolist() == (table["timestep"] < 50).tolist()
    assert OBSERVED == 50
    assert set(table["focal_track_id"]) == {"5"}
    assert set(table["start_timestamp"].tolist()) == {4_000_000_000}
    assert set(table["end_timestamp"].tolist()) == {4_000_000_000 + (STEPS - 1) * 100_000_000}
    assert set(table["num_timestamps"].tolist()) == {STEPS}
    assert table["position_x"][:3] == pytest.approx([0.0, 1.0, 2.0])
    assert table["velocity_x"][STEPS] == pytest.approx(8.0 * np.cos(1.0))
    assert set(scenario_table(windows, 1, 1, first, "name", "town")["focal_track_id"]) == {"AV"}


def test_names_have_no_underscores() -> None:
    assert scenario_id("S2_L2_seed0_town", 12, 49) == "S2-L2-seed0-town-v12-f000049"


@pytest.mark.parametrize("stride", ["0", "-1", "x", "1.5"])
def test_a_stride_is_a_whole_number(stride: str) -> None:
    with pytest.raises(InputError, match="stride"):
        Argoverse2Exporter("all", stride)
    Argoverse2Exporter("all", "1")
