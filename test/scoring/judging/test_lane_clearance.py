from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import (
    EMV,
    LEFT_X_M,
    NORTHBOUND,
    RIGHT_X_M,
    SHOULDER_X_M,
    Driven,
    at_speed,
    crossing,
    hand_made,
    line,
    with_states,
    without,
)
from synthetic_episode import LEFT_Y_M, RIGHT_Y_M, split_net

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import BagError
from siren_ros.scoring.judging.lane_clearance import BODY_MARGIN_M, find_clearings, lane_cleared
from siren_ros.scoring.judging.outcome import evaluate_predicate
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.world.actors import ActorStates, Event, EventKind, Lights

THRESHOLDS = {"lane_changes_min": 3, "passed_min": 3}
LEAVES_LEFT = [(RIGHT_X_M, -120.0), (RIGHT_X_M, -80.0), (LEFT_X_M, -65.0), (LEFT_X_M, 110.0)]
COMES_BACK = [
    *((LEFT_X_M, -120.0), (LEFT_X_M, -95.0), (RIGHT_X_M, -85.0), (RIGHT_X_M, -70.0)),
    *((LEFT_X_M, -60.0), (LEFT_X_M, 110.0)),
]
IN_THE_LEFT_LANE = line((LEFT_X_M, -120.0), (LEFT_X_M, 110.0))


def test_four_of_four_leave_and_are_passed(record_of):
    verdict = evaluate_predicate(record_of())
    assert verdict.holds
    assert verdict.measures() == {"lane_changes": 4.0, "passed": 4.0, "standstill_s": 0.0}
    clearings = find_clearings(record_of())
    changes, passed, _ = (part.detail for part in verdict.parts)
    assert changes == ", ".join(f"{item.actor_id} at {0.05 * item.end_step:.1f} s" for item in clearings)
    assert passed == ", ".join(f"{item.actor_id} at {0.05 * (item.passed_step or 0):.1f} s" for item in clearings)
    times = [[(moment.actor_id, moment.step) for moment in part.moments] for part in verdict.parts]
    assert times[0] == [(item.actor_id, item.end_step) for item in clearings]
    assert times[1] == sorted(((item.actor_id, item.passed_step) for item in clearings), key=lambda pair: pair[1])


def test_a_seam_between_two_edges_hides_no_lane_change_and_is_none(record_of):
    record, following = record_of(), record_of(changing=0)
    whole = [(item.actor_id, item.passed_step) for item in find_clearings(record)]
    for seam_m in (50, 71, 100):
        network = parse_road_network(split_net(float(seam_m)).encode())
        seamed = find_clearings(replace(record, network=network))
        assert [(item.actor_id, item.passed_step) for item in seamed] == whole
        assert find_clearings(replace(following, network=network)) == ()


@pytest.mark.parametrize("silent", ["start", "end", "between"])
def test_the_siren_has_to_be_on_at_the_start_and_at_the_end(record_of, silent):
    record = record_of()
    first = find_clearings(record)[0]
    steps = {
        "start": range(first.start_step + 1),
        "end": range(first.end_step, record.steps),
        "between": range(first.start_step + 1, first.end_step),
    }[silent]
    silenced = with_states(record, lambda step: step in steps, lights=lambda state: np.zeros_like(state.lights))
    counted = {item.actor_id for item in find_clearings(silenced)}
    assert (first.actor_id in counted) == (silent == "between")
    assert find_clearings(record_of(siren=False)) == ()


def test_a_lane_change_that_the_emv_never_passes_does_not_count_as_passed(record_of):
    record = record_of(duration_s=9.0)
    verdict = lane_cleared(record, THRESHOLDS)
    assert [part.value for part in verdict.parts] == [4.0, 3.0]
    few = lane_cleared(record_of(changing=2), THRESHOLDS)
    assert [(part.name, part.value) for part in few.failing] == [("lane_changes", 2.0), ("passed", 2.0)]


def test_vehicles_behind_the_emv_do_not_count(record_of):
    moved = with_states(record_of(), x_m=lambda state: state.x_m - np.where(state.actor_id == 2, 60.0, 0.0))
    assert [clearing.actor_id for clearing in find_clearings(moved)] == [3, 4, 5]


