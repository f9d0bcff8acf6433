"""The monitors of a driver, on records made by hand, and where traffic keeps left."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import CAR_LENGTH_M, EMV, EMV_LENGTH_M, RIGHT_X_M, Driven, crossing, hand_made, line, with_states
from made_encounters import CAR, IN_LANE, arc, record_of

from siren_ros.base.numerics.units import steps_from_s
from siren_ros.errors import InputError
from siren_ros.reports.exam import monitors, rules
from siren_ros.reports.exam.examinee import Examinee
from siren_ros.reports.exam.grading import Grade, examine, load_rulebook
from siren_ros.running.generation.closed_loop import closed_loop, driven
from siren_ros.running.generation.closed_loop import record_of as record_of_loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.seated import answers_of
from siren_ros.scoring.evaluation.yielding.encounters import lane_offsets
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.map_formats import mirrored_net
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.actors import Event, EventKind, Lights

BODIES_M = 0.5 * (EMV_LENGTH_M + CAR_LENGTH_M)
TO_THE_EDGE = line((5.25, -120.0), (5.25, -80.0), (8.25, -60.0), (8.25, 110.0))
"""From 40 to 60 m, 3 m to the right; the road's right edge, that of the shoulder, is at 9.5 m."""
CAR_WIDTH_M = 1.8


def examinee(car, emv=None, siren=True, record=None):
    return Examinee(
        record or record_of(arc((10.0, 20.0)) if emv is None else emv, {CAR: car}, siren=siren), CAR, 40.0, 3.0
    )


def found(monitor, driver, **numbers):
    """What the monitor finds, which is the same where traffic keeps left."""
    find = getattr(monitors, monitor, None) or getattr(rules, monitor)
    image = Examinee(driver.record.mirrored(), driver.actor.actor_id, 40.0, 3.0)
    one, mirrored = (find(each, numbers) for each in (driver, image))
    assert (mirrored.step, mirrored.about) == (one.step, one.about)
    assert mirrored.measure.value == pytest.approx(one.measure.value, abs=1e-6, nan_ok=True)
    return one


def sounding(record, *emvs):
    """The record with the sirens of the EMVs on."""

    def siren(state):
        lights = state.lights.copy()
        lights[np.isin(state.actor_id, emvs or (EMV,))] |= int(Lights.SIREN)
        return lights

    return with_states(record, lights=siren)


STOPS_ASIDE = Driven(TO_THE_EDGE, arc((5.0, 6.0), (0.0, 14.0), start_m=36.0))
"""Drives at 5 m/s from 36 m on, stands at 66 m beyond its 3 m to the side; the EMV's front is there at about 6 s."""
STAYS = Driven(IN_LANE, arc((0.0, 20.0), start_m=50.0))


def test_an_emv_calls_from_where_it_is_heard_until_it_has_passed():
    driver = examinee(STOPS_ASIDE)
    (call,) = driver.calls
    # The car's centre is ahead by 36 m less 5 m/s times the time; then it stands.
    begin = 0
    assert call.calls[begin]
    last = int(np.flatnonzero(call.calls)[-1])
    ahead_m = driver.track.y_m[last] + 120.0 - 10.0 * driver.track.time_s[last]
    assert ahead_m == pytest.approx(-BODIES_M, abs=0.6)
    assert call.passed[last + 1 :].all()
    assert not call.passed[: last + 1].any()


def test_without_a_siren_nobody_is_asked_and_emvs_never():
    driver = examinee(STAYS, siren=False)
    assert driver.calls == ()
    for name in ("response", "obstruction", "right_edge", "stands_in_junction", "wrong_side", "following"):
        numbers = dict.fromkeys(monitors.MONITORS[name].numbers, 1.0)
        assert not monitors.MONITORS[name].find(driver, numbers).measure.valid, name
    record = record_of(arc((10.0, 5.0)), {CAR: STAYS})
    for actor_id in (EMV, 99):
        with pytest.raises(InputError, match="civilian vehicle"):
            Examinee(record, actor_id, 40.0, 3.0)


