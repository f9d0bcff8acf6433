"""The outcome of an episode, its people, and how vehicles treat them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from busy_record import busy_network, busy_record
from evaluation.made_records import Track, moving, record_with
from hand_made_record import (
    EMV,
    LEFT_X_M,
    NORTHBOUND,
    RIGHT_X_M,
    Driven,
    at_speed,
    crossing,
    hand_made,
    line,
    with_states,
)
from known_outputs import assert_known
from told_verdicts import told

from siren_ros.data.interfaces.conversions import EpisodeClosing
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EpisodeError
from siren_ros.scoring.judging.outcome import (
    AvResponse,
    PeopleOfClass,
    av_response,
    demand_measures,
    evaluate_predicate,
    judge,
    longest_standstill,
    outcome_of,
    people_measures,
    people_of,
    realisation_of,
)
from siren_ros.scoring.judging.verify import check_people, contacts_with_people, near_passes
from siren_ros.simulation.roads.road_network import JunctionKind
from siren_ros.simulation.scenario.episode import EpisodeEnd
from siren_ros.simulation.world.actors import ActorClass, Event, EventKind, Mode

AV = 2
BESIDE_NORTHBOUND = line((LEFT_X_M, -120.0), (LEFT_X_M, 110.0))
"""The lane to the left of the EMV's, 3.5 m away."""
SITE = {"junction": "J"}
CLOSING = EpisodeClosing(end="complete", reason="", steps=101)


def with_av(record: EpisodeRecord, actor_id: int = AV) -> EpisodeRecord:
    parameters = {**record.description.parameters, "av": {"actor_id": actor_id, "sensors": "none"}}
    return replace(record, description=replace(record.description, parameters=parameters))


def response_of(record: EpisodeRecord) -> AvResponse:
    response = av_response(record)
    assert response is not None
    return response


def test_an_av_that_is_never_there_together_with_the_emv_has_no_numbers():
    vehicles = {
        EMV: Driven(NORTHBOUND, at_speed(0.0, 10.0, 20)),
        AV: Driven(BESIDE_NORTHBOUND, np.full(20, 30.0), first_step=30),
    }
    assert response_of(with_av(hand_made(crossing(), vehicles))) == AvResponse(-1.0, -1.0, 0.0, 0.0, 0.0, 0)


def test_the_step_of_the_pass_itself_counts():
    """The AV brakes and moves aside at the very step at which the EMV's centre is ahead, and no longer after it."""
    record = with_av(
        hand_made(
            crossing(),
            {EMV: Driven(NORTHBOUND, at_speed(50.0, 10.0, 60)), AV: Driven(BESIDE_NORTHBOUND, np.full(60, 60.2))},
        )
    )
    passed = 21
    assert response_of(record).passed_after_s == pytest.approx(passed * 0.05)

    def at_step(step: int) -> AvResponse:
        changed = with_states(
            record,
            vy_mps=lambda state: np.where(state.actor_id == AV, 3.0 if state.step != step else 1.0, state.vy_mps),
            x_m=lambda state: np.where(state.actor_id == AV, state.x_m + 0.4 * (state.step == step), state.x_m),
        )
        return response_of(changed)

    for step, counts in ((passed - 1, True), (passed, True), (passed + 1, False)):
        response = at_step(step)
        expected = (2.0, 0.4) if counts else (0.0, 0.0)
        assert (response.speed_drop_mps, response.moved_right_m) == pytest.approx(expected)


def _at_junction(vehicles: dict[int, Driven]) -> EpisodeRecord:
    record = hand_made(crossing(), vehicles)
    return replace(record, description=replace(record.description, site=SITE))


def _standing_near(record: EpisodeRecord, steps: set[int]) -> EpisodeRecord:
    """Actor 2 stands at these steps alone; at all others it drives."""
    return with_states(
        record, lambda step: step not in steps, vx_mps=lambda state: np.where(state.actor_id == 2, 5.0, state.vx_mps)
    )