def test_civilians_are_judged_only_while_the_emv_is_there(record_of):
    """The EMV leaves the map between the second and the third lane change."""
    record = record_of()
    changes = find_clearings(record)
    leaves = (changes[1].end_step + changes[2].end_step) // 2
    clearings = find_clearings(without(record, 1, lambda step: step >= leaves))
    assert [(item.actor_id, item.end_step) for item in clearings] == [
        (item.actor_id, item.end_step) for item in changes if item.end_step < leaves
    ]
    assert all(item.passed_step is None or item.passed_step < leaves for item in clearings)


def test_events_alone_and_a_half_finished_lane_change_prove_nothing(record_of):
    still = with_states(record_of(), y_m=lambda state: np.full(len(state), RIGHT_Y_M))
    assert find_clearings(still) == ()
    half = with_states(
        record_of(), y_m=lambda state: np.where(state.actor_id == 1, state.y_m, np.minimum(state.y_m, -3.2))
    )
    assert find_clearings(half) == ()


def test_thresholds_come_from_the_record(record_of):
    record = record_of()

    def with_predicate(stored: object) -> EpisodeRecord:
        return replace(record, description=replace(record.description, parameters={"predicate": stored}))

    strict = {"name": "lane_cleared", "thresholds": {"lane_changes_min": 5, "passed_min": 3}}
    assert not evaluate_predicate(with_predicate(strict)).holds
    for broken in ("x", {"name": "unheard_of", "thresholds": {}}, {"name": "lane_cleared", "thresholds": {"a": "b"}}):
        with pytest.raises(BagError, match="predicate"):
            evaluate_predicate(with_predicate(broken))
    with pytest.raises(BagError, match="lane_changes_min"):
        evaluate_predicate(with_predicate({"name": "lane_cleared", "thresholds": {}}))


def test_leaving_completion_and_pass_lie_where_the_poses_put_them(record_of):
    """A lane is clear when all but 30 cm of the turned body has left it."""
    record = record_of()
    emv, middle = record.track(1), (LEFT_Y_M + RIGHT_Y_M) / 2.0
    for clearing in find_clearings(record):
        track, start, end = record.track(clearing.actor_id), clearing.start_step, clearing.end_step
        assert track.y_m[start] <= middle < track.y_m[start + 1]
        half = 0.9 * np.cos(track.yaw_rad) + 2.3 * np.abs(np.sin(track.yaw_rad))
        clear = track.y_m - half >= middle - BODY_MARGIN_M
        assert clear[end]
        assert not clear[start + 1 : end].any()
        assert np.abs(track.yaw_rad[end]) > 0.01
        gap, passed = emv.x_m - track.x_m, clearing.passed_step
        assert gap[passed - 1] < (6.2 + 4.6) / 2.0 <= gap[passed]


def siren_of_the_emv(state: ActorStates) -> np.ndarray:
    return np.where(state.actor_id == EMV, int(Lights.SIREN), 0).astype(np.uint8)


def with_siren(vehicles: dict[int, Driven], heard_step: int = 0) -> EpisodeRecord:
    """A record of an EMV with its siren on, which the others notice at a step."""
    heard = tuple(Event(heard_step, EventKind.YIELD_REQUESTED, key, EMV) for key in vehicles if key != EMV)
    return replace(with_states(hand_made(crossing(), vehicles), lights=siren_of_the_emv), events=heard)


def test_who_has_not_noticed_the_siren_changes_lanes_for_a_reason_of_its_own():
    """The car leaves the right lane at some step: before, at or after the step at which its driver notices."""
    cars = {EMV: Driven(NORTHBOUND, at_speed(5.0, 9.0, 400)), 2: Driven(line(*LEAVES_LEFT), at_speed(30.0, 6.0, 400))}
    (change,) = find_clearings(with_siren(cars))
    assert [bool(find_clearings(with_siren(cars, change.start_step + late))) for late in (0, 1)] == [True, False]
    assert find_clearings(replace(with_siren(cars), events=())) == ()
    cars[3] = Driven(line(*LEAVES_LEFT), at_speed(38.0, 6.0, 400))
    order = [[moment.actor_id for moment in part.moments] for part in lane_cleared(with_siren(cars), THRESHOLDS).parts]
    assert order == [[3, 2], [2, 3]], "by the end of the change, and by the pass"


