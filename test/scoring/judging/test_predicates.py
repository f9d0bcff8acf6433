"""Predicates, and what their verdicts say; the junction that an EMV crosses.

Predicates, checks and measures find the same in a turned record, and in its mirror image where traffic keeps left.
"""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import (
    EASTBOUND,
    EMV,
    LEFT_X_M,
    NORTHBOUND,
    ON_SHOULDER,
    RIGHT_X_M,
    Driven,
    at_speed,
    crossing,
    hand_made,
    line,
)
from recorded_episode import quick_template
from synthetic_episode import rotate

from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.closed_loop import record_of as record_of_loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.scoring.judging.corridor_templates import queues_split
from siren_ros.scoring.judging.junction_templates import (
    red_crossing,
    red_same_direction,
    shoulder_turn,
    stop_crossing,
)
from siren_ros.scoring.judging.lane_clearance import lane_cleared
from siren_ros.scoring.judging.outcome import (
    PREDICATES,
    av_response,
    evaluate_predicate,
    longest_standstill,
    predicate_of,
    under_way,
    verdicts_of_others,
)
from siren_ros.scoring.judging.verdict import (
    Moment,
    Part,
    at_least,
    at_most,
    closest_of,
    equals,
    first_reaching,
    more_than,
    verdict_of,
    with_sides_exchanged,
)
from siren_ros.scoring.judging.verify import VerifyLimits, check_states, summarise_physics
from siren_ros.simulation.roads.road_network import JunctionKind, RoadNetwork
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.scenario import DECLARED_PREDICATES
from siren_ros.simulation.scenario.templates import available_templates, load_template
from siren_ros.simulation.world.actors import Mode


def test_templates_may_name_exactly_the_predicates_that_exist():
    assert set(PREDICATES) == set(DECLARED_PREDICATES)


@pytest.mark.parametrize("name", sorted(PREDICATES))
def test_the_declared_thresholds_are_all_that_a_predicate_needs(name, record_of):
    thresholds = {key: low for key, (low, _) in DECLARED_PREDICATES[name].thresholds.items()}
    parameters = {"predicate": {"name": name, "thresholds": thresholds}}
    record = record_of(duration_s=1.0)
    verdict = evaluate_predicate(replace(record, description=replace(record.description, parameters=parameters)))
    assert not verdict.holds
    assert verdict.text
    assert verdicts_of_others(record) == {}, "there is one EMV"


@pytest.mark.parametrize("template", available_templates())
def test_every_templates_predicate_can_be_evaluated_on_its_episode(template):
    quick = template if template == "S8" else quick_template(template)  # the motorway has no district
    setup = set_up_episode(EpisodeRequest(template=quick, sensors="none"))
    record = record_of_loop(setup, list(closed_loop(setup, 20)))
    name, thresholds = predicate_of(record)
    assert name == load_template(template).predicate.name
    verdict = evaluate_predicate(record)
    assert verdict.text
    assert all(np.isfinite(part.value) for part in verdict.parts)
    elsewhere = {thresholds.get(name) for name in ("lateral_max_m", "ahead_m", "side_m")}
    assert {*thresholds.values()} - {part.threshold for part in verdict.parts} <= elsewhere


def several(second: Driven, third: Driven | None = None, **parameters: object) -> EpisodeRecord:
    """The first EMV runs the red light while a civilian crosses; others may be EMVs as well."""
    vehicles = {
        EMV: Driven(NORTHBOUND, at_speed(60.0, 10.0, 200)),
        2: second,
        9: Driven(EASTBOUND, at_speed(60.0, 9.0, 200)),
    }
    if third is not None:
        vehicles[3] = third
    record = hand_made(crossing(), vehicles, signal=lambda _: "r" * 40)
    actors = {key: replace(actor, is_emv=key != 9) for key, actor in record.actors.items()}
    told = {"predicate": {"name": "red_crossing", "thresholds": {}}, **parameters}
    emv_ids = tuple(key for key in actors if key != 9)
    return replace(record, actors=actors, description=replace(record.description, emv_ids=emv_ids, parameters=told))