def test_the_distance_from_the_right_edge_is_that_as_the_emv_passes():
    aside, kept = (
        found("right_edge", examinee(STOPS_ASIDE), move_s=1.0),
        found("right_edge", examinee(Driven(IN_LANE, STOPS_ASIDE.arc_m)), move_s=1.0),
    )
    assert aside.measure.value == pytest.approx(9.5 - 8.25 - 0.5 * CAR_WIDTH_M, abs=0.05)
    assert kept.measure.value == pytest.approx(9.5 - RIGHT_X_M - 0.5 * CAR_WIDTH_M, abs=0.05)


@pytest.mark.parametrize(("free_m", "counts"), [(3.0, False), (20.0, True)])
def test_a_queue_at_walking_pace_hems_a_driver_in(free_m, counts):
    beside = line((1.75, -120.0), (1.75, 110.0))
    drives = arc((1.0, 20.0), start_m=50.0)
    ahead = Driven(IN_LANE, arc((1.0, 20.0), start_m=50.0 + CAR_LENGTH_M + free_m))
    record = hand_made(crossing(), {EMV: Driven(beside, arc((5.0, 20.0))), CAR: Driven(IN_LANE, drives), 3: ahead})
    assert found("right_edge", examinee(None, record=sounding(record)), move_s=1.0).measure.valid is counts


def test_a_driver_that_still_goes_to_the_edge_as_the_emv_passes_does_its_part():
    goes = line((5.25, -120.0), (5.25, -70.0), (7.25, -30.0), (7.25, 110.0))  # 5 cm in a metre, from 50 to 90 m
    record = hand_made(
        crossing(),
        {
            EMV: Driven(line((1.75, -120.0), (1.75, 110.0)), arc((10.0, 10.0))),
            CAR: Driven(goes, arc((3.0, 10.0), start_m=50.0)),
        },
    )
    driver = examinee(None, record=sounding(record))
    assert any(call.beside.any() for call in driver.calls)
    assert not found("right_edge", driver, move_s=1.0).measure.valid


def test_an_emv_that_stands_behind_a_driver_in_its_lane_is_held_up():
    for aside_m, held_s in ((0.0, 6.0), (3.0, 0.0), (-3.5, 0.0)):
        driver = examinee(Driven(IN_LANE + np.array([aside_m, 0.0]), STAYS.arc_m), arc((10.0, 4.0), (0.0, 6.0)))
        held = found("obstruction", driver, gap_m=10.0, slow_mps=2.0, left_line_m=0.5)
        assert held.measure.value == pytest.approx(held_s, abs=0.1)


def test_the_time_to_the_first_response():
    numbers = {"shift_m": 0.3, "slower_mps": 1.5, "aside_m": 3.0}
    assert not found("response", examinee(STAYS), **numbers).measure.valid
    # The EMV stops after 2 s, and falls back beyond 40 m: the car's front is 36 m ahead at first, and 5 m/s fast.
    keeps = Driven(IN_LANE, arc((5.0, 15.0), start_m=36.0))
    left_m = 40.0 - (36.0 - BODIES_M) + 2.0 * (10.0 - 5.0)
    once = found("response", examinee(keeps, arc((10.0, 2.0), (0.0, 13.0))), **numbers).measure.value
    assert once == pytest.approx(2.0 + left_m / 5.0, abs=0.1)


def test_a_driver_has_to_stand_while_the_emv_is_near():
    stands, drives = STOPS_ASIDE, Driven(TO_THE_EDGE, arc((5.0, 20.0), start_m=36.0))
    numbers = {"gap_m": 15.0, "stop_s": 1.0}
    assert found("stands_until_passed", examinee(stands), **numbers).measure.value == 0.0
    slow = Driven(TO_THE_EDGE, arc((5.0, 6.0), (1.0, 14.0), start_m=36.0))
    emv = arc((10.0, 4.0), (2.0, 20.0))
    assert found("stands_until_passed", examinee(stands, emv), gap_m=15.0, stop_s=4.0).measure.value < 0.1
    creeping = found("stands_until_passed", examinee(slow, emv), gap_m=15.0, stop_s=4.0)
    assert creeping.measure.value == pytest.approx(1.0, abs=0.1)
    assert found("stands_until_passed", examinee(drives), **numbers).measure.value == pytest.approx(5.0, abs=0.1)
    numbers = {"gap_m": 91.4, "aside_m": 6.0, "faster_mps": 3.0}
    assert found("following", examinee(STOPS_ASIDE), **numbers).measure.value == 0.0