def test_the_queue_is_counted_three_seconds_before_the_arrival_to_the_step():
    """The EMV is at the junction's centre, 115 m along its way, at step 190; also in a record that begins later."""
    vehicles = {
        EMV: Driven(NORTHBOUND, at_speed(20.0, 10.0, 400)),
        2: Driven(line((4.0, -100.0), (4.0, 100.0)), np.full(400, 70.0)),
    }
    record = _at_junction(vehicles)
    counted = round(realisation_of(record).arrival_s / 0.05) - 60
    for steps, queue in (({counted}, 1), ({counted - 1, counted + 1}, 0)):
        changed = _standing_near(record, steps)
        assert realisation_of(changed).queue == queue
        late = replace(changed, states=changed.states[20:], traffic=changed.traffic[20:])
        assert realisation_of(late).queue == queue
        assert realisation_of(late).arrival_s == realisation_of(changed).arrival_s


def test_wherever_the_map_lies_the_conflict_point_is_the_junctions():
    plain = _at_junction({EMV: Driven(NORTHBOUND, at_speed(30.0, 10.0, 400))})
    shift = np.array([300.0, -150.0])
    network = plain.network
    junctions = {
        name: replace(
            junction, outline=junction.outline + shift, x_m=junction.x_m + shift[0], y_m=junction.y_m + shift[1]
        )
        for name, junction in network.junctions.items()
    }
    moved = with_states(plain, x_m=lambda state: state.x_m + shift[0], y_m=lambda state: state.y_m + shift[1])
    moved = replace(moved, network=replace(network, junctions=junctions))
    assert realisation_of(moved).arrival_s == realisation_of(plain).arrival_s
    assert not np.isnan(realisation_of(plain).arrival_s)


def test_the_longest_standstill_is_one_unbroken_stop_with_its_begin():
    """A vehicle that rolls out stands; the second of these stops is the longest."""
    speed = np.array([0.0] * 10 + [5.0] + [0.25] * 10 + [0.0] * 20 + [1.0] + [0.0] * 20)
    assert longest_standstill(speed) == (pytest.approx(1.5), 11)
    assert longest_standstill(np.array([1.0, 2.0])) == (0.0, 0)


@pytest.mark.parametrize("ids", [(), (9,)])
def test_without_an_emv_there_is_no_way(ids):
    record = hand_made(crossing(), {2: Driven(NORTHBOUND, at_speed(60.0, 2.0, 21))})
    changed = replace(record, description=replace(record.description, emv_ids=ids))
    measures = outcome_of(changed, CLOSING).measures
    assert "emv_distance_m" not in measures
    assert "av.heard_s" not in measures


def test_a_record_that_cannot_be_judged_has_no_verdict_and_says_why():
    class Broken:
        def build(self) -> EpisodeRecord:
            raise EpisodeError("a state of nobody")

    outcome = judge(Broken(), replace(CLOSING, end="failed", reason="stopped"))
    assert (outcome.end, outcome.reason, outcome.steps, outcome.predicate_holds) == ("failed", "stopped", 101, None)
    assert outcome.measures == {"predicate": "a state of nobody"}


WALKS, CYCLES, RIDES = ActorClass.PEDESTRIAN, ActorClass.BICYCLE, ActorClass.MOTORCYCLE
NORTH = np.pi / 2.0


def record_of(others: dict[int, Track], emv: Track | None = None) -> EpisodeRecord:
    """With an EMV of 4.6 m that drives east at 10 m/s from the origin for 10 s."""
    emv = emv or moving(0.0, 0.0, 10.0, is_emv=True)
    record = record_with({1: emv, **others}, crossing())
    return replace(record, description=replace(record.description, emv_ids=(1,)))


def walker(x_m: float, y_m: float, speed_mps: float = 1.0, kind: ActorClass = WALKS, **more: Any) -> Track:
    """Goes north; its footprint is 0.6 m by 1.8 m."""
    return moving(x_m, y_m, speed_mps, yaw_rad=NORTH, actor_class=kind, length_m=0.6, **more)


def with_emv(record: EpisodeRecord) -> dict[ActorClass, int]:
    return {kind: own.with_emv for kind, own in people_of(record).items()}