def changing(
    *places: tuple[int, float, list[tuple[float, float]], float],
    steps: int = 400,
    emv: np.ndarray = NORTHBOUND,
    emv_mps: float = 9.0,
) -> list[tuple[int, bool]]:
    """Clearings of cars by id: start, points and speed; the EMV drives north in the right lane with its siren on."""
    vehicles = {EMV: Driven(emv, np.minimum(at_speed(5.0, emv_mps, steps), 225.0))}
    for actor_id, start_m, points, speed_mps in places:
        arc_m = np.minimum(at_speed(start_m, speed_mps, steps), 225.0)
        vehicles[actor_id] = Driven(line(*points), arc_m)
    return [(item.actor_id, item.passed_step is not None) for item in find_clearings(with_siren(vehicles))]


def test_a_car_that_leaves_the_lane_is_passed_and_one_that_comes_from_the_other_lane_leaves_it_too():
    assert changing((2, 30.0, LEAVES_LEFT, 6.0)) == [(2, True)]
    assert changing((2, 24.0, COMES_BACK, 7.0)) == [(2, True)]
    assert changing((2, 30.0, LEAVES_LEFT, 6.0), (3, 28.0, LEAVES_LEFT, 9.0)) == [(3, False), (2, True)]
    into = [(LEFT_X_M, -120.0), (LEFT_X_M, -80.0), (RIGHT_X_M, -65.0), (RIGHT_X_M, 110.0)]
    assert changing((2, 25.0, into, 9.0)) == []