@pytest.mark.parametrize(
    ("shown", "missed"), [(Lights.INDICATOR_RIGHT, 0.0), (Lights.NONE, 1.0), (Lights.INDICATOR_LEFT, 1.0)]
)
def test_a_move_to_the_side_needs_the_indicator_of_that_side(shown, missed):
    record = record_of(arc((10.0, 20.0)), {CAR: STOPS_ASIDE})

    def lit(state):
        lights = state.lights.copy()
        lights[state.actor_id == CAR] |= int(shown)
        return lights

    driver = examinee(STOPS_ASIDE, record=with_states(record, lights=lit))
    numbers = {"least_m": 1.0, "least_mps": 0.2, "before_s": 5.0, "late_s": 0.5}
    assert found("without_indicator", driver, **numbers).measure.value == missed
    kept = examinee(Driven(IN_LANE, STOPS_ASIDE.arc_m))
    assert not found("without_indicator", kept, **numbers).measure.valid


def test_the_wrong_side_depends_on_the_lane_where_the_rulebook_says_so():
    right = examinee(STOPS_ASIDE)
    assert found("wrong_side", right, by_lane=0.0).measure.value < 0.05
    # The same move from the leftmost lane: 3 m to the right of it.
    left_lane = Driven(TO_THE_EDGE - np.array([3.5, 0.0]), STOPS_ASIDE.arc_m)
    emv = Driven(line((1.75, -120.0), (1.75, 110.0)), arc((10.0, 3.0), (5.0, 17.0)))
    record = sounding(hand_made(crossing(), {EMV: emv, CAR: left_lane}))
    driver = examinee(left_lane, record=record)
    assert found("wrong_side", driver, by_lane=0.0).measure.value < 0.05
    assert not found("wrong_side", driver, by_lane=1.0).measure.valid  # in a town no rescue lane is opened
    lanes = tuple(replace(lane, speed_limit_mps=27.8) for lane in record.network.lanes)
    fast = examinee(left_lane, record=replace(record, network=replace(record.network, lanes=lanes)))
    assert found("wrong_side", fast, by_lane=1.0).measure.value == pytest.approx(3.0, abs=0.1)
    # One that has stood 1 m to the right of its lane's middle before the EMV came.
    stood = Driven(line((2.75, -120.0), (2.75, 110.0)), arc((0.0, 20.0), start_m=66.0))
    record = sounding(hand_made(fast.record.network, {EMV: emv, CAR: stood}))
    assert found("wrong_side", examinee(stood, record=record), by_lane=1.0).measure.value == pytest.approx(1.0, abs=0.1)
    assert found("wrong_side", examinee(stood, record=record), by_lane=0.0).measure.value == 0.0


def test_to_go_back_into_the_lane_is_no_move_to_the_wrong_side():
    back = line((5.25, -120.0), (5.25, -80.0), (8.25, -60.0), (5.25, -40.0), (5.25, 110.0))
    beyond = line((5.25, -120.0), (5.25, -80.0), (8.25, -60.0), (3.25, -20.0), (3.25, 110.0))
    emv = arc((10.0, 3.0), (3.0, 17.0))
    for path, moved_m in ((back, 0.0), (beyond, 2.0)):
        driver = examinee(Driven(path, arc((5.0, 20.0), start_m=36.0)), emv)
        assert found("wrong_side", driver, by_lane=0.0).measure.value == pytest.approx(moved_m, abs=0.1)


