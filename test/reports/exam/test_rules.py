"""Monitors of ordinary traffic and of sirens from other directions, on records made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import (
    BESIDE,
    CAR_LENGTH_M,
    EAST,
    EASTBOUND,
    EMV,
    EMV_LENGTH_M,
    LANE_TURN,
    LEFT_X_M,
    RIGHT_X_M,
    SOUTHBOUND,
    Driven,
    crossing,
    hand_made,
    line,
    with_states,
)
from made_encounters import CAR, IN_LANE, arc

from siren_ros.reports.exam.examinee import Examinee
from siren_ros.reports.exam.monitors import MONITORS
from siren_ros.simulation.roads.road_network import JunctionKind
from siren_ros.simulation.world.actors import Event, EventKind, Lights

OTHER = 3
LIMIT_MPS = 13.9
HEARD_M = 50.0
REACTION_S = 3.0
FAR = Driven(line((-1.75, -30.0), (-1.75, -120.0)), arc((0.1, 30.0)))
"""An EMV that nobody hears: its siren is silent."""


def recorded(vehicles, *, siren=(), control=JunctionKind.PRIORITY_STOP, signal=lambda _: ""):
    """The record with the sirens of these EMVs on; they are the EMVs, or number 1 where there is none."""
    record = hand_made(crossing(control), {EMV: FAR, **vehicles}, signal)
    if not siren:
        return record

    def lit(state):
        lights = state.lights.copy()
        lights[np.isin(state.actor_id, siren)] |= int(Lights.SIREN)
        return lights

    actors = {one: replace(actor, is_emv=one in siren) for one, actor in record.actors.items()}
    described = replace(record.description, emv_ids=tuple(siren))
    return with_states(replace(record, actors=actors, description=described), lights=lit)


def found(name, record, paper=None, heard_m=HEARD_M, **numbers):
    other = None if paper is None else Examinee(paper, CAR, heard_m, REACTION_S)
    return MONITORS[name].find(Examinee(record, CAR, heard_m, REACTION_S, other), numbers)


def value(name, record, **others):
    """The value, which is the same where traffic keeps left."""
    one, mirrored = (found(name, each, **others).measure for each in (record, record.mirrored()))
    assert one.valid
    assert mirrored.value == pytest.approx(one.value, abs=1e-6)
    return one.value


def north(*pieces, start_m=0.0):
    return Driven(IN_LANE, arc(*pieces, start_m=start_m))


def test_speed_above_the_limit_has_to_last_and_time_off_the_road_counts():
    assert value("speeding", recorded({CAR: north((20.0, 4.0))}), lasting_s=1.0) == pytest.approx(20.0 - LIMIT_MPS)
    assert value("speeding", recorded({CAR: north((13.0, 4.0))}), lasting_s=1.0) == 0.0
    for before_s in (2.0, 0.0):  # or as its record begins
        brief = north((13.0, before_s), (20.0, 0.6), (13.0, 2.0))
        assert value("speeding", recorded({CAR: brief}), lasting_s=1.0) == 0.0
    verge = line((10.9, -120.0), (10.9, -20.0))  # the shoulder ends at 9.5 m, the next road begins at 12.25 m
    assert value("off_road", recorded({CAR: Driven(verge, arc((10.0, 5.0)))})) == pytest.approx(5.0, abs=0.1)
    whole = value("off_road", recorded({CAR: north((10.0, 22.0))}))  # across the junction
    assert whole == 0.0


PRUDENT = {"stands_s": 5.0, "below_mps": 8.9, "least_mps": 2.2, "aside_m": 5.0}


@pytest.mark.parametrize(
    ("speed_mps", "left_m", "lights", "over_mps"),
    [(10.0, 3.5, Lights.BEACON, 5.0), (4.0, 3.5, Lights.BEACON, 0.0), (10.0, 7.0, Lights.BEACON, None)]
    + [(10.0, 3.5, lights, None) for lights in (Lights.NONE, Lights.BEACON | Lights.SIREN)],
)
def test_an_emv_that_stands_with_its_lamps_is_passed_slowly(speed_mps, left_m, lights, over_mps):
    x_m = IN_LANE[0][0] - left_m
    stands = Driven(line((x_m, -120.0), (x_m, 0.0)), arc((0.0, 12.0), start_m=70.0))
    record = with_states(
        recorded({CAR: north((speed_mps, 12.0), start_m=70.0 - 7.0 * speed_mps), EMV: stands}),
        lights=lambda state: np.where(state.actor_id == EMV, int(lights), 0).astype(np.uint8),
    )
    if over_mps is None:
        assert not found("passes_standing", record, **PRUDENT).measure.valid
    else:
        assert value("passes_standing", record, **PRUDENT) == pytest.approx(over_mps, abs=0.01)
    soon = found("passes_standing", record, **{**PRUDENT, "stands_s": 11.5})
    assert not soon.measure.valid


def test_a_lane_for_others_is_left_when_a_siren_comes():
    behind = Driven(IN_LANE, arc((10.0, 9.0)))
    record = recorded({CAR: north((10.0, 9.0), start_m=30.0), EMV: behind}, siren=(EMV,))
    assert not found("reserved_lane", record).measure.valid
    own = Examinee(record, CAR, HEARD_M, REACTION_S).places.lane[0]
    lanes = tuple(replace(lane, civilian_allowed=lane.index != own) for lane in record.network.lanes)
    reserved = replace(record, network=replace(record.network, lanes=lanes))
    on_road_s = (100.0 - 30.0) / 10.0
    assert value("reserved_lane", reserved) == pytest.approx(on_road_s - REACTION_S, abs=0.15)
    assert not found("reserved_lane", replace(reserved, actors=record.actors), heard_m=1.0).measure.valid


@pytest.mark.parametrize(("from_m", "dark_m"), [(60.0, 0.0), (80.0, 10.5), (200.0, 30.5)])
def test_a_turn_is_signalled_on_the_last_hundred_feet(from_m, dark_m):
    """The driver turns right at its stop line, 100 m on its way."""
    way = np.concatenate((line((RIGHT_X_M, -120.0)), LANE_TURN, line((120.0, LANE_TURN[-1][1]))))
    plain = recorded({CAR: Driven(way, arc((10.0, 14.0)))})

    def lit(side):
        def lights(state):
            shown = (state.actor_id == CAR) & (state.step * 0.05 * 10.0 >= from_m)
            return np.where(shown, int(side), 0).astype(np.uint8)

        return lights

    numbers = {"before_m": 30.5, "after_s": 10.0}
    right, left = (with_states(plain, lights=lit(side)) for side in (Lights.INDICATOR_RIGHT, Lights.INDICATOR_LEFT))
    assert value("turn_signal", right, **numbers) == pytest.approx(dark_m, abs=0.6)
    assert value("turn_signal", left, **numbers) == pytest.approx(30.5, abs=0.6)
    assert not found("turn_signal", recorded({CAR: north((10.0, 14.0))}), **numbers).measure.valid


@pytest.mark.parametrize(("pieces", "least_mps"), [(((5.0, 19.0), (0.0, 2.0), (5.0, 3.0)), 0.0), (((5.0, 24.0),), 5.0)])
def test_a_stop_sign_asks_for_a_standstill_before_its_line(pieces, least_mps):
    record = recorded({CAR: north(*pieces)})
    step = round((20.0 if least_mps else 22.0) / 0.05)  # its centre is at the line
    crossed = Event(step, EventKind.STOP_LINE_CROSSED, CAR, detail={"must_stop": 1, "junction": "J", "direction": "s"})
    assert value("stop_sign", replace(record, events=(crossed,))) == pytest.approx(least_mps, abs=0.3)
    assert not found("stop_sign", record).measure.valid


def crossed_by(other, after_s, emv=False):
    """A driver to the north at 10 m/s, and one to the east that comes to the place so long after it has left."""
    left_s = (120.0 - 5.25 + 0.9 + 0.5 * CAR_LENGTH_M - 20.0) / 10.0
    length_m, width_m = (EMV_LENGTH_M, 2.1) if emv else (CAR_LENGTH_M, 1.8)
    left_s += 0.5 * (width_m - 1.8) / 10.0
    comes_m = 110.0 + 5.25 - 0.9 - 0.5 * length_m
    east = Driven(EASTBOUND, arc((10.0, 13.0), start_m=comes_m - 10.0 * (left_s + after_s)))
    return {CAR: north((10.0, 13.0), start_m=20.0), other: east}


def test_time_before_somebody_with_the_right_of_way():
    record = recorded(crossed_by(OTHER, 0.8))
    assert value("right_of_way", record) == pytest.approx(0.8, abs=0.11)
    assert found("right_of_way", record).about == f"sedan {OTHER}"
    second = value("right_of_way", recorded(crossed_by(OTHER, -3.0)))
    assert second == 60.0  # the other one went first
    # A movement that gives way has no right of way, but a siren has it.
    network = replace(record.network, connections=tuple(replace(c, gives_way=True) for c in record.network.connections))
    assert not found("right_of_way", replace(record, network=network)).measure.valid
    # Its movement is at another junction, or the one here was an earlier one that gives way.
    for name, changes in (("K", {EAST: {"junction": "K"}}), ("J", {BESIDE: {"gives_way": True}})):
        ways = tuple(replace(c, **changes.get(k, {})) for k, c in enumerate(record.network.connections))
        vehicles = crossed_by(OTHER, 0.8) if name == "K" else {CAR: north((0.0, 11.6), (10.0, 13.0), start_m=20.0)}
        again = Driven(
            line((14.0, -40.0), (14.0, 20.0), (-60.0, 20.0), (-60.0, -5.25), (60.0, -5.25)), arc((10.0, 27.0))
        )
        other = recorded({**({OTHER: again} if name == "J" else {}), **vehicles})
        other = replace(other, network=replace(other.network, connections=ways))
        assert found("right_of_way", other).measure.valid is (name == "J")
    sounds = recorded(crossed_by(EMV, 0.8, emv=True), siren=(EMV,))
    assert value("right_of_way", replace(sounds, network=network)) == pytest.approx(0.8, abs=0.11)


@pytest.mark.parametrize(("letters", "binds"), [("gggrGrr", True), ("GGGrgrr", False), ("gggrgrr", False)])
def test_the_signal_says_who_goes_first(letters, binds):
    record = recorded(crossed_by(OTHER, 0.8), control=JunctionKind.SIGNAL, signal=lambda _: letters)
    assert found("right_of_way", record).measure.valid is binds


@pytest.mark.parametrize(("then", "binds"), [("gggrGrr", True), ("gggrrrr", False)])
def test_the_signal_of_the_other_one_is_that_at_which_it_enters(then, binds):
    """The driver is on the junction from 8 s on, the other one from 9.3 s on."""
    before = {"gggrGrr": "gggrrrr", "gggrrrr": "gggrGrr"}[then]
    changes = recorded(
        crossed_by(OTHER, 0.8), control=JunctionKind.SIGNAL, signal=lambda step: before if step < 175 else then
    )
    assert found("right_of_way", changes).measure.valid is binds


def test_a_junction_is_left_unless_others_go_first():
    stands = {CAR: north((10.0, 3.0), (0.0, 6.0), (10.0, 5.0), start_m=80.0)}
    assert value("blocks_junction", recorded(stands)) == pytest.approx(6.0, abs=0.15)
    before = {CAR: north((10.0, 1.0), (0.0, 6.0), (10.0, 6.0), start_m=80.0)}
    assert value("blocks_junction", recorded(before)) == 0.0
    waits = recorded(stands, control=JunctionKind.SIGNAL, signal=lambda _: "ggggggg")
    assert value("blocks_junction", waits) == 0.0
    assert not found("blocks_junction", recorded({CAR: north((1.0, 5.0))})).measure.valid


def east(*pieces, start_m=0.0):
    return Driven(EASTBOUND, arc(*pieces, start_m=start_m))


@pytest.mark.parametrize("emvs", [(EMV, OTHER), (OTHER, EMV)])
def test_nobody_stands_in_a_junction_to_which_a_siren_comes(emvs):
    comes, away = east((0.0, 8.0), start_m=70.0), Driven(line((5.25, 20.0), (5.25, 110.0)), arc((5.0, 8.0)))
    inside, outside = (north((0.0, 8.0), start_m=start_m) for start_m in (110.0, 96.0))
    vehicles = dict(zip(emvs, (comes, away), strict=True))
    record = recorded({**vehicles, CAR: inside}, siren=(EMV, OTHER))
    assert value("stands_in_junction", record) == pytest.approx(8.0, abs=0.1)
    assert value("stands_in_junction", recorded({**vehicles, CAR: outside}, siren=(EMV, OTHER))) == 0.0
    assert not found("stands_in_junction", record, heard_m=8.0).measure.valid
    assert not found("stands_in_junction", recorded({emvs[1]: away, CAR: inside}, siren=(emvs[1],))).measure.valid


@pytest.mark.parametrize("emvs", [(EMV, OTHER), (OTHER, EMV)])
def test_nobody_enters_before_a_siren_that_comes_across(emvs):
    numbers = {"soon_s": 5.0, "brakes_mps2": 3.4}
    waits = east((0.0, 14.0), start_m=64.0)  # it does not come across
    car = north((0.0, 6.0), (10.0, 8.0), start_m=92.0)  # stands 8 m before the line, and then drives
    comes = east((8.0, 10.0), (8.0, 4.0), start_m=50.0)
    record = recorded({**dict(zip(emvs, (comes, waits), strict=True)), CAR: car}, siren=(EMV, OTHER))
    first = value("enters_before_siren", record, **numbers)
    assert first == pytest.approx(0.0, abs=1e-9)  # the EMV goes first
    late = east((8.0, 10.0), (8.0, 4.0), start_m=50.0 - 24.0)
    record = recorded({**dict(zip(emvs, (late, waits), strict=True)), CAR: car}, siren=(EMV, OTHER))
    # It stands as it hears the siren, at 50 m, so that the whole way to the line is left.
    assert value("enters_before_siren", record, **numbers) == pytest.approx(8.0, abs=0.6)
    assert found("enters_before_siren", record, heard_m=8.0, **numbers).measure.value == 0.0
    both = recorded({**dict(zip(emvs, (late, comes), strict=True)), CAR: car}, siren=(EMV, OTHER))
    assert value("enters_before_siren", both, **numbers) == pytest.approx(8.0, abs=0.6)
    unheard = replace(record, description=replace(record.description, emv_ids=(EMV, OTHER)))
    silent = with_states(unheard, lights=lambda state: np.zeros(len(state), np.uint8))
    assert not found("enters_before_siren", silent, **numbers).measure.valid


@pytest.mark.parametrize(("stops_s", "left_m"), [(7.5, 8.0), (5.5, 0.0)])
def test_an_emv_that_stops_for_a_driver_who_enters_would_have_come_soon(stops_s, left_m):
    """It stands for 6 s. The driver enters after 6.8 s; an EMV that stands before has let it go."""
    emv = east((8.0, stops_s), (0.0, 6.0), (8.0, 12.5 - stops_s), start_m=26.0)
    record = recorded({EMV: emv, CAR: north((0.0, 6.0), (10.0, 8.0), (0.1, 4.5), start_m=92.0)}, siren=(EMV,))
    assert value("enters_before_siren", record, soon_s=5.0, brakes_mps2=3.4) == pytest.approx(left_m, abs=0.6)


def test_a_driver_before_an_emv_from_ahead_stops_or_goes_to_the_edge():
    numbers = {"gap_m": 30.0, "aside_m": 12.0, "edge_m": 1.0, "seen_m": 300.0, "stop_s": 1.0}
    emv = Driven(SOUTHBOUND, arc((10.0, 18.0)))
    drives, stops = north((4.0, 18.0), start_m=20.0), north((4.0, 4.0), (0.0, 14.0), start_m=20.0)
    edge = Driven(line((7.7, -120.0), (7.7, -20.0)), arc((4.0, 18.0), start_m=20.0))  # 0.9 m to the edge at 9.5 m
    for car, speed_mps in ((drives, 4.0), (stops, 0.0), (edge, 0.0)):
        record = recorded({EMV: emv, CAR: car}, siren=(EMV,))
        assert value("before_oncoming", record, **numbers) == pytest.approx(speed_mps, abs=0.1)
    record = recorded({EMV: emv, CAR: drives}, siren=(EMV,))
    assert not found("before_oncoming", record, **{**numbers, "aside_m": 3.0}).measure.valid


def test_progress_is_that_without_an_emergency_vehicle():
    numbers = {"near_m": 40.0, "after_s": 1.0, "least_m": 20.0}
    emv = Driven(line((1.75, -120.0), (1.75, 110.0)), arc((20.0, 11.0), start_m=0.0))
    paper, parks = (
        recorded({EMV: emv, CAR: car}, siren=(EMV,))
        for car in (north((5.0, 11.0), start_m=30.0), north((1.0, 11.0), start_m=30.0))
    )
    assert value("progress", parks, paper=paper, **numbers) == pytest.approx(0.2, abs=0.01)
    assert value("progress", paper, paper=paper, **numbers) == pytest.approx(1.0)
    assert not found("progress", parks, **numbers).measure.valid
    assert not found("progress", parks, paper=paper, **{**numbers, "near_m": 400.0}).measure.valid


def test_a_red_light_and_somebody_ahead_are_reasons_not_to_get_on():
    """The driver stands from 40 m on, 58 m before the line, or from 90 m on, 8 m before it; the paper's goes 150 m."""
    paper, numbers = recorded({CAR: north((5.0, 30.0))}), {"near_m": 30.0, "after_s": 1.0, "least_m": 20.0}
    early, late = north((5.0, 8.0), (0.0, 22.0)), north((5.0, 18.0), (0.0, 12.0))

    def share(car, letter="G", **others):
        record = recorded({CAR: car, **others}, control=JunctionKind.SIGNAL, signal=lambda _: 7 * letter)
        return value("progress", record, paper=paper, **numbers)

    assert share(late) == pytest.approx(90.0 / 150.0, abs=0.01)
    assert share(early) == share(early, "r") == pytest.approx(40.0 / 150.0, abs=0.01)
    for letter in "ryu":
        assert share(late, letter) == pytest.approx(1.0)
    for gap_m, expected in ((15.0, 1.0), (22.0, 40.0 / 150.0)):
        standing = {OTHER: north((0.0, 30.0), start_m=40.0 + CAR_LENGTH_M + gap_m)}
        record = recorded({CAR: early, **standing})
        assert value("progress", record, paper=paper, **numbers) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(("aside_m", "asked"), [(30.0, True), (60.0, False)])
