from dataclasses import replace
from pathlib import Path

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
from known_outputs import assert_known
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


def mirrored(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The same about the line between the two lanes."""
    return [(LEFT_X_M + RIGHT_X_M - x, y) for x, y in points]


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


Car = tuple[int, float, list[tuple[float, float]], float]
"""Id, start in m, points, and speed in m/s."""


def changing(
    *cars: Car, steps: int = 400, emv: np.ndarray = NORTHBOUND, emv_mps: float = 9.0
) -> list[list[int | None]]:
    """Actor, left lane, and the steps of each clearing; the EMV drives north in the right lane with its siren on."""
    vehicles = {EMV: Driven(emv, np.minimum(at_speed(5.0, emv_mps, steps), 225.0))}
    for actor_id, start_m, points, speed_mps in cars:
        vehicles[actor_id] = Driven(line(*points), np.minimum(at_speed(start_m, speed_mps, steps), 225.0))
    found = find_clearings(with_siren(vehicles))
    return [[one.actor_id, one.left_lane, one.start_step, one.end_step, one.passed_step] for one in found]


def lanes(*ends: tuple[float, float, float]) -> list[tuple[float, float]]:
    """Northwards in the right lane, and at each end from one place to another one over some metres."""
    points = [(RIGHT_X_M, -120.0)]
    for x_m, from_m, to_m in ends:
        points += [(points[-1][0], from_m), (x_m, to_m)]
    return [*points, (points[-1][0], 110.0)]


def test_who_leaves_which_lane_and_is_passed_there() -> None:
    """Actor, lane lane (1 right, 2 left), last step in it, first step clear of it, step of the pass."""
    into = [(LEFT_X_M, -120.0), (LEFT_X_M, -80.0), (RIGHT_X_M, -65.0), (RIGHT_X_M, 110.0)]
    leaves, image = (2, 30.0, LEAVES_LEFT, 6.0), (2, 30.0, mirrored(LEAVES_LEFT), 6.0)
    middle_m = 0.5 * (RIGHT_X_M + LEFT_X_M)
    swerves = [lanes((middle_m - over_m, -85.0, -75.0), (RIGHT_X_M, -75.0, -65.0)) for over_m in (0.1, 0.5)]
    slow = lanes((LEFT_X_M, -89.0, -80.0))
    on_shoulder = line(*lanes((SHOULDER_X_M, -96.0, -90.0), (RIGHT_X_M, -30.0, -24.0)))
    beside = lanes((LEFT_X_M, -89.0, -80.0), (RIGHT_X_M + 0.9, -75.0, -70.0))
    there_and_back = lanes((LEFT_X_M, -89.0, -81.0), (RIGHT_X_M, -66.0, -58.0))
    weaves = lanes((LEFT_X_M, -89.0, -81.0), (RIGHT_X_M, -60.0, -52.0))
    to_the_left, follows = line(*lanes((LEFT_X_M, -96.0, -90.0))), line(*lanes((LEFT_X_M, -100.0, -92.0)))
    long = lanes((LEFT_X_M, -89.0, -30.0))
    found = {
        "leaves": changing(leaves),
        "comes from the left lane and leaves": changing((2, 24.0, COMES_BACK, 7.0)),
        "a second one that the EMV does not pass": changing(leaves, (3, 28.0, LEAVES_LEFT, 9.0)),
        "comes into the lane": changing((2, 25.0, into, 9.0)),
        "to the right": changing(image, emv=IN_THE_LEFT_LANE),
        "to the right before an EMV in the right lane": changing(image),
        "to the left before an EMV in the left lane": changing(leaves, emv=IN_THE_LEFT_LANE),
        **{f"swerves {k}": changing((2, 30.0, swerve, 6.0), emv_mps=5.0) for k, swerve in enumerate(swerves)},
        "the EMV passes on the shoulder": changing((2, 30.0, slow, 3.0), emv=on_shoulder),
        "the EMV passes in the lane": changing((2, 30.0, slow, 3.0)),
        "the EMV passes beside it in one lane": changing(
            (2, 30.0, beside, 3.0), emv=line((RIGHT_X_M - 1.0, -120.0), (RIGHT_X_M - 1.0, 110.0)), emv_mps=6.5
        ),
        "leaves the left lane too and is passed there": changing(
            (2, 30.0, there_and_back, 5.0), emv=to_the_left, emv_mps=7.0
        ),
        "stays in the left lane": changing((2, 30.0, slow, 5.0), emv=to_the_left, emv_mps=4.0),
        "leaves both, and is not passed": changing((2, 30.0, weaves, 5.0), emv=follows, emv_mps=4.5, steps=300),
        "is passed with its tail in the lane": changing((2, 30.0, long, 2.5), emv_mps=4.0),
        "is passed clear of the lane": changing((2, 30.0, long, 2.5), emv_mps=3.5, steps=700),
    }
    assert_known(Path(__file__).parent / "known" / "clearings.json", found)