def test_the_hardest_contact_tells_with_whom_whoever_touched_whom():
    record = record_of(arc((10.0, 20.0)), {CAR: STAYS})
    assert found("contact", examinee(STAYS, record=record)).measure.value < 0.0
    for step in (9, 11):
        hits = [
            Event(at, EventKind.COLLISION, *pair, detail={"impact_speed_mps": 2.5 if at == step else 1.5})
            for at, pair in ((7, (99, CAR)), (9, (CAR, EMV)), (11, (EMV, CAR)))
        ]
        for events in (tuple(hits), tuple(hits[::-1])):
            one = found("contact", examinee(STAYS, record=replace(record, events=events)))
            assert (one.measure.value, one.step, one.about) == (2.5, step, f"ambulance {EMV}")


def test_braking_has_to_last():
    record = record_of(arc((10.0, 20.0)), {CAR: STAYS})

    def braked(state):
        accel = np.zeros(len(state))
        accel[state.actor_id == CAR] = -8.0 if state.step in {5, 40, 41, 42, 43, 44, 45} else 0.0
        return accel

    driver = examinee(STAYS, record=with_states(record, accel_mps2=braked))
    longest = found("braking", driver, lasting_s=0.3)
    assert longest.measure.value == pytest.approx(8.0)
    assert longest.step == 40
    assert found("braking", driver, lasting_s=0.6).measure.value == pytest.approx(4.0)


def test_the_return_to_the_lane():
    back = line((5.25, -120.0), (5.25, -80.0), (8.25, -60.0), (8.25, -50.0), (5.25, -40.0), (5.25, 110.0))
    returns = Driven(back, arc((5.0, 6.0), (0.0, 4.0), (5.0, 10.0), start_m=36.0))
    numbers = {"offset_m": 0.6, "waits_s": 5.0, "near_m": 0.0}
    found_back = found("return_to_lane", examinee(returns, arc((10.0, 20.0))), **numbers).measure
    assert found_back.valid
    assert 0.5 < found_back.value < 8.0
    never = found("return_to_lane", examinee(STOPS_ASIDE), **numbers).measure
    assert never.at_least
    assert never.value > 5.0
    assert not found("return_to_lane", examinee(STOPS_ASIDE), offset_m=0.6, waits_s=30.0, near_m=0.0).measure.valid
    off_the_middle = line((5.25, -120.0), (5.25, -80.0), (6.45, -60.0), (6.45, 110.0))
    for ahead_m, counts in ((6.0, False), (16.0, True)):  # it stands at -54 m, somebody else 2 m or 12 m ahead
        other = Driven(line((6.45, -54.0 + ahead_m), (6.45, 0.0)), arc((0.0, 20.0)))
        cars = {CAR: replace(STOPS_ASIDE, points=off_the_middle), 3: other}
        wedged = examinee(None, record=record_of(arc((10.0, 20.0)), cars, siren=True))
        assert found("return_to_lane", wedged, **numbers).measure.valid is counts
    # It stands 66 m on the way. An EMV that stands 20 m ahead of it keeps it there, one that is 60 m ahead does not.
    for way_m, counts in ((86.0, False), (126.0, True)):
        waits = examinee(STOPS_ASIDE, arc((10.0, way_m / 10.0), (0.0, 20.0 - way_m / 10.0)))
        assert found("return_to_lane", waits, **numbers).measure.valid is counts


def test_time_on_the_shoulder():
    town = examinee(STOPS_ASIDE).record
    assert found("on_shoulder", examinee(STOPS_ASIDE)).measure.value == 0.0  # in a town it is the edge of the road
    lanes = tuple(replace(lane, speed_limit_mps=27.8) for lane in town.network.lanes)
    motorway = replace(town, network=replace(town.network, lanes=lanes))
    assert found("on_shoulder", examinee(STOPS_ASIDE, record=motorway)).measure.value > 10.0
    assert found("on_shoulder", examinee(STAYS)).measure.value == 0.0
    shoulder_and_one = tuple(
        lane if lane.kind is not LaneKind.DRIVING or lane.position == 1 else replace(lane, kind=LaneKind.CYCLE)
        for lane in lanes
    )
    country_road = replace(town, network=replace(town.network, lanes=shoulder_and_one))
    assert found("on_shoulder", examinee(STOPS_ASIDE, record=country_road)).measure.value == 0.0