def test_a_driver_that_a_siren_came_near_has_not_evaded_it(aside_m, asked):
    called = Driven(line((1.75, -120.0), (1.75, 110.0)), arc((10.0, 8.0)))
    paper = recorded({EMV: called, CAR: north((5.0, 8.0), start_m=40.0)}, siren=(EMV,))
    across = Driven(SOUTHBOUND - np.array([aside_m, 0.0]), arc((10.0, 16.0)))
    record = recorded({EMV: across, CAR: north((0.0, 16.0), start_m=90.0)}, siren=(EMV,))
    assert (value("evades", record, paper=paper) == 0.0) is asked


def test_who_flees_has_not_been_asked():
    emv = Driven(line((1.75, -120.0), (1.75, 110.0)), arc((10.0, 8.0)))
    paper, flees = (
        recorded({EMV: emv, CAR: car}, siren=(EMV,))
        for car in (north((5.0, 8.0), start_m=40.0), north((20.0, 8.0), start_m=70.0))
    )
    called_s = Examinee(paper, CAR, HEARD_M, REACTION_S).called.sum() * 0.05
    assert value("evades", flees, paper=paper) == pytest.approx(called_s)
    assert value("evades", paper, paper=paper) == 0.0
    assert not found("evades", flees).measure.valid


@pytest.mark.parametrize(("near", "far"), [(OTHER, 4), (4, OTHER)])
def test_the_worst_of_several_others_counts(near, far):
    def among(near_s, far_s):
        return recorded({**crossed_by(near, near_s), far: crossed_by(far, far_s)[far]})

    def braked(state):
        braking = 170 <= state.step <= 190
        return np.where(state.actor_id == near, -5.0, np.where(state.actor_id == far, -3.0, 0.0)) * braking

    record = among(0.5, 1.2)
    assert value("right_of_way", record) == pytest.approx(0.5, abs=0.11)
    assert found("right_of_way", record).about == f"sedan {near}"
    assert not found("encroachment", record).measure.valid  # the driver went first
    record = with_states(record, accel_mps2=braked)
    assert value("forced_braking", record) == pytest.approx(5.0)
    assert found("forced_braking", record).about == f"sedan {near}"
    assert value("forced_braking", among(0.5, 1.2)) == 0.0
    assert value("forced_braking", with_states(among(-3.0, -5.0), accel_mps2=braked)) == 0.0
    # The others go first: each needs 0.58 s for its length and a car's width, and so does the driver.
    assert value("encroachment", among(-3.0, -5.0)) == pytest.approx(3.0 - 2.0 * 0.58, abs=0.11)


