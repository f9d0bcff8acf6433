"""What a driver is told where there are several EMVs, lines, moves or others: the worst, whatever their order."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, NORTHBOUND, RIGHT_X_M, Driven, crossing, hand_made, line, with_states
from made_encounters import CAR, IN_LANE, arc

from siren_ros.reports.exam.examinee import Examinee, compared_with_paper
from siren_ros.reports.exam.monitors import MONITORS
from siren_ros.simulation.world.actors import Event, EventKind, Lights

SECOND, THIRD = 3, 4
COMES = Driven(NORTHBOUND, arc((10.0, 20.0)))
FAR = Driven(NORTHBOUND - np.array([40.0, 0.0]), arc((10.0, 20.0)))
AT_EDGE = line((8.25, -120.0), (8.25, 110.0))
TO_THE_EDGE = line((5.25, -120.0), (5.25, -80.0), (8.25, -60.0), (8.25, 110.0))
GOES_BACK = line((5.25, -120.0), (5.25, -80.0), (7.25, -60.0), (7.25, -50.0), (5.25, -40.0), (5.25, 110.0))
RETURNS = Driven(GOES_BACK, arc((5.0, 6.0), (0.0, 4.0), (5.0, 10.0), start_m=36.0))
"""The EMV passes it at 7.1 s; it is in its lane again at 12.25 s, 77.2 m on its way."""
RETURN = {"offset_m": 0.6, "waits_s": 5.0, "near_m": 0.0}
STAND = {"gap_m": 15.0, "stop_s": 4.0}
RESPOND = {"shift_m": 0.3, "slower_mps": 1.5, "aside_m": 3.0}
FOLLOW = {"gap_m": 20.0, "aside_m": 6.0, "faster_mps": 3.0}
INDICATE = {"least_m": 1.0, "least_mps": 0.2, "before_s": 5.0, "late_s": 0.5}
FOLLOWS = arc((2.0, 7.0), (10.0, 10.0), start_m=36.0)


def aside(points, to_left_m):
    return points - np.array([to_left_m, 0.0])


def driver_among(emvs, car, others=None, signal=lambda _: "", events=()):
    """A driver before EMVs with their sirens on, which the record names in the order given."""
    record = hand_made(crossing(), {EMV: COMES, **emvs, CAR: car, **(others or {})}, signal)
    alike = {one: replace(record.actors[EMV], actor_id=one) for one in emvs}
    described = replace(record.description, emv_ids=tuple(emvs))

    def sirens(state):
        return np.where(np.isin(state.actor_id, [*emvs]), int(Lights.SIREN), 0).astype(state.lights.dtype)

    record = replace(record, actors={**record.actors, **alike}, description=described, events=tuple(events))
    return Examinee(with_states(record, lights=sirens), CAR, 40.0, 3.0)


def found(monitor, driver, numbers):
    return MONITORS[monitor].find(driver, numbers)


def starts(start_m, *pieces):
    return Driven(NORTHBOUND, arc(*(pieces or ((10.0, 20.0),)), start_m=start_m))


CASES = {
    # The first stands 5 m behind the driver for 6 s, the second 35 m behind it.
    "obstruction": (
        {"gap_m": 10.0, "slow_mps": 2.0, "left_line_m": 0.5},
        (starts(0.0, (10.0, 4.0), (0.0, 6.0)), starts(0.0, (10.0, 1.0), (0.0, 9.0))),
        Driven(IN_LANE, arc((0.0, 10.0), start_m=50.0)),
        6.0,
    ),
    # The first stands there from the record's first step on.
    "obstruction from the first step on": (
        {"gap_m": 10.0, "slow_mps": 2.0, "left_line_m": 0.5},
        (starts(40.0, (0.0, 10.0)), starts(0.0, (10.0, 1.0), (0.0, 9.0))),
        Driven(IN_LANE, arc((0.0, 10.0), start_m=50.0)),
        10.0,
    ),
    # It follows from 7 s, when it gets faster, until it enters the junction at 12 s; the second passed 7 m aside.
    "following": (FOLLOW, (COMES, Driven(aside(NORTHBOUND, 7.0), arc((10.0, 20.0)))), Driven(IN_LANE, FOLLOWS), 5.0),
    # It comes back within 0.5 m at 5.1 s, and stands in the way until 16 s; the second drives 7 m aside.
    "back_in_the_way": (
        {"margin_m": 0.1, "moved_m": 0.5},
        (starts(0.0, (4.0, 4.0), (3.0, 12.0)), Driven(aside(NORTHBOUND, 7.0), arc((4.0, 4.0), (3.0, 12.0)))),
        Driven(
            line((5.25, -120.0), (8.25, -110.0), (8.25, -80.0), (5.25, -70.0), (5.25, 110.0)),
            arc((5.0, 8.0), (0.0, 8.0), start_m=20.0),
        ),
        16.0 - 5.1,
    ),
    # The second passes a second later, so that the driver needs one less; or stands far behind, and asks for nothing.
    "return_to_lane": (RETURN, (COMES, starts(-10.0)), RETURNS, 12.25 - 8.1),
    "return_to_lane past one that stands": (
        RETURN,
        (COMES, starts(0.0, (10.0, 1.0), (0.0, 19.0))),
        RETURNS,
        12.25 - 7.1,
    ),
    # The second is heard from behind until the driver is 40 m ahead of it.
    "return_to_lane once none calls": (RETURN, (COMES, starts(0.0, (10.0, 4.0), (0.0, 16.0))), RETURNS, 6.7),
    # Both come up to within 15 m, one stays behind; duties begin after 3 s to respond and 4 s to stop.
    "stands_until_passed": (
        {"gap_m": 15.0, "stop_s": 1.0},
        (starts(18.0, (5.0, 14.0)), starts(0.0, (5.0, 14.0))),
        Driven(AT_EDGE, arc((5.0, 6.0), (0.0, 8.0), start_m=36.0)),
        5.0,
    ),
    # Slower after 3 s; that another one calls as well, from 4.5 s on, asks for nothing more.
    "response": (RESPOND, (COMES, starts(-35.0)), Driven(IN_LANE, arc((5.0, 3.0), (2.0, 6.0), start_m=36.0)), 3.0),
    # The second calls from 11 s on, and the driver is slower at 12 s.
    "response to the slower answer": (
        RESPOND,
        (COMES, starts(-78.0)),
        Driven(IN_LANE, arc((5.0, 3.0), (2.0, 5.0), (5.0, 4.0), (2.0, 6.0), start_m=36.0)),
        3.0,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_of_two_emvs_the_worse_one_counts(case):
    numbers, pair, car, expected = CASES[case]
    for ids in ((EMV, SECOND), (SECOND, EMV)):
        emvs = dict(zip(ids, pair, strict=True))
        for order in (emvs, dict(reversed(emvs.items()))):
            driver = driver_among(order, car)
            assert len(driver.calls) == 2
            assert found(case.split()[0], driver, numbers).measure.value == pytest.approx(expected, abs=0.16)


@pytest.mark.parametrize("lasts_s", [20.0, 9.0])
def test_an_emv_that_has_passed_and_left_the_map_has_passed(lasts_s):
    """It passes at 7.1 s; the driver goes on before the second one has passed, at 15.2 s, or returns at 12.25 s."""
    first = Driven(NORTHBOUND, arc((10.0, lasts_s)))
    goes_on = found("moves_off", driver_among({EMV: first, SECOND: starts(-60.0)}, RETURNS), {})
    assert goes_on.measure.value == pytest.approx(5.0 * (15.2 - 10.0), abs=1.0)
    assert found("return_to_lane", driver_among({EMV: first}, RETURNS), RETURN).measure.value == pytest.approx(
        5.15, abs=0.16
    )


@pytest.mark.parametrize(("stop_s", "speed_mps"), [(1.0, 5.0), (4.0, 0.0)])
def test_a_driver_has_the_time_to_respond_and_to_stop(stop_s, speed_mps):
    stops = Driven(AT_EDGE, arc((5.0, 6.0), (0.0, 8.0), start_m=36.0))
    driver = driver_among({EMV: COMES}, stops)
    assert found("stands_until_passed", driver, {"gap_m": 15.0, "stop_s": stop_s}).measure.value == speed_mps


@pytest.mark.parametrize(("drives_s", "speed_mps"), [(5.8, 0.0), (7.0, 5.0)])
def test_a_driver_clears_a_junction_before_it_stops(drives_s, speed_mps):
    leaves = Driven(IN_LANE, arc((5.0, drives_s), (0.0, 14.0 - drives_s), start_m=110.0))  # at 4 s
    driver = driver_among({EMV: starts(94.0, (5.0, 6.0), (0.5, 8.0))}, leaves)
    assert found("stands_until_passed", driver, {"gap_m": 15.0, "stop_s": 2.0}).measure.value == speed_mps


def test_every_move_without_an_indicator_counts_and_the_first_one_is_named():
    for record in ((driver := driver_among({EMV: COMES}, RETURNS)).record, driver.record.mirrored()):
        missed = found("indicator", Examinee(record, CAR, 40.0, 3.0), INDICATE)
        assert missed.measure.value == 2.0
        assert missed.step == pytest.approx(0.8 / 0.05, abs=2)  # 4 m on its way, with 5 m/s
    within = line((RIGHT_X_M, -120.0), (RIGHT_X_M, -18.0), (1.75, 8.0), (1.75, 110.0))
    across = driver_among({EMV: COMES}, Driven(within, arc((5.0, 15.0), start_m=60.0)))
    assert not found("indicator", across, INDICATE).measure.valid


def crossed(step, actor_id=CAR, **detail):
    detail = {"junction": "J", "direction": "s", **detail}
    return Event(step, EventKind.STOP_LINE_CROSSED, actor_id, detail=detail)


@pytest.mark.parametrize("turn", [1, -1])
def test_of_several_red_lines_the_longest_way_counts_and_of_its_own_only(turn):
    car = Driven(IN_LANE, arc((2.0, 20.0), start_m=90.0))  # 0.1 m in a step; red until step 161
    events = (crossed(101), crossed(141), crossed(61, EMV))[::turn]
    signal = lambda step: ("r" if step < 161 else "G") + "G" * 6  # noqa: E731 - of its own lane alone
    worst = found("red_line", driver_among({EMV: COMES}, car, signal=signal, events=events), {})
    assert (worst.measure.value, worst.step) == (pytest.approx(6.0, abs=0.11), 101)
    others = driver_among({EMV: COMES}, car, signal=lambda _: "Grrrrrr", events=events)
    assert found("red_line", others, {}).measure.value == 0.0


@pytest.mark.parametrize(("near", "far"), [(SECOND, THIRD), (THIRD, SECOND)])
def test_the_nearest_of_several_others_limits_the_room(near, far):
    car = Driven(line((1.75, -120.0), (1.75, 110.0)), arc((5.0, 4.0), start_m=20.0))
    ahead = {
        near: Driven(car.points, arc((5.0, 4.0), start_m=35.0)),
        far: Driven(car.points, arc((1.0, 4.0), start_m=45.0)),
    }
    room = driver_among({EMV: FAR}, car, ahead).room
    assert (room.ahead_m[20], room.ahead_mps[20]) == (pytest.approx(11.0), pytest.approx(5.0))
    sides = {
        near: Driven(line((5.25, -120.0), (5.25, 110.0)), car.arc_m),
        far: Driven(line((7.25, -120.0), (7.25, 110.0)), car.arc_m),
    }
    assert driver_among({EMV: FAR}, car, sides).room.right_m[20] == pytest.approx(3.5 - 1.8)


def test_the_figures_of_others_are_those_of_the_episode_less_those_of_the_papers():
    cars = {one: Driven(aside(IN_LANE, 3.5 * one), arc((5.0, 10.0))) for one in (CAR, SECOND, THIRD)}

    def recorded(emv_mps, *braking):
        record = hand_made(crossing(), {EMV: Driven(NORTHBOUND, arc((emv_mps, 10.0))), **cars})
        hard = lambda state: np.where(np.isin(state.actor_id, braking) & (20 < state.step < 40), -6.0, 0.0)  # noqa: E731
        return with_states(record, accel_mps2=hard)

    # 80 m need 10 s and 8 s. Neither EMVs nor the driver itself count.
    record, paper = recorded(8.0, EMV, CAR, SECOND, THIRD), recorded(10.0, EMV, SECOND)
    compared = compared_with_paper(record, CAR, paper, SECOND)
    assert compared == {"emv_delay_s": pytest.approx(2.0, abs=0.06), "braked_hard": 2.0}
    assert compared_with_paper(record, CAR, recorded(10.0), SECOND)["braked_hard"] == 2.0
    compared = compared_with_paper(paper, SECOND, record, CAR)
    assert compared == {"emv_delay_s": pytest.approx(-2.0, abs=0.06), "braked_hard": -2.0}