def two_emvs(driven, car):
    """A car before two EMVs."""
    record = hand_made(crossing(), {**driven, CAR: car})
    actors = {one: replace(actor, is_emv=one in driven) for one, actor in record.actors.items()}
    described = replace(record.description, emv_ids=tuple(driven))
    return sounding(replace(record, actors=actors, description=described), *driven)


def test_a_driver_who_goes_back_into_the_way():
    out_and_in = line((5.25, -120.0), (8.25, -110.0), (8.25, -80.0), (5.25, -70.0), (5.25, 110.0))
    returns = Driven(out_and_in, arc((5.0, 8.0), (0.0, 8.0), start_m=20.0))
    emv = arc((4.0, 4.0), (3.0, 12.0))
    assert found("back_in_the_way", examinee(returns, emv), margin_m=0.1, moved_m=0.5).measure.value > 2.0
    assert found("back_in_the_way", examinee(STAYS, emv), margin_m=0.1, moved_m=0.5).measure.value == 0.0
    # It had left the lane before this EMV was heard, for one that is far ahead now.
    emvs = {EMV: Driven(IN_LANE, arc((14.0, 14.0))), 3: Driven(IN_LANE, arc((4.0, 14.0), start_m=-30.0))}
    early = line((5.25, -120.0), (5.25, -100.0), (8.25, -90.0), (8.25, -80.0), (5.25, -70.0), (5.25, 110.0))
    leaves = Driven(early, arc((5.0, 3.0), (0.0, 4.0), (4.0, 7.0), start_m=20.0))
    driver = examinee(None, record=two_emvs(emvs, leaves))
    assert found("back_in_the_way", driver, margin_m=0.1, moved_m=0.5).measure.value > 2.0
    # The EMV is beside the lane at first, and comes into it.
    swings = line((2.0, -120.0), (2.0, -115.0), (5.25, -105.0), (5.25, 110.0))
    swung = sounding(hand_made(crossing(), {EMV: Driven(swings, emv), CAR: STAYS}))
    assert found("back_in_the_way", examinee(STAYS, record=swung), margin_m=0.1, moved_m=0.5).measure.value == 0.0
    assert found("back_in_the_way", examinee(STAYS, record=swung), margin_m=0.1, moved_m=-1.0).measure.value > 2.0


def test_the_way_driven_between_two_emvs():
    second = 3
    emvs = {EMV: Driven(IN_LANE, arc((10.0, 20.0))), second: Driven(IN_LANE, arc((10.0, 20.0), start_m=-60.0))}
    leaves = Driven(TO_THE_EDGE, arc((5.0, 6.0), (0.0, 2.0), (1.0, 6.0), (0.0, 6.0), start_m=36.0))
    waits = STOPS_ASIDE

    left, stood = (
        found("moves_off_before_the_last", examinee(leaves, record=two_emvs(emvs, leaves))),
        found("moves_off_before_the_last", examinee(waits, record=two_emvs(emvs, waits))),
    )
    assert left.measure.value > 2.0
    assert stood.measure.value == 0.0
    assert not found("moves_off_before_the_last", examinee(waits)).measure.valid


def test_the_corridor_has_to_be_open_at_walking_pace_out_of_town():
    network = crossing()
    fast = replace(network, lanes=tuple(replace(lane, speed_limit_mps=30.0) for lane in network.lanes))
    numbers = {"width_m": 2.6, "pace_mps": 2.8, "settle_s": 2.0}

    def share(x_m, roads):
        car = Driven(line((x_m, -120.0), (x_m, 110.0)), arc((1.0, 10.0), start_m=40.0))
        record = hand_made(roads, {EMV: Driven(IN_LANE, arc((1.0, 10.0))), CAR: car})
        return found("closed_corridor", Examinee(record, CAR, 40.0, 3.0), **numbers).measure

    # The line between the two lanes is at 3.5 m, half the corridor 1.3 m, half the car 0.9 m.
    assert share(3.5 + 2.25, fast).value == 0.0
    assert share(3.5 + 2.15, fast).value == 1.0
    assert share(3.5 - 2.25, fast).value == 0.0
    assert not share(3.5 + 2.15, network).valid