@pytest.mark.parametrize("turn", [1, -1])
def test_the_line_passed_fastest_counts(turn):
    record = recorded({CAR: north((5.0, 10.0), (0.0, 2.0), (5.0, 10.0))})
    events = [Event(step, EventKind.STOP_LINE_CROSSED, CAR, detail={"must_stop": 1}) for step in (150, 250)]
    others = Event(10, EventKind.STOP_LINE_CROSSED, EMV, detail={"must_stop": 1})
    rolls = found("stop_sign", replace(record, events=(others, *events[::turn])))
    assert (rolls.measure.value, rolls.step) == (pytest.approx(5.0), 150)


@pytest.mark.parametrize("emvs", [(EMV, OTHER), (OTHER, EMV)])
def test_each_of_two_emvs_counts(emvs):
    # One comes from ahead, and is past after 10 s; the other one drives 40 m aside, and ahead of nobody.
    comes, off = Driven(SOUTHBOUND, arc((10.0, 18.0))), Driven(SOUTHBOUND - np.array([40.0, 0.0]), arc((10.0, 18.0)))
    record = recorded({**dict(zip(emvs, (comes, off), strict=True)), CAR: north((4.0, 18.0), start_m=20.0)}, siren=emvs)
    numbers = {"gap_m": 30.0, "aside_m": 12.0, "edge_m": 1.0, "seen_m": 300.0, "stop_s": 1.0}
    assert value("before_oncoming", record, **numbers) == pytest.approx(4.0, abs=0.1)
    brief = found("before_oncoming", record, **{**numbers, "stop_s": 20.0}).measure
    assert brief.lack == "it came too briefly"
    # Within 30 m of one of them, from 15.35 s on, a driver need not get on, nor after the paper's episode has ended.
    waits = recorded({**dict(zip(emvs, (comes, off), strict=True)), CAR: north((5.0, 8.0), (1.0, 10.0))}, siren=emvs)
    paper = recorded({CAR: north((5.0, 12.0))})
    brief = hand_made(crossing(), {EMV: Driven(FAR.points, FAR.arc_m[:240]), CAR: north((5.0, 12.0))})
    numbers = {"near_m": 30.0, "after_s": 1.0, "least_m": 20.0}
    assert value("progress", waits, paper=paper, **numbers) == pytest.approx((40.0 + 7.35) / 60.0, abs=0.003)
    assert value("progress", waits, paper=brief, **numbers) == pytest.approx((40.0 + 4.0) / 60.0, abs=0.003)


