"""Where vehicles are relative to a line, and how the EMV's own line is made."""

from dataclasses import replace

import numpy as np
import pytest
from evaluation.made_records import Track, moving, record_with
from hand_made_record import EMV, Driven, line
from made_encounters import CAR, arc, record_of

from siren_ros.errors import InputError
from siren_ros.evaluation.yielding.emv_line import EmvLine, OnLine, on_line
from siren_ros.numerics.polyline import Polyline
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.road_network import RoadNetwork

LENGTH_M, WIDTH_M = 5.0, 2.0
HEADING_RAD = 2.4


def placed(network: RoadNetwork, along_m: float, left_m: float, turn_rad: float) -> OnLine:
    """One vehicle relative to a line from (10, −20) in a direction of the second quadrant."""
    cos, sin = np.cos(HEADING_RAD), np.sin(HEADING_RAD)
    start = np.array([10.0, -20.0])
    axis = Polyline.through([start, start + 100.0 * np.array([cos, sin])])
    x, y = start + along_m * np.array([cos, sin]) + left_m * np.array([-sin, cos])
    track = record_with({1: moving(x, y, 3.0, yaw_rad=HEADING_RAD + turn_rad, steps=1)}, network).track(1)
    return on_line(axis, track, LENGTH_M, WIDTH_M)


@pytest.mark.parametrize("left_m", [3.0, -2.0])
@pytest.mark.parametrize("turn_rad", [0.0, np.pi / 6.0, -np.pi / 6.0, np.pi / 2.0, 2.5])
def test_place_and_extent_of_a_turned_body(straight_road: RoadNetwork, left_m: float, turn_rad: float) -> None:
    found = placed(straight_road, 30.0, left_m, turn_rad)
    cos, sin = abs(np.cos(turn_rad)), abs(np.sin(turn_rad))
    assert found.arc_m == pytest.approx([30.0])
    assert found.left_m == pytest.approx([left_m])
    assert found.turn_rad == pytest.approx([turn_rad])
    assert found.half_along_m == pytest.approx([(5.0 * cos + 2.0 * sin) / 2.0])
    assert found.half_across_m == pytest.approx([(5.0 * sin + 2.0 * cos) / 2.0])


@pytest.mark.parametrize(("turn_deg", "same"), [(0, True), (59, True), (-59, True), (61, False), (-61, False)])
def test_sixty_degrees_off_the_line_is_another_way(straight_road: RoadNetwork, turn_deg: int, *, same: bool) -> None:
    assert placed(straight_road, 30.0, 0.0, np.radians(turn_deg)).same_way.tolist() == [same]
    assert placed(straight_road, 30.0, 0.0, np.radians(turn_deg + 360)).same_way.tolist() == [same]


def line_of(record: EpisodeRecord) -> EmvLine:
    found = EmvLine.of(record)
    assert found is not None
    return found


def test_the_driven_line_ends_where_the_record_ends_and_goes_on_along_the_lane() -> None:
    record = record_of(arc((10.0, 4.0), (6.0, 0.1)), {})
    found = line_of(record)
    assert found.driven_m == pytest.approx(40.6)
    assert found.emv.arc_m == pytest.approx(np.append(np.arange(81) * 0.5, [40.3, 40.6]))
    assert (found.length_m, found.width_m) == (6.0, 2.1)
    # 41.6 to 99.6 m along the lane, then from 100 m across the junction.
    assert found.line.length_m > 40.6 + 45.0
    assert found.line.points[:, 0] == pytest.approx(np.full(len(found.line.points), 5.25))
    assert np.diff(found.line.arc_m).max() <= 1.0 + 1e-9, "a point for each metre"


def test_less_than_five_metres_are_no_line() -> None:
    assert EmvLine.of(record_of(arc((1.0, 4.9)), {})) is None
    assert line_of(record_of(arc((1.0, 5.1)), {})).driven_m == pytest.approx(5.1)


def test_what_the_pose_does_at_standstill_is_no_line(straight_road: RoadNetwork) -> None:
    """An EMV that stands, trembles by 5 mm and goes on does not turn its line round."""
    before = moving(20.0, -5.25, 10.0, steps=61).states
    still = np.tile(before[-1], (40, 1))
    still[:, 0] += 0.005 * (-1.0) ** np.arange(40)
    after = moving(50.5, -5.25, 10.0, steps=40).states
    record = record_with({1: Track(np.concatenate((before, still, after)), is_emv=True)}, straight_road)
    found = line_of(record)
    assert np.diff(found.line.points[:, 0]).min() > 0.0
    assert found.driven_m == pytest.approx(50.0)


def test_an_episode_needs_an_emv(straight_road: RoadNetwork) -> None:
    with pytest.raises(InputError, match="EMV"):
        EmvLine.of(record_with({1: moving(0.0, 0.0, 10.0)}, straight_road))
    with_emv = record_of(arc((10.0, 2.0)), {})
    unknown = replace(with_emv, description=replace(with_emv.description, emv_ids=(EMV + 7,)))
    with pytest.raises(InputError, match="EMV"):
        EmvLine.of(unknown)


def test_others_are_placed_while_the_emv_is_there() -> None:
    """The EMV is there at steps 0 to 100; the car comes at step 90."""
    way = line((1.75, -120.0), (1.75, 110.0))
    record = record_of(arc((10.0, 5.0)), {CAR: Driven(way, arc((2.0, 2.0), start_m=30.0), first_step=90)})
    found = line_of(record)
    car = found.place(record, CAR)
    assert car.track.step.tolist() == list(range(90, 101))
    assert car.left_m == pytest.approx(np.full(11, 3.5))
    assert car.arc_m == pytest.approx(30.0 + 0.1 * np.arange(11))
    assert car.half_along_m == pytest.approx(np.full(11, 2.0))
    assert car.half_across_m == pytest.approx(np.full(11, 0.9))
    emv = found.emv_at(car)
    assert emv.track.step.tolist() == list(range(90, 101))
    assert emv.arc_m == pytest.approx(45.0 + 0.5 * np.arange(11))
    chosen = car.select(car.track.step < 92)
    assert [len(chosen.track), len(chosen.arc_m), len(chosen.half_across_m)] == [2, 2, 2]