def mirrored(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The same about the line between the two lanes."""
    return [(LEFT_X_M + RIGHT_X_M - x, y) for x, y in points]


@pytest.mark.parametrize("to_the_right", [False, True])
def test_a_lane_is_left_to_either_side(to_the_right):
    points = mirrored(LEAVES_LEFT) if to_the_right else LEAVES_LEFT
    emv = IN_THE_LEFT_LANE if to_the_right else NORTHBOUND
    assert changing((2, 30.0, points, 6.0), emv=emv) == [(2, True)]
    assert changing((2, 30.0, points, 6.0), emv=NORTHBOUND if to_the_right else IN_THE_LEFT_LANE) == []


def found_at(points: list[tuple[float, float]], put_at: int = 10**6) -> list[tuple[int, int]]:
    """Last step in the old lane and first step clear of it, of a car ahead of the EMV; put to the left at a step."""
    vehicles = {EMV: Driven(NORTHBOUND, at_speed(5.0, 5.0, 150)), 2: Driven(line(*points), at_speed(30.0, 6.0, 150))}
    record = with_states(
        with_siren(vehicles),
        x_m=lambda state: np.where((state.actor_id == 2) & (state.step >= put_at), LEFT_X_M, state.x_m),
    )
    return [(item.start_step, item.end_step) for item in find_clearings(record)]


def test_who_is_put_into_the_next_lane_is_clear_of_the_old_one_at_once():
    """From one step to the next."""
    straight = [(RIGHT_X_M, -120.0), (RIGHT_X_M, 110.0)]
    assert found_at(straight) == []
    assert found_at(straight, put_at=40) == [(39, 40)]


@pytest.mark.parametrize("over_m", [0.1, 0.5])
def test_who_swerves_over_the_line_and_back_has_not_left_the_lane(over_m):
    """The centre is over the line, the body is not clear of the lane, and then the car is back in its middle."""
    x = (RIGHT_X_M + LEFT_X_M) / 2.0 - over_m
    swerve = [(RIGHT_X_M, -120.0), (RIGHT_X_M, -85.0), (x, -75.0), (RIGHT_X_M, -65.0), (RIGHT_X_M, 110.0)]
    assert found_at(swerve) == []


def test_an_emv_that_passes_in_another_lane_has_not_passed_in_the_cleared_one():
    """It takes the shoulder next to the lane that the car has left."""
    beside = line(
        (RIGHT_X_M, -120.0),
        (RIGHT_X_M, -96.0),
        (SHOULDER_X_M, -90.0),
        (SHOULDER_X_M, -30.0),
        (RIGHT_X_M, -24.0),
        (5.25, 110),
    )
    slow = [(RIGHT_X_M, -120.0), (RIGHT_X_M, -89.0), (LEFT_X_M, -80.0), (LEFT_X_M, 110.0)]
    assert changing((2, 30.0, slow, 3.0), emv=beside) == [(2, False)]
    assert changing((2, 30.0, slow, 3.0)) == [(2, True)]


def test_an_emv_that_passes_in_the_lane_in_which_the_car_is_then_has_not_passed_it_in_the_cleared_lane():
    """The car leaves the lane and comes back; the EMV passes it at its side, both in one lane."""
    back = [(RIGHT_X_M, -120.0), (RIGHT_X_M, -89.0), (LEFT_X_M, -80.0), (LEFT_X_M, -75.0)]
    back += [(RIGHT_X_M + 0.9, -70.0), (RIGHT_X_M + 0.9, 110.0)]
    emv = line((RIGHT_X_M - 1.0, -120.0), (RIGHT_X_M - 1.0, 110.0))
    assert changing((2, 30.0, back, 3.0), emv=emv, emv_mps=6.5) == [(2, False)]


def test_of_several_changes_the_one_that_the_emv_passes_counts():
    """The car leaves the right lane; the EMV comes to the left one, which the car leaves too, and passes it there."""
    there_and_back = [(RIGHT_X_M, -120.0), (RIGHT_X_M, -89.0), (LEFT_X_M, -81.0), (LEFT_X_M, -66.0)]
    there_and_back += [(RIGHT_X_M, -58.0), (RIGHT_X_M, 110.0)]
    emv = line((RIGHT_X_M, -120.0), (RIGHT_X_M, -96.0), (LEFT_X_M, -90.0), (LEFT_X_M, 110.0))
    assert changing((2, 30.0, there_and_back, 5.0), emv=emv, emv_mps=7.0) == [(2, True)]
    stays = [(RIGHT_X_M, -120.0), (RIGHT_X_M, -89.0), (LEFT_X_M, -81.0), (LEFT_X_M, 110.0)]
    assert changing((2, 30.0, stays, 5.0), emv=emv, emv_mps=4.0) == [(2, False)]


def test_of_several_changes_that_the_emv_never_passes_the_first_counts():
    """The EMV follows the car into the other lane and back, too slow to pass."""
    weaving = [(RIGHT_X_M, -120.0), (RIGHT_X_M, -89.0), (LEFT_X_M, -81.0), (LEFT_X_M, -60.0), (RIGHT_X_M, -52.0)]
    weaving += [(RIGHT_X_M, 110.0)]
    emv = line((RIGHT_X_M, -120.0), (RIGHT_X_M, -100.0), (LEFT_X_M, -92.0), (LEFT_X_M, 110.0))
    steps = 300
    vehicles = {EMV: Driven(emv, at_speed(0.0, 4.5, steps)), 2: Driven(line(*weaving), at_speed(30.0, 5.0, steps))}
    record = with_siren(vehicles)
    (clearings,) = find_clearings(record)
    assert clearings.passed_step is None
    assert record.network.lanes[clearings.left_lane].centre.points[0][0] == RIGHT_X_M
    assert float(record.track(2).y_m[clearings.start_step]) < -80.0


def test_a_pass_before_the_lane_is_clear_is_none():
    """The car takes 20 s to get over; the EMV squeezes past it while its tail is still in the lane."""
    slow = [(RIGHT_X_M, -120.0), (RIGHT_X_M, -89.0), (LEFT_X_M, -30.0), (LEFT_X_M, 110.0)]
    assert changing((2, 30.0, slow, 2.5), emv_mps=4.0) == [(2, False)]
    assert changing((2, 30.0, slow, 2.5), emv_mps=3.5, steps=700) == [(2, True)]