def test_how_far_a_driver_goes_beyond_a_red_line():
    # The line is 100 m from the start; the event is of the lane below the centre.
    car = Driven(IN_LANE, arc((2.0, 10.0), (0.0, 5.0), start_m=90.0))
    crossed = Event(101, EventKind.STOP_LINE_CROSSED, CAR, detail={"junction": "J", "direction": "s"})

    def way(signal):
        record = hand_made(crossing(), {EMV: Driven(IN_LANE, arc((1.0, 15.0))), CAR: car}, signal)
        return found("beyond_red_line", Examinee(replace(record, events=(crossed,)), CAR, 40.0, 3.0)).measure

    red, green = "r" * 7, "G" * 7
    assert way(lambda _: red).value == pytest.approx(2.0 * (10.0 - 101 * 0.05), abs=0.1)
    assert way(lambda step: red if step < 121 else green).value == pytest.approx(2.0, abs=0.1)
    assert way(lambda _: green).value == 0.0


def test_safety_measures_are_those_of_the_driver():
    # The car drives at 10 m/s towards one that stands 60 m ahead, and stops in it after 6 s less the bodies.
    car, other = Driven(IN_LANE, arc((10.0, 4.0), (0.0, 2.0))), Driven(IN_LANE, arc((0.0, 6.0), start_m=60.0))
    record = hand_made(crossing(), {EMV: Driven(IN_LANE - np.array([40.0, 0.0]), arc((1.0, 6.0))), CAR: car, 3: other})
    driver = Examinee(record, CAR, 40.0, 3.0)
    least = found("time_to_collision", driver).measure
    assert least.value == pytest.approx((60.0 - 40.0 - CAR_LENGTH_M) / 10.0, abs=0.06)
    assert not found("encroachment", driver).measure.valid
    # The other one answers for itself, unless it moves to the side before the faster one.
    behind = Examinee(record, 3, 40.0, 3.0)
    assert not found("time_to_collision", behind).measure.valid
    swerves = line((8.25, -120.0), (8.25, -65.0), (5.25, -55.0), (5.25, 110.0))
    cuts_in, faster = Driven(swerves, arc((2.0, 6.0), start_m=54.0)), Driven(IN_LANE, arc((10.0, 6.0), start_m=40.0))
    emv = Driven(IN_LANE - np.array([40.0, 0.0]), arc((1.0, 6.0)))
    record = hand_made(crossing(), {EMV: emv, CAR: cuts_in, 3: faster})
    assert found("time_to_collision", Examinee(record, CAR, 40.0, 3.0)).measure.value < 1.0
    # One that makes way to the right does not answer for an EMV on its left that points at it.
    makes_way = Driven(line((5.25, -120.0), (5.25, -66.0), (5.75, -56.0), (5.75, 110.0)), arc((4.0, 6.0), start_m=54.0))
    points = Driven(line((1.75, -120.0), (1.75, -69.0), (2.9, -65.7), (2.9, 110.0)), arc((4.0, 6.0), start_m=50.0))
    record = hand_made(crossing(), {EMV: points, CAR: makes_way})
    assert not found("time_to_collision", Examinee(record, CAR, 40.0, 3.0)).measure.valid
    # One that stands answers for nobody who comes towards it.
    comes = Driven(line((5.25, 110.0), (5.25, -120.0)), arc((5.0, 6.0), start_m=150.0))
    record = hand_made(crossing(), {EMV: emv, CAR: Driven(IN_LANE, arc((0.0, 6.0), start_m=50.0)), 3: comes})
    assert not found("time_to_collision", Examinee(record, CAR, 40.0, 3.0)).measure.valid


BESIDE = 3
"""A car on the right of the driver's lane, up to 0.7 m from the driver."""


LEFT_LANE = line((1.75, -120.0), (1.75, 110.0))


