import numpy as np
import pytest
from hand_made_record import Driven
from made_encounters import CAR, IN_LANE, arc, record_of

from siren_ros.evaluation.yielding.emv_line import EmvLine
from siren_ros.evaluation.yielding.marks.corridor import (
    CorridorSeries,
    corridor_continuity,
    corridor_series,
    corridor_width_m,
    road_cells,
    widest_way_m,
)
from siren_ros.evaluation.yielding.thresholds import YieldThresholds
from siren_ros.recording.episode_record import EpisodeRecord

ACROSS = np.arange(-10.0, 10.05, 0.1)
LIMITS = YieldThresholds()


def road(low_m: float, high_m: float, stations: int = 31) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    return np.tile((low_m < ACROSS) & (high_m > ACROSS), (stations, 1))


def series_of(record: EpisodeRecord) -> CorridorSeries:
    line = EmvLine.of(record)
    assert line is not None
    return corridor_series(record, line, LIMITS)


def test_an_empty_road_is_as_wide_as_it_is() -> None:
    assert widest_way_m(road(-3.05, 3.05), 0.0) == pytest.approx(6.0, abs=0.2)


def test_the_narrowest_place_counts() -> None:
    free = road(-4.05, 4.05)
    free[12, np.abs(ACROSS) > 1.05] = False
    assert widest_way_m(free, 0.0) == pytest.approx(2.1, abs=0.2)


def test_gaps_side_by_side_do_not_make_a_way() -> None:
    free = road(-4.05, 4.05)
    free[10, ACROSS > -2.0] = False
    free[12, ACROSS < 2.0] = False
    assert widest_way_m(free, 0.0) == 0.0
    free = road(-4.05, 4.05)
    free[10, ACROSS > -2.0] = False
    free[30, ACROSS < 2.0] = False
    assert widest_way_m(free, 0.0) > 1.5, "with 20 m between them there is time to change sides"


def test_the_road_has_its_lanes_and_its_shoulder() -> None:
    record = record_of(arc((10.0, 12.0)), {})
    line = EmvLine.of(record)
    assert line is not None
    (cells,) = road_cells(record.network, line, np.array([50.0]))
    # The shoulder ends 4.25 m to the right; the road of its own begins 7 m to the right.
    assert ACROSS[cells].min() == pytest.approx(-4.25, abs=0.15)
    assert ACROSS[cells].max() == pytest.approx(5.25, abs=0.15)
    assert cells.sum() == pytest.approx(95, abs=3)


def test_a_car_in_the_lane_leaves_the_rest_of_the_road() -> None:
    """The road is 3.5 + 3.5 + 2.5 m wide; the way to the left of the car is 5.25 − 0.9 m."""
    record = record_of(arc((10.0, 12.0)), {CAR: Driven(IN_LANE, arc((0.0, 12.0), start_m=60.0))})
    series = series_of(record)
    ahead = series.contested & (series.step < 100)
    assert series.width_m[ahead].min() == pytest.approx(4.35, abs=0.3)
    assert series.passable[ahead & (series.step < 60)].all()
    assert corridor_width_m(series).value > 3.0
    assert corridor_continuity(series).value > 0.4


def test_a_closed_road_has_no_corridor() -> None:
    cars = {
        CAR + place: Driven(IN_LANE + np.array([2.6 - 2.3 * place, 0.0]), arc((0.0, 12.0), start_m=60.0))
        for place in range(4)
    }
    series = series_of(record_of(arc((10.0, 12.0)), cars))
    ahead = series.contested & (series.step < 100)
    assert ahead.any()
    assert not series.passable[ahead].any()


def test_an_empty_road_has_no_corridor_to_speak_of() -> None:
    series = series_of(record_of(arc((10.0, 12.0)), {}))
    assert len(series.step) > 5
    assert corridor_width_m(series).lack
    assert corridor_continuity(series).lack
