from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import Driven
from made_encounters import CAR, IN_LANE, arc, line_of, record_of
from shapely import Point, Polygon

from siren_ros.base.numerics.geometry import footprint_corners
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.evaluation.yielding.corridor import (
    CorridorSeries,
    corridor_continuity,
    corridor_series,
    corridor_width_m,
    covered_cells,
    road_cells,
    widest_way_m,
)
from siren_ros.scoring.evaluation.yielding.encounters import EmvLine, OnLine, YieldThresholds
from siren_ros.simulation.roads.road_network import RoadNetwork

ACROSS = np.arange(-10.0, 10.05, 0.1)
LIMITS = YieldThresholds()


def road(low_m: float, high_m: float, stations: int = 31) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    return np.tile((low_m < ACROSS) & (high_m > ACROSS), (stations, 1))


def series_of(record: EpisodeRecord) -> CorridorSeries:
    return corridor_series(record, line_of(record), LIMITS)


@pytest.fixture
def empty_road() -> tuple[RoadNetwork, EmvLine]:
    record = record_of(arc((10.0, 12.0)), {})
    return record.network, line_of(record)


def test_an_empty_road_is_as_wide_as_it_is() -> None:
    assert widest_way_m(road(-3.05, 3.05), 0.0) == pytest.approx(6.0, abs=0.2)


def test_the_narrowest_place_counts() -> None:
    free = road(-4.05, 4.05)
    free[12, np.abs(ACROSS) > 1.05] = False
    assert widest_way_m(free, 0.0) == pytest.approx(2.1, abs=0.2)


def test_gaps_side_by_side_do_not_make_a_way() -> None:
    for second, wide in ((12, False), (30, True)):
        free = road(-4.05, 4.05)
        free[10, ACROSS > -2.0] = False
        free[second, ACROSS < 2.0] = False
        width_m = widest_way_m(free, 0.0)
        assert width_m > 1.5 if wide else width_m == 0.0, "with 20 m between them there is time to change sides"


def test_the_road_has_its_lanes_and_its_shoulder(empty_road: tuple[RoadNetwork, EmvLine]) -> None:
    network, line = empty_road
    (cells,) = road_cells(network, line, np.array([50.0]))
    # The shoulder ends 4.25 m to the right; the road of its own begins 7 m to the right.
    assert ACROSS[cells].min() == pytest.approx(-4.25, abs=0.15)
    assert ACROSS[cells].max() == pytest.approx(5.25, abs=0.15)
    assert cells.sum() == pytest.approx(95, abs=3)


def test_the_road_begins_and_ends_with_its_lanes(empty_road: tuple[RoadNetwork, EmvLine]) -> None:
    network, line = empty_road
    first, second, last = road_cells(network, line, np.array([0.0, 0.3, line.line.length_m]))
    assert first.tolist() == second.tolist()
    assert first.sum() == pytest.approx(95, abs=3)
    assert last.any()


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


def test_the_way_narrows_on_its_nearer_side() -> None:
    """Free from −1 to 4 m: around 0 m the nearest edge is 1 m away; around 1.5 m, 2.5 m."""
    free = road(-1.05, 4.05)
    assert widest_way_m(free[:1], 0.0) == pytest.approx(2 * 1.4, abs=0.15)
    assert widest_way_m(free[:1], 3.5) == pytest.approx(2 * 0.8, abs=0.15)
    assert widest_way_m(free[:5], 0.0) == pytest.approx(2 * 1.4, abs=0.15), "no wider than where it begins"


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_the_way_changes_sides_by_three_tenths_of_a_metre_per_metre(mirror: float) -> None:
    """Right of −1 m before a gate, left of 1 m behind it: 2 m and the way's own width aside."""
    free = road(-4.05, 4.05)
    free[:10, ACROSS * mirror > -1.0] = False
    free[16:, ACROSS * mirror < 1.0] = False
    # From −2 − w/2 to 2 … seven steps of 0.3 m carry a way of no width from −1 to 1.1 m.
    assert 0.0 < widest_way_m(free, -1.5 * mirror) < 0.5
    free[12:, ACROSS * mirror < 1.0] = False
    assert widest_way_m(free, -1.5 * mirror) == 0.0


def test_nothing_is_free_where_the_emv_is() -> None:
    free = road(-4.05, 4.05)
    free[0, np.abs(ACROSS - 2.0) < 0.5] = False
    assert widest_way_m(free, 2.0) == 0.0
    assert widest_way_m(free, -2.0) > 0.0


def test_a_turned_car_takes_its_width_where_it_is() -> None:
    """A car of 4 m across the road, 3 m to the left of the line; half a metre more, as stations are 1 m apart."""
    across = Driven(np.array([(0.25, -60.0), (4.25, -60.0)]), arc((0.0, 12.0), start_m=2.0))
    series = series_of(record_of(arc((10.0, 12.0)), {CAR: across}))
    near = series.contested & (series.step < 90)
    # Its right end is 0.5 m to the left of the line: the road ends 4.25 m to the right.
    assert near.any()
    assert series.width_m[near].min() == pytest.approx(4.25 + 0.5, abs=0.25)