LEAVES_TWICE = line(
    *((5.25, -120.0), (5.25, -110.0), (10.9, -100.0), (10.9, -90.0), (5.25, -80.0), (5.25, -60.0)),
    *((10.9, -50.0), (10.9, -20.0)),
)
"""It is off the road, beyond 9.5 m, from 18.6 to 34.3 m on its way, and from 71.6 m on."""
STANDS_TWICE = (0.0, 1.0), (4.0, 0.15), (0.0, 4.0)


def passes_two(*places_m):
    """The driver gets faster between two EMVs that stand one lane to the left with their lamps."""
    ways = line((LEFT_X_M, -120.0), (LEFT_X_M, 110.0))
    first, second = (Driven(ways, arc((0.0, 12.0), start_m=place_m)) for place_m in places_m)
    record = recorded({CAR: north((8.0, 8.0), (11.0, 4.0)), EMV: first, OTHER: second}, siren=(EMV, OTHER))
    return with_states(record, lights=lambda s: np.where(s.actor_id == CAR, 0, int(Lights.BEACON)).astype(np.uint8))


CAME = recorded({EMV: east((0.0, 8.0), start_m=70.0), CAR: north(*STANDS_TWICE, start_m=105.0)}, siren=(EMV,))
FOUND = {
    # Too fast for 1.5 s from 2 s on, and for 1.6 s from 4.5 s on: that has lasted for a second at 5.5 s.
    "speeding": (
        recorded({CAR: north((13.0, 2.0), (16.0, 1.5), (13.0, 1.0), (19.0, 1.6), (15.0, 1.0))}),
        {"lasting_s": 1.0},
        (19.0 - LIMIT_MPS, 111),
    ),
    # Next to the first one at 40 m from 4.5 s on, and to the second one at 80 m from 9.1 s on.
    "passes_standing": (passes_two(40.0, 80.0), PRUDENT, (6.0, 183)),
    "passes_standing in the other order": (passes_two(80.0, 40.0), PRUDENT, (6.0, 182)),
    "passes_standing at the least": (passes_two(40.0, 80.0), {**PRUDENT, "below_mps": 12.9}, (8.8, 183)),
    "off_road": (recorded({CAR: Driven(LEAVES_TWICE, arc((10.0, 10.0)))}), {}, (10.0 - 7.16, 144)),
    "blocks_junction": (recorded({CAR: north((10.0, 2.5), *STANDS_TWICE, start_m=80.0)}), {}, (4.0, 74)),
    "blocks_junction, and stands beyond it": (
        recorded({CAR: north((10.0, 2.5), (0.0, 1.0), (10.0, 3.0), (0.0, 5.0), start_m=80.0)}),
        {},
        (1.0, 51),
    ),
    "stands_in_junction": (CAME, {}, (4.0, 24)),
}


@pytest.mark.parametrize("case", FOUND)
def test_the_worst_of_several_stretches_counts_and_its_step_is_named(case):
    record, numbers, (worst, step) = FOUND[case]
    for each in (record, record.mirrored()):
        finding = found(case.split()[0].strip(","), each, **numbers)
        assert (finding.measure.value, finding.step) == (pytest.approx(worst, abs=0.11), pytest.approx(step, abs=3.0))