def test_the_interaction_happens_to_the_first_emv_and_every_other_one_has_a_verdict_of_its_own():
    """The second EMV stops before the line."""
    behind = several(Driven(NORTHBOUND, np.full(200, 40.0)))
    assert evaluate_predicate(behind).holds
    assert {emv_id: verdict.holds for emv_id, verdict in verdicts_of_others(behind).items()} == {2: False}
    swapped = replace(behind, description=replace(behind.description, emv_ids=(2, EMV)))
    assert not evaluate_predicate(swapped).holds
    assert {emv_id: verdict.holds for emv_id, verdict in verdicts_of_others(swapped).items()} == {EMV: True}


@pytest.mark.parametrize(("speed_mps", "passes"), [(20.0, True), (9.0, False), (0.0, False)])
def test_an_emv_that_crosses_has_to_pass_its_junction(speed_mps, passes):
    """At 9 m/s it is still inside at the end of the 10 s."""
    across = {"crossing": {"junction": "J", "emv_ids": [2]}}
    record = several(Driven(EASTBOUND, at_speed(20.0, speed_mps, 200)), **across)
    verdict = evaluate_predicate(record)
    assert verdict.holds is passes
    names = ["against_red", "crossing_inside", "through", "standstill_s", "crossing_emv_2"]
    assert [part.name for part in verdict.parts] == names
    assert f"EMV 2 {'passed' if passes else 'did not pass'} junction J" in verdict.text
    (other,) = verdicts_of_others(record).values()
    assert (other.holds, len(other.parts)) == (passes, 1)
    assert [moment.actor_id for moment in other.parts[0].moments] == [2] * passes
    elsewhere = several(Driven(EASTBOUND, at_speed(20.0, 10.0, 200)), crossing={"junction": "K", "emv_ids": [2]})
    assert not evaluate_predicate(elsewhere).holds


@pytest.mark.parametrize(("stands_s", "most_s", "holds"), [(14.9, None, True), (15.1, None, False), (15.1, 20.0, True)])
def test_an_emv_that_stands_too_long_does_not_get_through(stands_s, most_s, holds):
    """It rolls at 0.2 m/s before the line, then passes it at red with somebody on the way across."""
    arc_m = 90.0 + np.cumsum(np.concatenate((np.full(round(stands_s / 0.05), 0.2), np.full(200, 10.0)))) * 0.05
    vehicles = {EMV: Driven(NORTHBOUND, arc_m), 9: Driven(EASTBOUND, arc_m)}
    record = hand_made(crossing(), vehicles, signal=lambda _: "r" * 40)
    thresholds = {} if most_s is None else {"standstill_max_s": most_s}
    told = {"predicate": {"name": "red_crossing", "thresholds": thresholds}}
    verdict = evaluate_predicate(replace(record, description=replace(record.description, parameters=told)))
    assert [part.name for part in verdict.failing] == ([] if holds else ["standstill_s"])
    assert verdict.parts[-1].value == pytest.approx(stands_s, abs=0.06)
    (begin,) = evaluate_predicate(replace(record, states=record.states[20:])).parts[-1].moments
    assert begin.step == 20, "the EMV comes later than the record begins"


@pytest.mark.parametrize(("end_m", "stands_s"), [(226.0, 0.0), (180.0, 20.0)])
def test_an_emv_that_stands_where_the_map_ends_has_arrived(end_m, stands_s):
    """In the middle of the road it stands in somebody's way; at the end there is no way on."""
    arc_m = np.minimum(90.0 + 0.5 * np.arange(400 + round(2.0 * (end_m - 90.0))), end_m)
    record = hand_made(crossing(), {EMV: Driven(NORTHBOUND, arc_m)})
    assert longest_standstill(under_way(record, EMV).speed_mps)[0] == pytest.approx(stands_s, abs=0.11)
    assert longest_standstill(record.track(EMV).speed_mps)[0] == pytest.approx(20.0, abs=0.11)


@pytest.mark.parametrize(
    ("make", "holds", "relation"),
    [
        (at_least, (False, True, True), ">="),
        (more_than, (False, False, True), ">"),
        (at_most, (True, True, False), "<="),
        (equals, (False, True, False), "="),
    ],
)
def test_conditions_hold_on_their_side_of_the_threshold(make, holds, relation):
    parts = [make("way_m", value, 2.5) for value in (2.4, 2.5, 2.6)]
    assert tuple(part.holds for part in parts) == holds
    assert {part.relation for part in parts} == {relation}
    assert not make("way_m", float("nan"), 2.5).holds


