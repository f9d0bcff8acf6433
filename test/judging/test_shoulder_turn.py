from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import (
    EMV,
    IN_TURN_LANE,
    NORTHBOUND,
    ON_SHOULDER,
    RIGHT_X_M,
    SHOULDER_TURN,
    SHOULDER_X_M,
    Driven,
    at_speed,
    crossing,
    hand_made,
    line,
)

from siren_ros.judging.shoulder_turn import _stretches, on_shoulder_area, shoulder_turn, turned_right_rad
from siren_ros.judging.verdict import Verdict

NETWORK = crossing()
THRESHOLDS = {"shoulder_min_s": 2.0}


def _verdict(points: np.ndarray, speed_mps: float = 8.0, start_m: float = 40.0) -> Verdict:
    arc_m = at_speed(start_m, speed_mps, round(150.0 / speed_mps / 0.05))
    return shoulder_turn(hand_made(NETWORK, {EMV: Driven(points, arc_m)}), THRESHOLDS)


def test_a_right_turn_on_the_shoulder_holds_with_its_times() -> None:
    verdict = _verdict(ON_SHOULDER)
    turned, shoulder = verdict.parts
    assert verdict.holds
    assert turned.value == pytest.approx(90.0)
    assert turned.detail.startswith("EMV 1 at junction J from ")
    # 50 m before the line, the quarter circle, 50 m after it, at 8 m/s; the EMV's length is part of the traversal
    assert shoulder.value == pytest.approx((100.0 + 6.0 + 11.75 * np.pi / 2.0) / 8.0, abs=0.1)
    assert " s to " in shoulder.detail


def test_a_right_turn_in_the_driving_lane_fails_on_the_shoulder_alone() -> None:
    verdict = _verdict(IN_TURN_LANE)
    assert [part.name for part in verdict.failing] == ["shoulder_s"]
    assert verdict.failing[0].value == 0.0


def test_straight_ahead_is_no_right_turn() -> None:
    verdict = _verdict(NORTHBOUND)
    assert [part.name for part in verdict.failing] == ["right_turn_deg", "shoulder_s"]
    assert "nowhere" in verdict.failing[0].detail


def test_a_short_stay_on_the_shoulder_is_not_enough() -> None:
    """Onto the shoulder 4 m before the line, across on its path, and off it at once."""
    short = np.concatenate(
        (
            line((RIGHT_X_M, -120.0), (RIGHT_X_M, -28.0), (SHOULDER_X_M, -23.0)),
            SHOULDER_TURN,
            line((24, -5.25), (120, -5.25)),
        )
    )
    verdict = _verdict(short, speed_mps=14.0)
    assert [part.name for part in verdict.failing] == ["shoulder_s"]
    assert 1.2 < verdict.failing[0].value < 2.0
    assert _verdict(short, speed_mps=8.0).holds


def test_the_shoulder_long_before_the_turn_does_not_count() -> None:
    early = np.concatenate((line((SHOULDER_X_M, -120.0), (SHOULDER_X_M, -80.0), (RIGHT_X_M, -74.0)), IN_TURN_LANE[1:]))
    verdict = _verdict(early, start_m=2.0, speed_mps=8.0)
    assert verdict.parts[0].holds
    assert verdict.parts[1].value == 0.0


def test_the_wrong_way_along_a_shoulder_is_not_on_it() -> None:
    record = hand_made(NETWORK, {EMV: Driven(ON_SHOULDER[::-1], at_speed(2.0, 8.0, 300))})
    assert shoulder_turn(record, THRESHOLDS).parts[1].value == 0.0


def test_the_turn_is_measured_alone_and_not_summed_with_a_bend_to_the_left() -> None:
    left, right = np.linspace(0.0, 0.9, 20), np.linspace(0.9, -0.45, 30)
    assert turned_right_rad(np.concatenate((left, right))) == pytest.approx(1.35)
    assert turned_right_rad(np.concatenate((left, right, right[::-1]))) == pytest.approx(1.35)
    assert turned_right_rad(np.linspace(-3.0, -3.6, 10)) == pytest.approx(0.6), "across π"
    assert turned_right_rad(left) == 0.0