def test_an_episode_without_people_has_no_numbers() -> None:
    assert people_measures(record_of({2: moving(20.0, 8.0, 5.0)})) == {}
    described_only = record_of({2: walker(0.0, 50.0, without=frozenset(range(201)))})
    assert people_measures(described_only) == {}


@pytest.mark.parametrize(("late_m", "meets"), [(0.0, 1), (0.1, 0)])
def test_ways_that_cross_within_five_seconds_are_a_meeting(late_m: float, meets: int) -> None:
    """The EMV's rear leaves the walker's strip at x = 20 + 0.9 m after 2.32 s: the last place of its in it is at 2.30.

    The walker reaches the EMV's strip, whose edge is 0.9 m off, when its front, 0.3 m ahead, is there.
    """
    reached_s = 2.3 + 5.0
    record = record_of({2: walker(20.0, -1.2 - reached_s + 0.01 - late_m)})
    assert with_emv(record) == {WALKS: meets, CYCLES: 0, RIDES: 0}


@pytest.mark.parametrize("emv_ids", [(1, 4), (4, 1)])
def test_each_of_two_emvs_counts_in_a_record_that_begins_later_too(emv_ids: tuple[int, int]) -> None:
    record = record_of({4: moving(0.0, 5000.0, 10.0, is_emv=True), 2: walker(20.0, -8.0)})
    record = replace(record, description=replace(record.description, emv_ids=emv_ids))
    for states in (record.states, record.states[7:]):
        assert people_of(replace(record, states=states))[WALKS] == PeopleOfClass(1, 1, 1, 0, 1)


def test_people_who_walk_along_the_way_are_no_meeting() -> None:
    along = moving(30.0, 2.0, 1.4, actor_class=WALKS, length_m=0.6)
    assert with_emv(record_of({2: along}))[WALKS] == 0


@pytest.mark.parametrize(("gap_s", "meets"), [(1.4, 1), (1.6, 0)])
def test_a_course_that_ends_in_a_contact_soon_is_a_meeting(gap_s: float, meets: int) -> None:
    """An EMV at 10 m/s behind a cyclist at 4 m/s, both for one step: no way crosses another."""
    cyclist = moving(4.6 + 6.0 * gap_s, 0.0, 4.0, actor_class=CYCLES, steps=2)
    record = record_of({2: cyclist}, moving(0.0, 0.0, 10.0, is_emv=True, steps=2))
    assert with_emv(record) == {WALKS: 0, CYCLES: meets, RIDES: 0}


def yielding(record: EpisodeRecord, actor_id: int, steps: range) -> EpisodeRecord:
    def modes(state: Any) -> Any:
        return np.where(state.actor_id == actor_id, np.uint8(Mode.YIELD_HOLD), state.mode)

    return with_states(record, lambda step: step in steps, mode=modes)


def test_a_civilian_counts_while_it_makes_way() -> None:
    """A car stands across a walker's way for the first second, and is gone when the walker is there, 2 s later."""
    car = moving(20.0, 40.0, 0.0, steps=21)
    record = record_of({2: car, 3: walker(20.0, 40.0 - 1.2 - 3.0)})
    assert people_of(record)[WALKS].met == 0, "a driver who does not make way"
    assert people_of(yielding(record, 2, range(21)))[WALKS] == PeopleOfClass(1, 1, 0, 1, 1)
    for alone, order in ((3, (2, 4)), (3, (4, 2))):  # another one makes way for nobody on foot
        other = record_of({order[0]: car, order[1]: moving(-200.0, 40.0, 0.0, steps=21), alone: walker(20.0, 35.8)})
        both = yielding(yielding(other, order[0], range(21)), order[1], range(21))
        assert people_of(both)[WALKS].with_yielding == 1
    ridden = replace(record, actors={**record.actors, 2: replace(record.actors[2], actor_class=RIDES)})
    found = people_of(yielding(ridden, 2, range(21)))
    assert (found[WALKS].with_yielding, found[RIDES].with_yielding) == (1, 0), "nobody meets oneself"