def test_a_verdict_holds_where_all_of_its_parts_do():
    good, bad = at_least("a", 3.0, 1.0), at_least("b", 0.5, 1.0)
    assert verdict_of((good,), "text").holds
    verdict = verdict_of((good, bad), "text")
    assert (verdict.holds, verdict.failing, verdict.text) == (False, (bad,), "text")
    assert verdict.measures() == {"a": 3.0, "b": 0.5}


def test_the_closest_verdict_has_the_most_parts_and_then_the_largest_values():
    whole, none, nearly, first, second = (
        verdict_of(tuple(at_least(f"part{number}", value, 1.0) for number, value in enumerate(values)), "")
        for values in ((1, 1), (0, 0), (0.9, 0.9), (1, 0), (0, 9))
    )
    assert closest_of([none, second, whole, first]) is whole
    assert closest_of([none, second, first]) is first
    assert closest_of([nearly, second]) is second
    assert closest_of([]) is None


MOMENTS = tuple(Moment(10 * number, number) for number in (1, 2, 3))


@pytest.mark.parametrize(
    ("step", "parts"),
    [
        (10, [(at_least, 0), (equals, 0), (at_most, 0)]),
        (20, [(at_least, 2), (at_least, 1.5), (more_than, 1.2), (at_most, 1)]),
        (30, [(at_least, 3), (at_least, 4), (at_most, np.inf)]),
    ],
)
def test_the_decisive_moment_fulfils_or_breaks_a_count(step, parts):
    for make, threshold in parts:
        assert make("n", 3, threshold, "", *MOMENTS).decisive.step == step
        assert make("way_m", 120.0, 100.0, "", MOMENTS[1]).decisive is MOMENTS[1]
        assert make("way_m", 120.0, 100.0).decisive is None


def test_a_threshold_is_reached_at_the_first_step_with_its_value():
    steps = np.array([4, 5, 6, 7])
    assert first_reaching(steps, 3, [0.0, 1.0, 0.5, 2.0], 1.0) == (Moment(5, 3),)
    assert first_reaching(steps, 3, [0.0, 1.0, 0.5, 2.0], 2.1) == ()


ANGLES = np.radians([33.0, 118.0, -76.0])
SHIFT = np.array([12.0, -7.0])


def turned(record, angle):
    network = record.network
    lanes = tuple(
        replace(lane, centre=Polyline.through(rotate(lane.centre.points, angle) + SHIFT)) for lane in network.lanes
    )

    def state_of(state):
        x, y = (rotate(np.stack((state.x_m, state.y_m), axis=-1), angle) + SHIFT).T
        vx, vy = rotate(np.stack((state.vx_mps, state.vy_mps), axis=-1), angle).T
        return replace(state, x_m=x, y_m=y, vx_mps=vx, vy_mps=vy, yaw_rad=wrap_angle(state.yaw_rad + angle))

    return replace(
        record,
        network=RoadNetwork(lanes, network.edges, network.connections, network.junctions, (0.0, 0.0), "!"),
        states=tuple(state_of(state) for state in record.states),
    )


def queues():
    mode = np.where(np.arange(300) < 40, Mode.YIELD_PULL_OVER, Mode.YIELD_HOLD).astype(np.uint8)
    vehicles = {EMV: Driven(line((3.7, -120.0), (3.7, 110.0)), at_speed(5.12, 7.0, 300))}
    for first, x in ((10, LEFT_X_M - 0.7), (20, RIGHT_X_M + 0.7)):
        for number in range(3):
            vehicles[first + number] = Driven(line((x, -120.0), (x, -20.0)), np.full(300, 30.0 + 8.0 * number), mode)
    record = hand_made(crossing(), vehicles)
    return replace(record, description=replace(record.description, site={"stretch": ["s_in"]}))


def at_junction(kind=JunctionKind.SIGNAL):
    vehicles = {
        EMV: Driven(NORTHBOUND, at_speed(60.0, 10.0, 180)),
        2: Driven(EASTBOUND, at_speed(75.0, 8.0, 180)),
        3: Driven(line((LEFT_X_M, -120.0), (LEFT_X_M, 110.0)), at_speed(80.0, 8.0, 180)),
    }
    return hand_made(crossing(kind), vehicles, lambda _: "rrrrGrr")


def on_shoulder():
    return hand_made(crossing(), {EMV: Driven(ON_SHOULDER, at_speed(40.0, 8.0, 300))})