@pytest.mark.parametrize(
    ("x_m", "y_m", "degrees", "on"),
    [
        (SHOULDER_X_M, -60.0, 90.0, True),
        (SHOULDER_X_M, -60.0, 1.0, True),
        (SHOULDER_X_M, -60.0, 179.0, True),
        (SHOULDER_X_M, -60.0, -1.0, False),
        (SHOULDER_X_M, -60.0, 181.0, False),
        (SHOULDER_X_M + 1.2, -60.0, 90.0, True),
        (SHOULDER_X_M + 1.3, -60.0, 90.0, False),
        (SHOULDER_X_M - 1.3, -60.0, 90.0, False),
        (SHOULDER_X_M, -121.0, 90.0, False),
        (RIGHT_X_M, -60.0, 90.0, False),
        (60.0, -8.25, 0.0, True),
        (60.0, -5.25, 0.0, False),
        (SHOULDER_TURN[9][0], SHOULDER_TURN[9][1], 45.0, True),
    ],
)
def test_on_a_shoulder_is_within_its_width_its_length_and_90_degrees(
    x_m: float, y_m: float, degrees: float, on: bool
) -> None:
    rows = hand_made(NETWORK, {EMV: Driven(NORTHBOUND, at_speed(0.0, 1.0, 2))}).track(EMV)
    placed = replace(rows, x_m=np.full(2, x_m), y_m=np.full(2, y_m), yaw_rad=np.full(2, np.radians(degrees)))
    assert on_shoulder_area(NETWORK, placed).tolist() == [on, on]


def test_a_record_that_ends_inside_the_turn_is_judged_as_far_as_it_goes() -> None:
    """Five steps after half of the quarter circle on the shoulder."""
    steps = round((60.0 + 11.75 * np.pi / 4.0) / 8.0 / 0.05)
    verdict = shoulder_turn(hand_made(NETWORK, {EMV: Driven(ON_SHOULDER, at_speed(40.0, 8.0, steps))}), THRESHOLDS)
    turned, shoulder = verdict.parts
    assert turned.value == pytest.approx(45.0, abs=3.0)
    assert shoulder.value == pytest.approx((50.0 + 3.0 + 11.75 * np.pi / 4.0) / 8.0, abs=0.5)


def test_others_that_turn_right_on_the_shoulder_do_not_count() -> None:
    vehicles = {
        EMV: Driven(NORTHBOUND, at_speed(40.0, 8.0, 200)),
        2: Driven(ON_SHOULDER, at_speed(40.0, 8.0, 300)),
    }
    assert "nowhere" in shoulder_turn(hand_made(NETWORK, vehicles), THRESHOLDS).parts[0].detail


def test_the_intervals_on_the_shoulder_are_told() -> None:
    """On it, off it, and on it again."""
    twice = np.concatenate(
        (
            line((SHOULDER_X_M, -120.0), (SHOULDER_X_M, -45.0), (RIGHT_X_M, -42.0), (RIGHT_X_M, -35.0)),
            line((SHOULDER_X_M, -32.0)),
            SHOULDER_TURN,
            line((120.0, -8.25)),
        )
    )
    detail = _verdict(twice).parts[1].detail
    assert detail.count(" s to ") == 2
    first, second = (tuple(float(part.split()[0]) for part in text.split(" to ")) for text in detail.split(", "))
    assert first[0] < first[1] < second[0] < second[1]
    assert (first[1] - first[0]) + (second[1] - second[0]) == pytest.approx(_verdict(twice).parts[1].value, abs=0.15)


def test_an_interval_ends_with_the_step_after_its_last_one() -> None:
    rows = hand_made(NETWORK, {EMV: Driven(ON_SHOULDER, at_speed(0.0, 8.0, 40))}).track(EMV)
    holds = np.zeros(40, dtype=np.bool_)
    holds[4:8] = holds[20:22] = True
    assert _stretches(rows, holds) == "0.2 s to 0.4 s, 1.0 s to 1.1 s"
