"""What the drivers decide, in steps made by hand, and the card of the shipped one."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EASTBOUND, NORTHBOUND, Driven, at_speed, crossing, hand_made, with_states
from made_sights import LIMIT_MPS, ROWS, car, sight, siren, straight_way, to_the_right
from seen_on_crossing import EMV, OWN, sight_at

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError
from siren_ros.running.seat.drivers.drivers import DRIVERS, driver_of
from siren_ros.running.seat.drivers.lawful import FAULTS, HABITS, LawfulDriver, LawfulState, Phase, faulty
from siren_ros.running.seat.policy import Manoeuvre
from siren_ros.running.seat.sight import Way, sight_of
from siren_ros.simulation.roads.road_network import JunctionKind
from siren_ros.simulation.world.actors import Lights

CALLED = (siren(20.0),)


def after(driver, seconds, first=None, **known):
    """State and last answer of a driver that sees the same for some time, at a speed of its own choice."""
    state, answer = first or driver.start, None
    for step in range(round(20 * seconds)):
        state, answer = driver.step(state, replace(sight(**known), step=step))
    return state, answer


@pytest.mark.parametrize("name", DRIVERS)
def test_every_driver_answers_with_and_without_a_siren(name):
    for sirens in ((), CALLED, (siren(-40.0),)):
        _, answer = after(driver_of(name), 4.0, sirens=sirens, others=(car(8.0),))
        answer.check()


def test_an_unknown_driver_is_refused():
    with pytest.raises(InputError, match="lawful-california"):
        driver_of("nobody")


def test_without_a_siren_it_drives():
    state, answer = after(driver_of("lawful-california"), 2.0)
    assert state == LawfulState()
    assert (answer.brake, answer.steer_rad, answer.lights) == (0.0, 0.0, 0)


def test_it_signals_and_slows_before_it_moves_to_the_right_and_stands_there():
    driver = driver_of("lawful-california")
    state, answer = after(driver, 0.7, sirens=CALLED)
    assert state.phase is Phase.DRIVES  # within its reaction time
    state, answer = after(driver, 1.5, sirens=CALLED)
    assert answer.lights == Lights.INDICATOR_RIGHT
    assert answer.brake > 0.0
    assert state.offset_m == 0.0
    state, answer = after(driver, 4.0, sirens=CALLED)
    assert state.offset_m < -1.0
    edge_m = -5.25 + 0.9 + 0.15
    state, answer = after(driver, 8.0, sirens=CALLED, left_m=edge_m, speed_mps=3.0)
    assert answer.brake > 0.0
    assert state.offset_m == pytest.approx(edge_m)


def test_it_stands_until_the_last_one_is_far_ahead():
    waiting = LawfulState(Phase.MAKES_WAY, since=0)
    for gap_m, phase in ((20.0, Phase.MAKES_WAY), (-60.0, Phase.MAKES_WAY), (-150.0, Phase.RETURNS)):
        state, _ = after(driver_of("lawful-california"), 0.05, waiting, sirens=(siren(gap_m),))
        assert state.phase is phase, gap_m
    both = (siren(-150.0), siren(60.0))
    assert after(driver_of("lawful-california"), 0.05, waiting, sirens=both)[0].phase is Phase.MAKES_WAY
    assert after(driver_of("leaves-early-california"), 0.05, waiting, sirens=both)[0].phase is Phase.RETURNS
    assert after(driver_of("never-returns-california"), 0.05, waiting)[0].phase is Phase.MAKES_WAY


def test_it_does_not_move_beside_somebody_and_not_before_an_emv_on_the_right():
    driver = driver_of("lawful-california")
    # To cross the way of the last one takes 5.4 s, in which it gains 54 m, or 11 m.
    for hindered, free in (
        ({"others": (car(-3.0, left_m=-3.4, speed_mps=10.0),)}, False),
        ({"sirens": (siren(10.0, left_m=-3.4),)}, False),
        ({"sirens": (siren(40.0, left_m=-3.4, speed_mps=20.0),)}, False),
        ({"sirens": (siren(40.0, left_m=-3.4, speed_mps=12.0),)}, True),
    ):
        state, _ = after(driver, 5.0, **{"sirens": CALLED, **hindered})
        assert state.phase is Phase.MAKES_WAY
        assert (state.offset_m > -0.8) is not free
    behind = car(-20.0, left_m=-3.4, speed_mps=18.0)  # is beside it in 2.5 s
    assert after(driver, 5.0, sirens=CALLED, others=(behind,))[0].offset_m > -0.8


def test_it_clears_a_junction_and_does_not_stop_right_before_one():
    driver, faulty_one = driver_of("lawful-california"), driver_of("stops-in-the-junction-california")
    inside = {"s_m": 110.0, "speed_mps": 4.0, "sirens": CALLED}
    assert after(driver, 3.0, **inside)[1].throttle > 0.0
    assert after(faulty_one, 3.0, **inside)[1].brake > 0.0
    assert after(driver, 3.0, s_m=95.0, speed_mps=8.0, sirens=CALLED)[1].brake == 0.0


def test_in_germany_it_keeps_to_its_side_of_the_rescue_lane_and_off_the_shoulder():
    shoulder = {"right_m": np.full(ROWS, -4.25), "driving_right_m": np.full(ROWS, -1.75)}
    motorway = straight_way(**shoulder, duty=np.ones(ROWS, np.bool_))
    driver = driver_of("lawful-germany")
    left, _ = after(driver, 8.0, way=motorway, sirens=CALLED)
    assert left.offset_m == pytest.approx(1.75 - 0.9 - 0.15)
    right_lane = replace(motorway, leftmost=np.zeros(ROWS, np.bool_))
    assert after(driver, 8.0, way=right_lane, sirens=CALLED)[0].offset_m == pytest.approx(-1.75 + 0.9 + 0.15)
    turned = after(driver, 4.0, left, way=right_lane, sirens=CALLED)[0]  # into a road without a lane to its right
    assert turned.offset_m < 0.0
    blocks = after(driver_of("blocks-the-shoulder-germany"), 8.0, way=right_lane, sirens=CALLED)[0]
    assert blocks.offset_m == pytest.approx(-4.25 + 0.9 + 0.15)
    before = after(driver, 3.0, way=motorway, speed_mps=1.0)[0]  # slow traffic, and nobody calls
    assert before.phase is Phase.DRIVES
    assert before.offset_m > 0.3
    assert after(driver, 3.0, way=motorway, speed_mps=LIMIT_MPS)[0].offset_m == 0.0
    # On the wrong side it signals the longer move, and stays behind who is ahead in its lane.
    wrong = {"way": motorway, "speed_mps": 1.0, "others": (car(2.0, left_m=0.8),)}
    state, answer = after(driver_of("wrong-side-germany"), 0.1, **wrong)
    assert answer.lights == Lights.INDICATOR_RIGHT
    state, answer = after(driver_of("wrong-side-germany"), 4.0, left_m=-1.45, **wrong)
    assert state.offset_m == pytest.approx(-1.75 + 0.9 - 0.6)
    assert (answer.brake > 0.0, answer.lights) == (True, 0)


@pytest.mark.parametrize(("place", "side"), [("international", 1.0), ("germany", 1.0), ("california", -1.0)])
def test_where_a_queue_keeps_it_from_going_right_it_goes_to_the_side_that_the_place_allows(place, side):
    queue = {"sirens": CALLED, "others": (car(-3.0, left_m=-3.4),), "speed_mps": 1.0}
    assert after(driver_of(f"lawful-{place}"), 3.0, **queue)[0].side == -1.0
    rightmost = straight_way(leftmost=np.zeros(ROWS, np.bool_))
    sides = {"queue": side, "emv": side, "alone": -1.0, "fast": -1.0, "rightmost": -1.0, "moved": -1.0}
    for name, changed in (
        ("queue", {}), ("emv", {"others": (), "sirens": (siren(20.0, left_m=-3.0),)}),
        ("alone", {"others": ()}), ("fast", {"speed_mps": LIMIT_MPS}), ("rightmost", {"way": rightmost}),
        ("moved", {"left_m": -0.8, "others": (car(-3.0, left_m=-3.9),)}),
    ):  # fmt: skip
        assert after(driver_of(f"lawful-{place}"), 5.0, **{**queue, **changed})[0].side == sides[name], name


def test_it_goes_back_when_nobody_comes_and_drives_in_the_middle_of_the_lane_that_it_is_in_before():
    back = LawfulState(Phase.RETURNS, since=0, offset_m=-4.0)
    passes = (car(-12.0, speed_mps=8.0),)
    state, _ = after(driver_of("lawful-international"), 3.0, back, left_m=-4.0, speed_mps=6.0, others=passes)
    assert state.offset_m == pytest.approx(-3.5)
    state, _ = after(driver_of("lawful-international"), 3.0, back, left_m=-4.0, speed_mps=6.0)
    assert state.offset_m > -2.5
    for beside_m, offset_m in ((-2.6, 0.6), (-2.8, 0.0)):  # 0.8 m, and 1 m, from somebody next to it
        aside = {"left_m": 0.6, "speed_mps": 6.0, "others": (car(-3.0, left_m=beside_m, speed_mps=6.0),)}
        state, _ = after(driver_of("lawful-international"), 3.0, replace(back, offset_m=0.6), **aside)
        assert state.offset_m == pytest.approx(offset_m)


def test_it_keeps_its_place_while_somebody_is_beside_it_where_its_path_changes_to():
    changing = {"s_m": 55.0, "way": straight_way(**to_the_right()), "speed_mps": 8.0}
    for gap_m, offset_m in ((-3.0, 0.525), (-12.0, 0.0)):  # the path moves by that to the right
        state, _ = after(driver_of("lawful-germany"), 0.1, others=(car(gap_m, left_m=-2.7),), **changing)
        assert state.offset_m == pytest.approx(offset_m)
    for gap_m, left_m, stands in ((-3.0, -2.0, True), (-3.0, -2.2, False), (-3.0, 2.0, False), (-12.0, -2.0, False)):
        slow = {**changing, "speed_mps": 1.0, "others": (car(gap_m, left_m=left_m, speed_mps=1.0),)}
        answer = after(driver_of("lawful-germany"), 0.1, LawfulState(Phase.RETURNS, offset_m=0.6), **slow)[1]
        assert (answer.throttle == 0.0) is stands, (gap_m, left_m)


def test_while_it_makes_way_an_emv_that_is_beside_it_gets_ahead():
    waiting = LawfulState(Phase.MAKES_WAY, since=0, speed_mps=4.0)
    beside = (siren(-3.0, left_m=-2.6, speed_mps=2.0),)
    driver = driver_of("lawful-international")
    assert after(driver, 0.05, waiting, sirens=beside, speed_mps=2.0)[1].brake > 0.0
    assert after(driver, 0.05, waiting, sirens=(siren(20.0, speed_mps=2.0),), speed_mps=2.0)[1].brake == 0.0


@pytest.mark.parametrize(("left_m", "emv_mps", "stands"), [(-2.4, 6.0, True), (-2.4, 1.0, False), (-1.9, 6.0, False)])
def test_an_emv_that_comes_between_is_let_by_and_one_that_cannot_pass_gets_way(left_m, emv_mps, stands):
    waiting = LawfulState(Phase.MAKES_WAY, since=-100, speed_mps=4.0)
    comes = {"sirens": (siren(6.0, left_m, speed_mps=emv_mps),), "speed_mps": 0.0}
    assert (after(driver_of("lawful-california"), 0.05, waiting, **comes)[1].throttle == 0.0) is stands


@pytest.mark.parametrize(("off_m", "emv_mps", "stands"), [(0.7, 6.0, True), (0.7, 1.0, False), (0.2, 1.0, True)])
def test_nearly_at_the_edge_it_stands_unless_an_emv_waits_behind(off_m, emv_mps, stands):
    waiting = LawfulState(Phase.MAKES_WAY, since=-100, offset_m=-3.9, speed_mps=4.0)
    near = {"sirens": (siren(6.0, left_m=3.0, speed_mps=emv_mps),), "speed_mps": 0.0, "left_m": -4.2 + off_m}
    assert (after(driver_of("lawful-california"), 0.05, waiting, **near)[1].throttle == 0.0) is stands


def test_what_single_faults_change():
    assert driver_of("creeps-germany") == LawfulDriver(faulty(HABITS["germany"], "creeps"))
    for fault in FAULTS:
        assert any(faulty(habits, fault) != habits for habits in HABITS.values()), fault
    waiting = LawfulState(Phase.MAKES_WAY, since=0, speed_mps=8.0)
    there = {"sirens": CALLED, "left_m": -4.05, "speed_mps": 0.0}
    assert after(driver_of("lawful-california"), 0.05, waiting, **there)[1].throttle == 0.0
    assert after(driver_of("creeps-california"), 0.05, waiting, **there)[1].throttle > 0.0
    assert after(driver_of("ignores-california"), 5.0, sirens=CALLED)[0].phase is Phase.DRIVES
    assert after(driver_of("no-indicator-california"), 1.5, sirens=CALLED)[1].lights == 0
    assert after(driver_of("wrong-side-california"), 6.0, sirens=CALLED)[0].offset_m > 1.0
    assert after(driver_of("opens-late-california"), 8.9, sirens=CALLED)[0].phase is Phase.DRIVES
    assert after(driver_of("brakes-hard-california"), 1.0, sirens=CALLED)[1].brake == pytest.approx(8.5 / 9.0)
    red = {"red_m": 20.0}
    assert after(driver_of("lawful-california"), 0.05, **red)[1].brake > 0.0
    assert after(driver_of("runs-red-california"), 0.05, **red)[1].brake == 0.0
    passed = {"sirens": (siren(-30.0),), "speed_mps": 8.0}
    assert after(driver_of("lawful-germany"), 0.05, **passed)[1].brake > 0.0
    assert after(driver_of("follows-germany"), 0.05, **passed)[1].throttle > 0.0


def before_the_line(own_m, own_mps, control=JunctionKind.PRIORITY_STOP, emv_m=85.0):
    """A step before the line at 100 m; an EMV with its siren comes from the left, the line's crossing at 115 m."""
    network = crossing(control)
    vehicles = {EMV: Driven(EASTBOUND, at_speed(emv_m, 10.0, 2)), OWN: Driven(NORTHBOUND, at_speed(own_m, own_mps, 2))}
    record = hand_made(network, vehicles)
    sounding = with_states(record, lights=lambda state: np.where(state.actor_id == EMV, int(Lights.SIREN), 0))
    way = Way.of(network, Polyline.through(NORTHBOUND))
    return sight_of(sounding.states[1], (), record.actors, OWN, way, own_m)