def measures_of(verdict):
    return {name: pytest.approx(value, abs=0.06) for name, value in verdict.measures().items()}


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize(
    ("record", "predicate", "thresholds"),
    [
        (queues(), queues_split, {"holding_min": 6, "overtaken_min": 6, "lateral_max_m": 1.0}),
        (at_junction(), red_same_direction, {}),
        (at_junction(), red_crossing, {}),
        (at_junction(JunctionKind.PRIORITY_STOP), stop_crossing, {"speed_min_mps": 1.0}),
        (on_shoulder(), shoulder_turn, {"shoulder_min_s": 2.0}),
    ],
    ids=["S1", "S3", "S4", "S6", "S7"],
)
def test_a_predicate_finds_the_same_in_a_turned_record(record, predicate, thresholds, angle):
    plain, other = predicate(record, thresholds), predicate(turned(record, angle), thresholds)
    assert plain.holds
    assert other.holds
    assert other.measures() == measures_of(plain)


def test_lane_changes_checks_and_numbers_are_the_same_in_a_turned_record(record_of):
    record = record_of(duration_s=9.0)
    other = turned(record, ANGLES[1])
    thresholds = {"lane_changes_min": 3, "passed_min": 3}
    assert lane_cleared(other, thresholds).measures() == lane_cleared(record, thresholds).measures()
    values, expected = ([part.value for part in check_states(either, VerifyLimits())] for either in (other, record))
    assert values == pytest.approx(expected, abs=1e-6)
    assert vars(summarise_physics(other)) == pytest.approx(vars(summarise_physics(record)), abs=1e-6)
    parameters = {**record.description.parameters, "av": {"actor_id": 2, "sensors": "none"}}
    description = replace(record.description, parameters=parameters)
    responses = [av_response(replace(either, description=description)) for either in (record, other)]
    # A step more or less: the two are exactly abreast at a step.
    assert vars(responses[1]) == pytest.approx(vars(responses[0]), abs=0.051)


def judged_by(record, name):
    thresholds = {key: low for key, (low, _) in DECLARED_PREDICATES[name].thresholds.items()}
    about = {"predicate": {"name": name, "thresholds": thresholds}}
    return replace(record, description=replace(record.description, parameters=about))


@pytest.mark.parametrize(
    ("record", "name"),
    [(queues(), "queues_split"), (at_junction(), "red_crossing"), (at_junction(), "red_same_direction")],
    ids=["S1", "S4", "S3"],
)
def test_verdicts_are_the_same(record, name):
    own = judged_by(record, name)
    verdict, image = evaluate_predicate(own), evaluate_predicate(own.mirrored())
    assert image.measures() == verdict.measures()
    assert image.holds is verdict.holds


def test_a_turn_to_the_left_on_the_shoulder_counts_where_traffic_keeps_left():
    way = np.arange(600) * 0.25
    record = hand_made(crossing(), {EMV: Driven(ON_SHOULDER, way)})
    verdict = evaluate_predicate(judged_by(record.mirrored(), "shoulder_turn"))
    assert verdict.holds
    assert "to the left" in verdict.text
    assert verdict.measures() == evaluate_predicate(judged_by(record, "shoulder_turn")).measures()


def test_words_for_sides_change_places_and_verbs_stay():
    part = Part("queue", 1.0, 1.0, True, ">=", "3 on the left, 2 on the right")
    verdict = with_sides_exchanged(verdict_of((part,), "6 civilians left the lane; the EMV turned right nowhere"))
    assert verdict.parts[0].detail == "3 on the right, 2 on the left"
    assert verdict.text == "6 civilians left the lane; the EMV turned left nowhere"


def test_the_avs_way_to_the_kerb_is_to_the_left():
    x_m = RIGHT_X_M
    aside = line((x_m, -120.0), (x_m, -86.0), (x_m + 2.0, -82.0), (x_m + 2.0, 110.0))
    vehicles = {
        EMV: Driven(line((3.5, -120.0), (3.5, 110.0)), at_speed(0.0, 10.0, 300)),
        2: Driven(aside, at_speed(30.0, 3.0, 300)),
    }
    record = hand_made(crossing(), vehicles)
    record = replace(record, description=replace(record.description, parameters={"av": {"actor_id": 2, "name": "v2"}}))
    assert av_response(record).moved_right_m > 0.5
    assert av_response(record.mirrored()) == av_response(record)
