import numpy as np
import pytest
from hand_made_record import Driven, line
from made_encounters import CAR, arc, record_of

from siren_ros.evaluation.yielding.lane_offsets import lane_offsets

CHANGES_LEFT = line((5.25, -120.0), (5.25, -80.0), (1.75, -60.0), (1.75, 110.0))


def test_a_lane_change_is_one_way_across_the_road() -> None:
    record = record_of(arc((1.0, 10.0)), {CAR: Driven(CHANGES_LEFT, arc((10.0, 20.0)))})
    offsets = lane_offsets(record, record.track(CAR))
    assert offsets.lateral_m[-1] == pytest.approx(3.5, abs=1e-6)
    assert np.abs(offsets.offset_m).max() == pytest.approx(1.75, abs=0.1)
    assert np.abs(np.diff(offsets.lateral_m)).max() < 0.1, "no jump from lane to lane, nor across the junction"


def test_beyond_the_lanes_the_last_one_counts() -> None:
    leaves = line((5.25, -120.0), (5.25, -80.0), (12.0, -60.0), (12.0, -30.0))
    record = record_of(arc((1.0, 10.0)), {CAR: Driven(leaves, arc((8.0, 10.0)))})
    offsets = lane_offsets(record, record.track(CAR))
    assert offsets.lateral_m[-1] == pytest.approx(-6.75, abs=1e-6)