def among(beside_m, emv=None, left_lane=LEFT_LANE):
    """A driver who stays in the left lane at 50 m, and another one in the right lane, so far ahead of it."""
    return sounding(
        hand_made(
            crossing(),
            {
                EMV: Driven(left_lane, arc((10.0, 20.0)) if emv is None else emv),
                CAR: Driven(left_lane, arc((0.0, 20.0), start_m=50.0)),
                BESIDE: Driven(line((5.25, -120.0), (5.25, 110.0)), arc((0.0, 20.0), start_m=50.0 + beside_m)),
            },
        )
    )


def test_whoever_is_beside_a_driver_limits_its_room():
    boxed, alone = (examinee(None, record=among(beside_m)) for beside_m in (2.0, 40.0))
    assert boxed.room.right_m[20] == pytest.approx(3.5 - CAR_WIDTH_M)
    own = Driven(line((1.75, -120.0), (1.75, 110.0)), arc((5.0, 8.0)))
    moving = hand_made(crossing(), {CAR: own, EMV: Driven(line((-1.75, 110.0), (-1.75, 0.0)), arc((1.0, 8.0)))})
    room = Examinee(moving, CAR, 40.0, 3.0).room
    assert room.right_m[40] == pytest.approx(9.5 - 1.75 - 0.5 * CAR_WIDTH_M, abs=0.05)
    assert room.ahead_m[40] == pytest.approx(100.0 - 5.0 * 2.0 - 0.5 * CAR_LENGTH_M, abs=0.3)
    assert alone.room.right_m[20] > 5.0


@pytest.mark.parametrize(("left_line_m", "counts"), [(0.5, False), (0.2, True), (-1.0, True)])
def test_at_the_left_line_a_driver_has_done_its_part_where_the_rulebook_says_so(left_line_m, counts):
    emv = arc((10.0, 4.0), (0.0, 12.0))
    aside = line((1.75 - 0.45, -120.0), (1.75 - 0.45, 110.0))  # 0.4 m between its side and the line
    driver = examinee(None, record=among(40.0, emv, left_lane=aside))
    held = found("obstruction", driver, gap_m=10.0, slow_mps=2.0, left_line_m=left_line_m).measure.value
    assert (held > 8.0) is counts


def test_to_slow_down_behind_somebody_is_no_response():
    numbers = {"shift_m": 0.3, "slower_mps": 1.5, "aside_m": 3.0}
    slows = arc((5.0, 1.0), (2.0, 8.0), start_m=36.0)
    ahead = Driven(IN_LANE, arc((5.0, 0.8), (2.0, 8.2), start_m=46.0))
    record = record_of(arc((10.0, 9.0)), {CAR: Driven(IN_LANE, slows), BESIDE: ahead})
    by_itself = found("response", examinee(Driven(IN_LANE, slows), arc((10.0, 9.0))), **numbers)
    behind = found("response", Examinee(record, CAR, 40.0, 3.0), **numbers)
    assert by_itself.measure.value == pytest.approx(1.0, abs=0.1)
    assert behind.measure.value > 4.0


def test_the_lawful_side_is_the_left_one(tmp_path):
    file = tmp_path / "left.net.xml"
    file.write_bytes(mirrored_net(compile_map(None).read_bytes()))
    setup = set_up_episode(EpisodeRequest("S2", "L2", 0, str(file), sensors="none", av="civilian"))
    loop = closed_loop(setup, steps_from_s(16.0))  # the EMV has passed the driver
    steps = [step for step, _ in driven(loop, answers_of(setup, driver_of("lawful-california")))]
    record, av_id = record_of_loop(setup, steps), setup.description.av_id
    assert record.network.left_hand
    marks = {mark.clause.clause_id: mark.grade for mark in examine(record, av_id, load_rulebook("california")).marks}
    assert not {Grade.MINOR, Grade.MAJOR} & set(marks.values())
    assert marks["right_edge"] is Grade.PASS  # of the mirror image
    lateral_m = lane_offsets(record, record.track(av_id)).lateral_m
    assert lateral_m[np.argmax(np.abs(lateral_m))] > 0.0  # left is positive