def test_it_stops_at_a_stop_sign_once_and_does_not_enter_before_a_siren():
    lawful, runs, darts = (driver_of(f"{name}-germany") for name in ("lawful", "runs-red", "enters-before-a-siren"))
    comes, far = before_the_line(90.0, 8.0, emv_m=0.0), before_the_line(97.0, 0.0, emv_m=0.0)
    assert lawful.step(lawful.start, comes)[1].brake > 0.0
    assert runs.step(runs.start, comes)[1].brake == 0.0
    stood, answer = lawful.step(lawful.start, far)
    assert answer.throttle > 0.0
    assert lawful.step(stood, before_the_line(98.0, 1.0, emv_m=0.0))[1].throttle > 0.0
    near = before_the_line(98.0, 0.0)
    assert lawful.step(stood, near)[1].throttle == 0.0
    assert darts.step(stood, near)[1].throttle > 0.0
    assert darts.step(stood, before_the_line(98.0, 0.0, emv_m=0.0))[1].throttle == 0.0


def test_the_shipped_driver_makes_way_and_its_card_says_how_it_learned() -> None:
    driver = driver_of("learned")
    manoeuvres = {
        emv_m: driver.step(driver.start, sight_at(emv_m=emv_m))[0].aim.manoeuvre for emv_m in (15.0, 30.0, 150.0)
    }
    assert manoeuvres == {15.0: Manoeuvre.PULL_OVER, 30.0: Manoeuvre.PULL_OVER, 150.0: Manoeuvre.KEEP}
    card = driver.choose.args[0].card
    assert card["kind"] == "driver"
    assert card["minutes"] < 30.0
    assert card["task"]["seeds"][1] <= 1000
    assert card["fit"]["templates"] == ["S1", "S2"]
