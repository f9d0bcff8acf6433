"""Contacts, overlap and accelerations of records made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import CAR_LENGTH_M, EMV, EMV_LENGTH_M, NORTHBOUND, Driven, crossing, hand_made

from siren_ros.scoring.judging.physics import (
    PhysicsSummary,
    VerifyLimits,
    check_physics,
    deepest_overlap,
    summarise_physics,
)
from siren_ros.simulation.world.actors import Mode
from siren_ros.simulation.world.traffic_state import Event, EventKind


def record_of(count=2, cars=(2,)):
    return hand_made(
        crossing(), {key: Driven(NORTHBOUND, np.full(count, 20.0 * place)) for place, key in enumerate((EMV, *cars))}
    )


def placed(record, *poses):
    x, y, yaw = np.array(poses, dtype=float).T
    return replace(record.states[0], x_m=x, y_m=y, yaw_rad=yaw)


@pytest.mark.parametrize("turn", np.radians([0.0, 35.0, -110.0]))
@pytest.mark.parametrize(
    ("ahead", "left", "yaw", "overlap"),
    [
        (4.8, 0.0, 0.0, 0.5 * (EMV_LENGTH_M + CAR_LENGTH_M) - 4.8),
        (5.1, 0.0, 0.0, 0.0),
        (0.0, 1.85, 0.0, 0.5 * (2.1 + 1.8) - 1.85),
        (0.0, -1.85, 0.0, 0.5 * (2.1 + 1.8) - 1.85),
        (0.0, 2.0, 0.0, 0.0),
        (3.5, 0.0, np.pi / 2.0, 0.5 * (EMV_LENGTH_M + 1.8) - 3.5),
        (5.0, 2.5, 0.0, 0.0),
    ],
)
def test_overlap_is_the_depth_along_the_nearest_axis_whichever_way_they_point(ahead, left, yaw, overlap, turn):
    cos, sin = np.cos(turn), np.sin(turn)
    other = (5.0 + cos * ahead - sin * left, -3.0 + sin * ahead + cos * left, turn + yaw)
    record = record_of()
    assert deepest_overlap(placed(record, (5.0, -3.0, turn), other), record)[0] == pytest.approx(overlap, abs=1e-9)
    assert deepest_overlap(placed(record, other, (5.0, -3.0, turn)), record_of())[0] >= 0.0


def test_the_deepest_of_several_overlaps_counts():
    record = record_of(cars=(2, 3))
    state = placed(record, (0.0, 0.0, 0.0), (4.9, 0.0, 0.0), (-4.6, 0.0, 0.0))
    depth_m, moment = deepest_overlap(state, record)
    assert depth_m == pytest.approx(0.4)
    assert moment is not None
    assert moment.step == state.step
    assert deepest_overlap(placed(record_of(cars=()), (0.0, 0.0, 0.0)), record_of(cars=())) == (0.0, None)


def accelerated(accel_mps2, lateral_mps2):
    """The EMV's accelerations over the steps; the other car has a hundred times as much along its way."""
    record = record_of(count=len(accel_mps2))
    states = tuple(
        replace(state, accel_mps2=np.array([accel, 100.0 * accel]), lateral_accel_mps2=np.array([lateral, 0.0]))
        for state, accel, lateral in zip(record.states, accel_mps2, lateral_mps2, strict=True)
    )
    return replace(record, states=states)


def test_the_accelerations_of_every_emv_from_the_1st_to_the_99th_percentile():
    accel = np.linspace(-4.0, 6.0, 101)
    record = accelerated(accel, np.zeros(101))
    both = replace(record, description=replace(record.description, emv_ids=(EMV, 2)))
    for changed, expected in ((record, (-3.9, 5.9)), (both, np.percentile(accel[:, None] * [1, 100], [1, 99]))):
        summary = summarise_physics(changed)
        assert (summary.emv_accel_low_mps2, summary.emv_accel_high_mps2) == pytest.approx(expected)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_lateral_acceleration_to_both_sides_at_the_99_9th_percentile(side):
    lateral = np.zeros(501)
    lateral[:2] = side * np.array([5.0, 4.0])
    expected = np.percentile([5.0, 4.0, *[0.0] * 1000], 99.9)
    assert summarise_physics(accelerated(np.zeros(501), lateral)).lateral_accel_mps2 == pytest.approx(expected)


def civilians(accel_mps2, lateral_mps2=0.0, speed_mps=5.0, mode=Mode.NOMINAL):
    """A civilian's accelerations over the steps, at a speed and in a mode; those of the EMV beside it are extreme."""
    record = record_of(count=len(accel_mps2))
    lateral_mps2 = np.broadcast_to(lateral_mps2, len(accel_mps2))
    states = tuple(
        replace(
            state,
            accel_mps2=np.array([50.0, accel]),
            lateral_accel_mps2=np.array([50.0, lateral]),
            vx_mps=np.array([speed_mps, speed_mps]),
            vy_mps=np.zeros(2),
            mode=np.array([Mode.NOMINAL, mode], dtype=np.uint8),
        )
        for state, accel, lateral in zip(record.states, accel_mps2, lateral_mps2, strict=True)
    )
    return replace(record, states=states)


def failing(record):
    return [part.name for part in check_physics(record, VerifyLimits()) if not part.holds and "civilian" in part.name]


def test_civilians_brake_and_accelerate_as_people_do_but_for_half_a_percent_of_the_time():
    for share, low, high in ((0.004, [], []), (0.006, ["civilian_accel_p0_5_mps2"], ["civilian_accel_p99_5_mps2"])):
        hard = round(share * 5000)
        for accel, names in ((-9.0, low), (3.4, high)):
            assert failing(civilians([accel] * hard + [0.0] * (5000 - hard))) == names
    assert failing(civilians([-3.9] * 30 + [2.9] * 30)) == []


def test_no_civilian_steers_as_on_a_race_track():
    for side in (1.0, -1.0):
        assert failing(civilians([0.0] * 4000, [side * 6.0] + [0.0] * 3999)) == ["civilian_lateral_mps2"]
        assert failing(civilians([0.0] * 40, side * 4.9)) == []


def test_who_stands_and_who_had_a_contact_does_not_count():
    assert failing(civilians([-9.0] * 10, 9.0, speed_mps=0.2)) == []
    assert failing(civilians([-9.0] * 10, 9.0, mode=Mode.STOPPED)) == []
    assert len(failing(civilians([-9.0] * 10, 9.0))) == 2


def test_the_summary_holds_the_numbers_and_zeros_where_there_is_nothing():
    record = accelerated(np.linspace(-1.0, 1.0, 101), np.full(101, -2.0))
    contacts = tuple(
        Event(step, EventKind.COLLISION, 1, 2, detail={"impact_speed_mps": speed})
        for step, speed in ((3, 1.5), (9, 0.5))
    )
    summary = summarise_physics(replace(record, events=contacts))
    assert (summary.contacts, summary.impact_mps, summary.overlap_m) == (2, 1.5, 0.0)
    assert (summary.emv_accel_low_mps2, summary.emv_accel_high_mps2) == pytest.approx((-0.98, 0.98))
    assert summary.lateral_accel_mps2 == pytest.approx(2.0)
    assert summarise_physics(replace(record, states=())) == PhysicsSummary()
