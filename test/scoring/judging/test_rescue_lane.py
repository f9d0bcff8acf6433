"""The predicate of S8, on records made by hand: two rows of cars, and an EMV that drives between them."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import CAR_LENGTH_M, EMV, EMV_LENGTH_M
from made_jam import AT_SIDE_M, CAR_WIDTH_M, EMV_WIDTH_M, LENGTH_M, TURN_RAD, WIDTH_M, at, jam, motorway

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.scoring.judging.rescue_lane import (
    BODY_M,
    ON_SHOULDER_M,
    Bodies,
    RoadView,
    bodies_at,
    free_width_m,
    rescue_lane,
)

THRESHOLDS = {"open_share_min": 0.95, "ahead_m": 90.0, "side_m": 0.2, "through_min_m": 100.0, "speed_min_mps": 5.0}
NEEDED_M = EMV_WIDTH_M + 0.4


def test_an_open_lane_that_the_emv_drives_through_holds():
    verdict = rescue_lane(jam(), THRESHOLDS)
    assert verdict.holds
    measures = verdict.measures()
    assert measures["open_share"] == 1.0
    assert measures["speed_mps"] == pytest.approx(8.0, abs=0.01)
    # The jam is 156 m between the first and the last car; 15 m, half a car and half a second on both sides count too.
    assert measures["through_m"] == pytest.approx(152.0 + 30.0 + CAR_LENGTH_M, abs=4.0)
    free_m = WIDTH_M + 2.0 * AT_SIDE_M - CAR_WIDTH_M
    assert f"narrowest {free_m:.2f} m" in verdict.parts[0].detail
    through, out = verdict.parts[1].decisive.step, verdict.parts[2].decisive.step
    assert (out - through) * 0.05 == pytest.approx((measures["through_m"] - 100.0) / 8.0, abs=0.5)


@pytest.mark.parametrize(("offset_m", "is_open"), [(0.5 * (NEEDED_M - WIDTH_M + CAR_WIDTH_M), True)])
def test_the_free_width_is_compared_with_the_emvs_and_the_margins(offset_m, is_open):
    assert rescue_lane(jam(offset_m + 0.01, -offset_m), THRESHOLDS).measures()["open_share"] == float(is_open)
    assert rescue_lane(jam(offset_m - 0.01, -offset_m), THRESHOLDS).measures()["open_share"] < 0.3


def test_cars_in_the_middle_of_their_lanes_leave_no_lane_open():
    verdict = rescue_lane(jam(0.0, 0.0), THRESHOLDS)
    assert [part.name for part in verdict.failing] == ["open_share"]


def test_what_counts_is_the_width_before_the_emv_comes():
    """Cars that make way for the siren, 40 m before the EMV is there, are too late."""
    record = jam(0.0, 0.0)
    emv = record.track(EMV)
    along_m, _ = Polyline.through([at(0.0, 0.0), at(LENGTH_M, 0.0)]).project(emv.xy_m)

    def moved(state):
        x_m, y_m = state.x_m.copy(), state.y_m.copy()
        for row, (x, y) in enumerate(zip(x_m, y_m, strict=True)):
            place_m, left_m = x * np.cos(TURN_RAD) + y * np.sin(TURN_RAD), y * np.cos(TURN_RAD) - x * np.sin(TURN_RAD)
            if state.actor_id[row] != EMV and place_m - along_m[state.step] < 40.0:
                x_m[row], y_m[row] = at(place_m, left_m + (AT_SIDE_M if left_m > -1.0 else -AT_SIDE_M))
        return replace(state, x_m=x_m, y_m=y_m)

    late = replace(record, states=tuple(map(moved, record.states)))
    assert [part.name for part in rescue_lane(late, THRESHOLDS).failing] == ["open_share"]
    assert rescue_lane(late, {**THRESHOLDS, "ahead_m": 20.0}).holds


@pytest.mark.parametrize(("beyond_m", "counted"), [(ON_SHOULDER_M - 0.02, 0), (ON_SHOULDER_M + 0.02, 1)])
def test_nobody_stands_on_the_hard_shoulder(beyond_m, counted):
    edge_m = -1.5 * WIDTH_M
    verdict = rescue_lane(jam(more=[(350.0, edge_m - beyond_m + 0.5 * CAR_WIDTH_M)]), THRESHOLDS)
    assert verdict.measures()["on_shoulder"] == counted
    assert verdict.holds == (counted == 0)
    assert [moment.step for moment in verdict.parts[3].moments] == [0] * counted


def test_a_short_way_and_a_slow_one_do_not_hold():
    assert [part.name for part in rescue_lane(jam(), {**THRESHOLDS, "through_min_m": 300.0}).failing] == ["through_m"]
    assert [part.name for part in rescue_lane(jam(speed_mps=4.0), THRESHOLDS).failing] == ["speed_mps"]


def test_every_emv_has_to_get_through():
    record = jam()
    second = replace(record.actors[2], is_emv=True)
    description = replace(record.description, emv_ids=(EMV, 2))
    both = replace(record, actors={**record.actors, 2: second}, description=description)
    assert rescue_lane(record, THRESHOLDS).holds
    assert "EMV 2 drove 0 m" in rescue_lane(both, THRESHOLDS).text


def test_a_road_without_a_right_neighbour_has_no_rescue_lane():
    record = jam()
    one = replace(record, network=motorway(1))
    assert not rescue_lane(one, THRESHOLDS).holds
    nowhere = replace(record, description=replace(record.description, site={}))
    assert not rescue_lane(nowhere, THRESHOLDS).holds


def test_cars_near_a_place_narrow_it_and_others_do_not():
    line = Polyline.through([(0.0, 0.0), (100.0, 0.0)])
    road = RoadView(line, -0.5 * WIDTH_M, -1.5 * WIDTH_M, ())
    ids, zero = np.array([2, 3], np.uint32), np.zeros(2)
    left = np.array([1.5, -3.0])
    bodies = Bodies(ids, np.array([10.0, 30.0]), np.array([14.0, 34.0]), left - 0.9, left + 0.9, zero)
    before, inside, between, after = free_width_m(
        bodies, np.array([10.0 - BODY_M - 0.1, 12.0, 22.0, 34.0 + BODY_M + 0.1]), road
    )
    assert np.isinf([before, inside, between, after]).all(), "one side alone narrows nothing"
    close = replace(bodies, from_m=np.array([10.0, 16.0]), to_m=np.array([14.0, 20.0]))
    assert free_width_m(close, np.array([15.0]), road)[0] == pytest.approx(0.6 + 2.1)


def test_bodies_are_those_of_civilians_on_this_road():
    record = jam(more=[(350.0, 12.0), (350.0, -40.0)])
    road = RoadView(
        Polyline.through([at(0.0, 0.0), at(LENGTH_M, 0.0)]), -0.5 * WIDTH_M, -1.5 * WIDTH_M, ((0.0, LENGTH_M),)
    )
    bodies = bodies_at(record, road, 0)
    assert bodies.actor_id.tolist() == list(range(2, 42))
    assert bodies.to_m - bodies.from_m == pytest.approx(CAR_LENGTH_M)
    assert bodies.left_m - bodies.right_m == pytest.approx(CAR_WIDTH_M)
    assert EMV_LENGTH_M > CAR_LENGTH_M