def test_people_within_150_m_are_counted_over_the_episode_and_at_once() -> None:
    """The EMV goes from 0 to 100 m; one walker stands 150 m beyond its end, one 150.1 m before its start."""
    there = {2: walker(250.0, 0.0, 0.0), 3: walker(-150.1, 0.0, 0.0), 4: walker(50.0, 60.0, 0.0, RIDES)}
    found = people_of(record_of(there))
    assert (found[WALKS].near, found[WALKS].near_median) == (1, 0)
    assert (found[RIDES].near, found[RIDES].near_median) == (1, 1)
    assert found[CYCLES].near == 0


CAR, WALKER = 2, 3
HALF_WIDTH_M = 0.9
STRIPES = line((0.0, 20.0), (10.0, 20.0), (10.0, 24.0), (0.0, 24.0))
"""A crossing over the exit to the north, 140 to 144 m along the way of the car."""


def record_near(car_m, walker_xy, actor_class=ActorClass.PEDESTRIAN):
    """A car on its way to the north, and somebody at a place for as long."""
    x, y = walker_xy
    walker = Driven(line((x, y), (x, y + 1.0)), np.zeros(len(car_m)))
    record = hand_made(replace(crossing(), crossings=(STRIPES,)), {CAR: Driven(NORTHBOUND, car_m), WALKER: walker})
    actors = {**record.actors, WALKER: replace(record.actors[WALKER], actor_class=actor_class)}
    return replace(record, actors=actors)


@pytest.mark.parametrize("cars", [(CAR, 7), (7, CAR)])
def test_the_fastest_of_several_who_pass_people_counts(cars):
    slow, fast = (Driven(NORTHBOUND, at_speed(136.0, speed_mps, 150)) for speed_mps in (1.0, 1.8))
    walker = Driven(line((RIGHT_X_M, 22.0), (RIGHT_X_M, 23.0)), np.zeros(150))
    vehicles = dict(zip(cars, (slow, fast), strict=True))
    record = hand_made(replace(crossing(), crossings=(STRIPES,)), {**vehicles, WALKER: walker})
    walks = replace(record.actors[WALKER], actor_class=ActorClass.PEDESTRIAN)
    _, part = check_people(replace(record, actors={**record.actors, WALKER: walks}))
    assert part.value == pytest.approx(1.8, abs=1e-6)


@pytest.mark.parametrize(("steps", "found"), [(21, True), (40, True), (20, False), (41, False)])
def test_the_first_and_the_last_step_on_the_crossing_count(steps, found):
    """The front comes to the crossing after 8 m, in 1.013 s, the rear leaves it after 16 m, in 2.025 s."""
    record = record_near(passing(7.9), (RIGHT_X_M, 22.0))
    brief = tuple(s if s.step == steps else s.select(s.actor_id != WALKER) for s in record.states)
    assert [one.step for one in near_passes(replace(record, states=brief))] == [steps] * found


def passing(speed_mps=8.0):
    return at_speed(130.0, speed_mps, 100)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("beside_m", "near"), [(1.99, True), (2.01, False), (-0.5, True)])
def test_somebody_on_the_crossing_is_near_within_two_metres_of_what_the_vehicle_sweeps(beside_m, near, side):
    record = record_near(passing(), (RIGHT_X_M + side * (HALF_WIDTH_M + beside_m), 22.0))
    assert [(item.actor_id, item.walker_id) for item in near_passes(record)] == [(CAR, WALKER)] * near


def test_the_fastest_step_on_the_crossing_counts():
    speeds = np.full(120, 4.0)
    speeds[60:] = 6.0  # on the crossing from step 41 on: its front comes there after 8 m
    car_m = 130.0 + np.concatenate(([0.0], np.cumsum(0.05 * speeds[1:])))
    (found,) = near_passes(record_near(car_m, (RIGHT_X_M - 1.0, 22.0)))
    assert found.speed_mps == pytest.approx(6.0)
    assert found.step >= 60