def test_the_corridor_is_measured_every_half_second_thirty_metres_ahead() -> None:
    """A car whose rear is 60 m after the start; the EMV's front is 3 m ahead of its centre at 0.5 m per step."""
    record = record_of(arc((10.0, 12.0)), {CAR: Driven(IN_LANE, arc((0.0, 12.0), start_m=62.5))})
    series = series_of(record)
    assert set(np.diff(series.step)) == {10}
    assert series.step[0] == 0
    first = series.step[series.contested][0]
    assert 3.0 + 0.5 * first + 30.0 >= 60.0 > 3.0 + 0.5 * (first - 10) + 30.0
    last = series.step[series.contested][-1]
    assert 3.0 + 0.5 * last <= 65.0 < 3.0 + 0.5 * (last + 10)
    assert series.needed_m == pytest.approx(2.1 + 2 * 0.2)


def test_share_and_median_are_of_the_contested_times() -> None:
    series = CorridorSeries(
        np.arange(5), np.array([2.0, 2.6, 9.0, 2.4, 4.0]), np.array([True, True, False, True, True]), 2.5
    )
    assert corridor_width_m(series).value == pytest.approx(2.5)
    assert corridor_continuity(series).value == pytest.approx(0.5)


@pytest.mark.parametrize(("start_m", "last"), [(1.5, 380), (0.5, 390)])
def test_the_corridor_is_measured_while_the_line_goes_on_for_all_of_the_look_ahead(start_m: float, last: int) -> None:
    """The line ends at 109 m, 227.5 m or 228.5 m after its start: from 195 m on, 3 m and 30 m ahead are 228 m."""
    record = record_of(arc((10.0, 22.0 - 0.1 * start_m), start_m=start_m), {})
    line = line_of(record)
    assert line.line.length_m == pytest.approx(229.0 - start_m)
    assert corridor_series(record, line, LIMITS).step[-1] == last


@pytest.mark.parametrize("turn_deg", [0.0, 25.0, -40.0, 90.0, 135.0, -160.0])
@pytest.mark.parametrize(("arc_m", "left_m"), [(12.0, 1.5), (9.5, -2.2)])
def test_a_body_covers_the_cells_of_its_turned_rectangle(turn_deg: float, arc_m: float, left_m: float) -> None:
    """A body of 4.6 m by 1.8 m, half a metre longer at each end: stations are 1 m apart."""
    turn = np.radians(turn_deg)
    track = record_of(arc((10.0, 1.0)), {}).track(1).select(np.arange(21) == 0)
    numbers = (np.array([value]) for value in (arc_m, left_m, turn, 2.0, 1.0))
    other = OnLine(track, *numbers)
    stations = np.arange(0.0, 25.0, 1.0)
    found = covered_cells(other, 0, (4.6, 1.8), stations)
    corners = footprint_corners(*(np.array([value]) for value in (arc_m, left_m, turn, 5.6, 1.8)))[0]
    body = Polygon(corners)
    for row, column in np.argwhere(np.ones_like(found)).tolist():
        place = Point(stations[row], ACROSS[column])
        if abs(body.exterior.distance(place)) > 1e-6:
            assert found[row, column] == body.contains(place)
    assert found.sum() > 10


def test_where_everything_is_free_the_way_is_as_wide_as_the_search() -> None:
    """10 m to each side, and the cells at their ends."""
    free = np.ones((5, len(ACROSS)), dtype=np.bool_)
    assert widest_way_m(free, 0.0) == pytest.approx(20.1)
    # From 8.95 m the way begins up to 0.3 m nearer to the middle, at 8.7 m: 14 cells from the end.
    assert widest_way_m(free[:1], 8.95) == pytest.approx(2.7)
    assert widest_way_m(free[:1], -8.95) == pytest.approx(2.7)


def test_the_order_of_lanes_does_not_matter(empty_road: tuple[RoadNetwork, EmvLine]) -> None:
    network, line = empty_road
    places = np.arange(0.0, 140.0, 5.0)
    expected = road_cells(network, line, places)
    for first in range(len(network.lanes)):
        turned = replace(network, lanes=network.lanes[first:] + network.lanes[:first])
        assert np.array_equal(road_cells(turned, line, places), expected)


def test_a_lane_reaches_half_a_metre_beyond_its_ends(empty_road: tuple[RoadNetwork, EmvLine]) -> None:
    """The EMV's lane ends 100 m after its start; it is as wide as it is, up to the edge of the search."""
    network, line = empty_road
    (lane,) = (lane for lane in network.lanes if lane.lane_id == "s_in_1")
    alone = replace(network, lanes=(lane,))
    cells = road_cells(alone, line, np.array([0.0, 50.0, 99.0, 99.8, 100.3, 100.7]))
    assert cells.any(axis=1).tolist() == [True] * 5 + [False]
    assert ACROSS[cells[1]] == pytest.approx(np.arange(-1.8, 1.85, 0.1))
    wide = replace(alone, lanes=(replace(lane, width_m=30.0),))
    assert road_cells(wide, line, np.array([50.0])).all()
