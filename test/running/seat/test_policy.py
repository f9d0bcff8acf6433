"""Observations of kind vector, and how manoeuvres and pedals become a control."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import NORTHBOUND, SOUTHBOUND, Driven, at_speed
from hypothesis import given
from hypothesis import strategies as st
from seen_on_crossing import sight_at

from siren_ros.running.seat.policy import (
    EMV,
    NEIGHBOUR,
    NEIGHBOURS,
    OWN,
    VECTOR_SIZE,
    Aim,
    Manoeuvre,
    aim_of,
    by_manoeuvre,
    by_pedals,
    features_of,
)
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.world.actors import ActorClass, Lights

_SPACING = 1.5 / 60.0
"""A way knows its lines to a metre."""


def named(vector: np.ndarray) -> dict[str, float]:
    """The numbers of the own vehicle and the EMV by name."""
    names = [feature.name for feature in (*OWN, *EMV)]
    return dict(zip(names, vector.tolist(), strict=False))


def neighbours(vector: np.ndarray) -> list[dict[str, float]]:
    names = [feature.name for feature in NEIGHBOUR]
    rows = vector[len(OWN) + len(EMV) :].reshape(NEIGHBOURS, len(NEIGHBOUR)).tolist()
    return [dict(zip(names, row, strict=True)) for row in rows]


def test_the_own_numbers_are_those_of_the_scene() -> None:
    sight = sight_at(own_m=50.0, own_mps=10.0, aside_m=(0.5, 0.5), lights=int(Lights.INDICATOR_RIGHT))
    own = named(features_of(sight))
    assert own["speed"] == pytest.approx(10.0 / 25.0)
    assert own["offset"] == pytest.approx(0.5 / 8.0)
    assert own["heading"] == pytest.approx(0.0, abs=1e-7)
    assert (own["indicator_left"], own["indicator_right"]) == (0.0, 1.0)
    assert (own["lanes_left"], own["lanes_right"]) == (0.25, 0.0)
    assert own["right_edge"] == pytest.approx((0.5 + 1.75 + 2.5) / 10.0)
    assert own["limit"] == pytest.approx(13.9 / 25.0)
    assert own["in_junction"] == 0.0
    assert own["rest"] == pytest.approx((230.0 - 50.5) / 500.0)
    assert own["line"] == pytest.approx((100.0 - 52.5) / 60.0, abs=_SPACING)


@pytest.mark.parametrize(("signal", "near"), [("rrrrrrr", True), ("yyyyyyy", True), ("GGGGGGG", False), ("", False)])
def test_a_red_line_is_seen_before_it(signal: str, near: bool) -> None:
    red = named(features_of(sight_at(signal=signal)))["red"]
    assert red == (pytest.approx((100.0 - 52.5) / 60.0, abs=_SPACING) if near else 1.0)
    assert named(features_of(sight_at(own_m=106.0, signal=signal)))["red"] == 1.0, "it lies behind"


def test_the_emv_is_seen_in_the_own_frame() -> None:
    seen = named(features_of(sight_at(own_m=50.0, emv_m=20.0, emv_mps=12.0, own_mps=12.0, aside_m=(1.0, 1.0))))
    assert seen["emv_here"] == seen["emv_siren"] == seen["emv_behind"] == 1.0
    assert seen["emv_x"] == pytest.approx(-30.0 / 100.0)
    assert seen["emv_y"] == pytest.approx(-1.0 / 20.0)
    assert seen["emv_speed"] == pytest.approx(12.0 / 25.0)
    assert (seen["emv_cos"], seen["emv_sin"]) == pytest.approx((1.0, 0.0), abs=1e-7)
    assert named(features_of(sight_at(own_m=50.0, emv_m=80.0)))["emv_behind"] == 0.0


@pytest.mark.parametrize(
    ("second_m", "lights", "seen_m"), [(40.0, 0, 20.0), (40.0, int(Lights.SIREN), 40.0), (5.0, int(Lights.SIREN), 20.0)]
)
def test_of_two_emvs_the_nearest_that_sounds_its_siren_is_seen(second_m: float, lights: int, seen_m: float) -> None:
    sight = sight_at(50.0, 10.0, 20.0, others={3: Driven(NORTHBOUND, at_speed(second_m, 10.0, 2))}, lights=lights)
    sight = replace(sight, bodies={**sight.bodies, 3: replace(sight.bodies[3], is_emv=True)})
    assert named(features_of(sight))["emv_x"] == pytest.approx((seen_m - 50.0) / 100.0)


def test_neighbours_come_by_their_distance_without_the_emv() -> None:
    others = {3: Driven(NORTHBOUND, at_speed(70.0, 4.0, 2)), 4: Driven(SOUTHBOUND, at_speed(170.0, 10.0, 2))}
    vector = features_of(sight_at(others=others))
    first, second, *rest = neighbours(vector)
    # 4 goes south: it is at y = -60.5 m, 9 m ahead of the own place (y = -69.5 m), and 7 m to the left
    assert (first["x"], first["y"]) == pytest.approx((9.0 / 80.0, 7.0 / 20.0))
    assert first["vx"] == pytest.approx(-20.0 / 25.0)
    assert (first["cos"], first["sin"]) == pytest.approx((-1.0, 0.0), abs=1e-7)
    assert (second["x"], second["y"]) == pytest.approx((19.7 / 80.0, 0.0), abs=1e-7)
    assert second["vx"] == pytest.approx(-6.0 / 25.0)
    assert (second["length"], second["width"]) == pytest.approx((4.0 / 20.0, 1.8 / 4.0))
    assert all(set(row.values()) == {0.0} for row in rest)


@given(st.floats(0.0, 220.0), st.floats(0.0, 60.0), st.floats(0.0, 220.0), st.floats(-30.0, 30.0))
def test_every_number_stays_within_its_bounds(own_m: float, own_mps: float, emv_m: float, aside_m: float) -> None:
    vector = features_of(sight_at(own_m, own_mps, emv_m, aside_m=(aside_m, aside_m)))
    assert vector.shape == (VECTOR_SIZE,)
    assert vector.dtype == np.float32
    assert (np.abs(vector) <= 1.0).all()


VEHICLES = load_vehicle_parameters()
SEDAN = VEHICLES[ActorClass.SEDAN]


def test_a_lane_change_ends_before_the_next_one_begins() -> None:
    aim = aim_of(Aim(), Manoeuvre.LEFT, sight_at())
    assert aim.lane == 1
    assert aim_of(aim, Manoeuvre.LEFT, sight_at(aside_m=(1.0, 1.0))).lane == 1
    assert aim_of(aim, Manoeuvre.RIGHT, sight_at(aside_m=(1.0, 1.0))).lane == 1, "it has not come there"
    assert aim_of(aim, Manoeuvre.RIGHT, sight_at(aside_m=(3.5, 3.5))).lane == 0
    assert aim_of(aim, Manoeuvre.KEEP, sight_at(aside_m=(3.5, 3.5))).lane == 1


def test_there_is_no_lane_beyond_the_last_one_and_none_begins_in_a_junction() -> None:
    assert aim_of(Aim(), Manoeuvre.RIGHT, sight_at()).lane == 0
    assert aim_of(Aim(lane=1), Manoeuvre.LEFT, sight_at(aside_m=(3.5, 3.5))).lane == 1
    assert aim_of(Aim(), Manoeuvre.LEFT, sight_at(own_m=115.0)).lane == 0


def test_who_keeps_the_lane_at_the_limit_does_nothing() -> None:
    control = by_manoeuvre(Aim(), sight_at(own_mps=13.9))
    assert (control.throttle, control.brake) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert control.steer_rad == pytest.approx(0.0, abs=1e-9)
    assert control.lights == Lights.NONE


def test_a_change_to_the_left_steers_and_signals_to_the_left() -> None:
    control = by_manoeuvre(Aim(Manoeuvre.LEFT, 1), sight_at())
    assert control.steer_rad > 0.02
    assert control.lights == Lights.INDICATOR_LEFT
    there = by_manoeuvre(Aim(Manoeuvre.LEFT, 1), sight_at(aside_m=(3.5, 3.5)))
    assert there.steer_rad == pytest.approx(0.0, abs=1e-9)
    assert there.lights == Lights.NONE


def test_who_pulls_over_goes_to_the_right_edge_and_stops_there() -> None:
    aim = aim_of(Aim(), Manoeuvre.PULL_OVER, sight_at())
    begins = by_manoeuvre(aim, sight_at(own_mps=5.0))
    assert begins.steer_rad < -0.02
    assert begins.lights == Lights.INDICATOR_RIGHT
    assert begins.brake == 0.0
    edge_m = -1.75 - 2.5 + 0.9 + 0.15  # lane, shoulder, half the car, what is kept to the edge
    there = by_manoeuvre(aim, sight_at(own_mps=5.0, aside_m=(edge_m, edge_m)))
    assert there.brake > 0.3
    assert there.steer_rad == pytest.approx(0.0, abs=1e-9)


def test_who_pulls_over_in_the_leftmost_of_several_lanes_goes_to_the_left_edge() -> None:
    in_left_lane, edge_m = (3.5, 3.5), 3.5 + 1.75 - 0.9 - 0.15
    aim = aim_of(Aim(), Manoeuvre.PULL_OVER, sight_at(aside_m=in_left_lane))
    assert by_manoeuvre(aim, sight_at(own_mps=5.0, aside_m=in_left_lane)).lights == Lights.INDICATOR_LEFT
    there = by_manoeuvre(aim, sight_at(own_mps=5.0, aside_m=(edge_m, edge_m)))
    assert there.brake > 0.3
    assert there.steer_rad == pytest.approx(0.0, abs=1e-9)
    right = sight_at(aside_m=(0.5, 0.5))
    assert aim_of(aim, Manoeuvre.PULL_OVER, right) == aim, "it goes on to the side that it has chosen"
    assert aim_of(Aim(), Manoeuvre.PULL_OVER, right).lane == 0


def test_who_pulls_over_leaves_a_junction_first() -> None:
    aim = Aim(Manoeuvre.PULL_OVER)
    assert by_manoeuvre(aim, sight_at(own_m=115.0, own_mps=5.0)).brake == 0.0
    assert by_manoeuvre(Aim(Manoeuvre.STOP), sight_at(own_m=115.0, own_mps=5.0)).brake > 0.3


def test_a_stop_keeps_the_place_across_the_road_where_it_began() -> None:
    aim = aim_of(Aim(), Manoeuvre.STOP, sight_at(aside_m=(0.7, 0.7)))
    assert aim.offset_m == pytest.approx(0.7)
    assert aim_of(aim, Manoeuvre.STOP, sight_at(aside_m=(0.5, 0.5))).offset_m == pytest.approx(0.7)
    control = by_manoeuvre(aim, sight_at(aside_m=(0.7, 0.7)))
    assert control.brake == pytest.approx(6.0 / 9.0)
    assert control.steer_rad == pytest.approx(0.0, abs=1e-9)


def test_a_leader_and_a_red_line_make_it_brake() -> None:
    leader = {3: Driven(NORTHBOUND, at_speed(58.0, 2.0, 2))}
    free = by_manoeuvre(Aim(), sight_at())
    assert free.brake == 0.0
    assert by_manoeuvre(Aim(), sight_at(others=leader)).brake > 0.2
    assert by_manoeuvre(Aim(), sight_at(own_m=75.0, signal="rrrrrrr")).brake > 0.05
    assert by_manoeuvre(Aim(), sight_at(own_m=75.0, signal="GGGGGGG")).brake == 0.0


@pytest.mark.parametrize(
    ("action", "throttle", "brake"),
    [(1.0, 3.0 / 4.5, 0.0), (0.5, 1.5 / 4.5, 0.0), (-1.0, 0.0, 8.0 / 9.0), (0.0, 0.0, 0.0)],
)
def test_pedals_are_for_the_acceleration_that_is_asked_for(action: float, throttle: float, brake: float) -> None:
    control = by_pedals(np.array([action, 0.0, 0.0], np.float32), sight_at(), VEHICLES)
    assert (control.throttle, control.brake) == pytest.approx((throttle, brake))
    assert control.steer_rad == 0.0


def test_a_full_wheel_gives_4_mps2_across_and_no_more_than_half_a_radian() -> None:
    left = np.array([0.0, 1.0, 0.0], np.float32)
    for speed in (10.0, 13.0):
        angle = by_pedals(left, sight_at(own_mps=speed), VEHICLES).steer_rad
        assert speed**2 * math.tan(angle) / SEDAN.wheelbase_m == pytest.approx(4.0, rel=1e-6)
    assert by_pedals(left, sight_at(own_mps=1.0), VEHICLES).steer_rad == 0.5


@pytest.mark.parametrize(
    ("indicator", "light"), [(0.4, Lights.INDICATOR_LEFT), (-0.4, Lights.INDICATOR_RIGHT), (0.3, 0)]
)
def test_the_indicator_is_on_beyond_a_third(indicator: float, light: int) -> None:
    assert by_pedals(np.array([0.0, 0.0, indicator], np.float32), sight_at(), VEHICLES).lights == light


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.floats(0.0, 30.0))
def test_whatever_is_asked_for_the_vehicle_can_be_asked_for(action: list[float], speed_mps: float) -> None:
    by_pedals(np.array(action, np.float32), sight_at(own_mps=speed_mps), VEHICLES).check()


def test_it_waits_with_a_move_to_the_side_until_there_is_a_gap() -> None:
    beside = {3: Driven(NORTHBOUND + np.array([-3.5, 0.0]), at_speed(50.0, 10.0, 2))}
    control = by_manoeuvre(Aim(Manoeuvre.LEFT, 1), sight_at(others=beside))
    assert control.steer_rad == pytest.approx(0.0, abs=1e-9)
    assert control.lights == Lights.INDICATOR_LEFT
    behind = {3: Driven(NORTHBOUND + np.array([-3.5, 0.0]), at_speed(30.0, 10.0, 2))}
    assert by_manoeuvre(Aim(Manoeuvre.LEFT, 1), sight_at(others=behind)).steer_rad > 0.02