@pytest.mark.parametrize(("speed_mps", "holds"), [(1.9, True), (2.1, False)])
def test_vehicles_pass_people_at_walking_pace(speed_mps, holds):
    record = record_near(at_speed(136.0, speed_mps, 150), (RIGHT_X_M, 22.0))
    _, part = check_people(record)
    assert part.holds is holds
    assert part.value == pytest.approx(speed_mps, abs=1e-6)
    assert f"actor {CAR} near {WALKER}" in part.detail


def test_records_without_people_on_the_crossing_have_nothing_near():
    for place in ((RIGHT_X_M, 19.9), (RIGHT_X_M, 24.1), (10.1, 22.0)):
        assert near_passes(record_near(passing(), place)) == ()
    record = record_near(passing(), (RIGHT_X_M, 22.0), ActorClass.SEDAN)
    assert near_passes(record) == ()
    assert all(part.holds and part.value == 0.0 for part in check_people(record))


@pytest.mark.parametrize("actor_class", [ActorClass.PEDESTRIAN, ActorClass.BICYCLE, ActorClass.MOTORCYCLE])
def test_contacts_count_with_those_whom_nothing_protects(actor_class):
    record = record_near(passing(), (50.0, 50.0), actor_class)
    hit = Event(4, EventKind.COLLISION, CAR, WALKER, detail={"impact_speed_mps": 1.0})
    among = replace(hit, other_id=99)
    record = replace(record, events=(hit, among, replace(hit, kind=EventKind.TELEPORT)))
    assert contacts_with_people(record) == (hit,)
    assert not check_people(record)[0].holds
    drawn = replace(record, description=replace(record.description, preset="realistic"))
    assert check_people(drawn)[0].holds


def test_every_predicate_and_every_measure_of_a_busy_episode() -> None:
    """Signals and stop signs, both sides of the road, and each of the EMVs that drive one behind the other."""
    found: dict[str, object] = {}
    for name in ("S1", "S2", "S3", "S4", "S5", "S6", "S7", "S8"):
        record = busy_record(template=name)
        if name in {"S5", "S6"}:
            record = replace(record, network=busy_network(JunctionKind.PRIORITY_STOP))
        of_second = replace(record.description, emv_ids=(9, 1))
        found[name] = told(evaluate_predicate(record))
        if name in {"S1", "S7", "S8"}:
            continue  # nobody does what these ask for
        found[f"{name} behind"] = told(evaluate_predicate(replace(record, description=of_second)))
        mirrored = replace(record.mirrored(), network=replace(record.mirrored().network, left_hand=True))
        found[f"{name} mirrored"] = told(evaluate_predicate(mirrored))
    record = busy_record()
    found["outcome"] = outcome_of(record, EpisodeClosing(record.steps, EpisodeEnd.COMPLETE, ""))
    found["first EMV"] = [_with_first(record, *ids) for ids in ((1, 9, 12), (9, 1, 12), (12, 9), ())]
    assert_known(Path(__file__).parent / "known" / "outcome.json", found)


def _with_first(record: EpisodeRecord, *ids: int) -> dict[str, object]:
    """What depends on which EMV is the first one, with each of five vehicles as AV under test, and own traffic."""
    demand = {"source": "own.rou.xml", "sha256": "d0", "begin_s": 0.0, "left_out": ["a", "b"], "xml": ""}
    actors = {
        key: replace(one, name=f"demand.{key}" if key in {3, 10} else one.name) for key, one in record.actors.items()
    }

    def of_av(key: int) -> EpisodeRecord:
        told = {"av": {"actor_id": key, "sensors": "none"}, "demand": demand}
        parameters = {**record.description.parameters, **told}
        return replace(
            record, actors=actors, description=replace(record.description, emv_ids=ids, parameters=parameters)
        )

    responses = {key: list(vars(one).values()) for key in (2, 3, 4, 6, 11) if (one := av_response(of_av(key)))}
    realised = realisation_of(of_av(2)) if ids else None
    return {"av": responses, "realised": realised, "demand": demand_measures(of_av(2)), "people": people_of(of_av(2))}
