"""The checks of a record, by faults made by hand: physics, ownership, messages, stamps, hashes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from busy_record import TURN_RAD, busy_record
from hand_made_record import (
    CAR_LENGTH_M,
    EMV,
    EMV_LENGTH_M,
    NORTHBOUND,
    Driven,
    at_speed,
    crossing,
    hand_made,
    line,
    with_states,
)
from known_outputs import assert_known
from told_verdicts import parts_told, told

from siren_ros.base.numerics.units import STEP_NS, STEP_S
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EpisodeError
from siren_ros.scoring.judging.verdict import Part, verdict_of
from siren_ros.scoring.judging.verify import (
    CHECKS,
    PhysicsSummary,
    Verification,
    VerifyLimits,
    check_motion,
    check_physics,
    check_state_hashes,
    deepest_overlap,
    near_passes,
    summarise_physics,
    verify_episode,
)
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorStates, Event, EventKind, Mode, Owner, hash_state


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> EpisodeRecord:
    return read_episode(write_bag(tmp_path_factory.mktemp("bags") / "S2_L2_seed0", duration_s=9.0, lidar=True))


def test_a_sound_episode_holds(record):
    verification = verify_episode(record)
    assert verification.holds
    assert [part.name for part in verification.checks] == list(CHECKS), "the documents list them"


def _moved(record: EpisodeRecord, **columns: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> EpisodeRecord:
    """The record with columns of actor 2 changed at step 100."""
    for name, edit in columns.items():

        def column(state: ActorStates, name: str = name, edit: Callable[..., np.ndarray] = edit) -> np.ndarray:
            rows, values = state.actor_id == 2, getattr(state, name)
            return np.where(rows, edit(values, rows), values)

        record = with_states(record, lambda step: step == 100, **{name: column})
    return record


def test_a_standing_vehicle_cannot_turn(record):
    """Grip would let it; a bicycle without speed has no yaw rate."""
    first = record.states[0]
    still = replace(first, vx_mps=np.zeros(len(first)), vy_mps=np.zeros(len(first)), yaw_rad=np.zeros(len(first)))
    turned = replace(still, step=1, yaw_rad=np.where(still.actor_id == 3, 0.06, 0.0))
    _, part, _ = check_motion(replace(record, states=(still, turned)), VerifyLimits())
    assert (part.holds, part.detail) == (False, "actor 3 at step 1")
    assert part.value == pytest.approx(0.06)


@pytest.mark.parametrize("beyond_rad", [-0.002, 0.002])
@pytest.mark.parametrize("speed_mps", [0.5, 2.0])
def test_a_slow_vehicle_turns_as_far_as_its_steering_lets_it(speed_mps, beyond_rad):
    record = hand_made(crossing(), {2: Driven(NORTHBOUND, at_speed(10.0, speed_mps, 12))})
    limit_rad = speed_mps * np.tan(0.7) / (0.5 * CAR_LENGTH_M) * STEP_S + 0.01
    turned = with_states(record, lambda step: step >= 6, yaw_rad=lambda state: state.yaw_rad - limit_rad - beyond_rad)
    _, part, _ = check_motion(turned, VerifyLimits())
    assert (part.holds, part.detail) == (beyond_rad < 0.0, "actor 2 at step 6")


def test_an_actor_that_is_away_for_a_while_has_not_jumped():
    """From one step to the next alone a way can be too long."""
    first = hand_made(crossing(), {2: Driven(NORTHBOUND, at_speed(10.0, 10.0, 10))})
    later = hand_made(crossing(), {2: Driven(NORTHBOUND, at_speed(60.0, 10.0, 10), first_step=20)})
    record = replace(first, states=(*first.states, *later.states[20:]))
    assert check_motion(record, VerifyLimits())[0].holds
    closed_up = tuple(replace(state, step=step) for step, state in enumerate(record.states))
    part, _, _ = check_motion(replace(record, states=closed_up), VerifyLimits())
    assert (part.holds, part.detail) == (False, "actor 2 at step 10")
    assert part.value == pytest.approx(45.0)
    # The last state of one and the first of the next follow each other in the rows.
    next_one = Driven(NORTHBOUND, at_speed(150.0, 10.0, 5), first_step=5)
    record = hand_made(crossing(), {2: Driven(NORTHBOUND, at_speed(10.0, 10.0, 5)), 3: next_one})
    assert check_motion(record, VerifyLimits())[0].holds


def with_times(record: EpisodeRecord, name: str, times_ns: np.ndarray, **changes: Any) -> EpisodeRecord:
    """The record with other messages of a topic."""
    topic = replace(record.topics[name], count=len(times_ns), times_ns=times_ns, **changes)
    return replace(record, topics={**record.topics, name: topic})


def test_states_of_an_unknown_actor_contradict_the_record(record):
    actors = {key: actor for key, actor in record.actors.items() if key != 4}
    with pytest.raises(EpisodeError, match="never described"):
        verify_episode(replace(record, actors=actors))


def _shaken(record: EpisodeRecord) -> dict[str, EpisodeRecord]:
    """States that cannot be, and states that just can."""
    first, state, doubled = record.commands["emv_controller"][0], record.states[40], record.states[50]
    rows = np.array([0, 1, 1, *range(2, len(state))])
    twice = replace(state, **{name: getattr(state, name)[rows] for name in ACTOR_STATE_DTYPES})
    x_m, y_m = doubled.x_m.copy(), doubled.y_m.copy()
    x_m[2], y_m[2] = x_m[1] + 1.0, y_m[1]
    other = replace(record.states[30], x_m=record.states[30].x_m + 1e-12 * (np.arange(len(record.states[30])) == 0))
    # Grip is the tighter limit here: 12 m/s² at the fastest of three steps, and 0.01 rad.
    grip_rad = 12.0 / max(float(record.track(2).speed_mps[step]) for step in (99, 100, 101)) * STEP_S + 0.01

    def claimed(**changes: object) -> EpisodeRecord:
        return replace(record, commands={**record.commands, "intruder": (replace(first, **changes),)})

    def every_second(column: str, value: float) -> EpisodeRecord:
        return with_states(record, lambda step: step % 20 == 0, **{column: lambda state: np.full(len(state), value)})

    return {
        "nothing": record,
        "0.3 m aside": _moved(record, x_m=lambda x, _: x + 0.3),
        "turned": _moved(record, yaw_rad=lambda yaw, _: yaw + 0.2),
        "turned as far as grip lets it": _moved(record, yaw_rad=lambda yaw, _: yaw + grip_rad - 0.002),
        "turned farther": _moved(record, yaw_rad=lambda yaw, _: yaw + grip_rad + 0.002),
        "another velocity": _moved(record, vx_mps=lambda v, _: v + 3.0),
        "an unknown owner": _moved(record, owner=lambda owner, _: np.full_like(owner, 7)),
        "twice in a step": replace(record, states=(*record.states[:40], twice, *record.states[41:])),
        "claims handed back": claimed(owner=np.full_like(first.owner, Owner.SUMO)),
        "claims at no step": claimed(step=10**6),
        "claims of two nodes": claimed(),
        "far residuals": with_states(record, residual_m=lambda state: state.residual_m + 3.0),
        "a residual": with_states(
            record, lambda step: step == 40, residual_m=lambda state: 5.0 * (state.actor_id == 3)
        ),
        "changed afterwards": replace(record, states=(*record.states[:30], other, *record.states[31:])),
        "no hashes": replace(record, state_hashes={}),
        "one in another": with_states(record, lambda step: step == 50, x_m=lambda _: x_m, y_m=lambda _: y_m),
        "to the left": every_second("lateral_accel_mps2", 4.5),
        "to the right": every_second("lateral_accel_mps2", -4.5),
        "braking": every_second("accel_mps2", -4.5),
        "speeding up": every_second("accel_mps2", 3.0),
    }


def _told_otherwise(record: EpisodeRecord) -> dict[str, EpisodeRecord]:
    """Other events, outcomes and topics."""
    found = {"teleport": replace(record, events=(*record.events, Event(7, EventKind.TELEPORT, 3)))}
    found["interrupted"] = replace(record, outcome=None, complete=False)
    drawn = replace(record, description=replace(record.description, preset="realistic"))
    for name, of, contacts in (
        ("a soft impact", record, {100: 1.5}),
        ("a hard impact and a soft one before it", record, {80: 1.5, 100: 2.5}),
        ("a hard impact and a soft one after it", record, {100: 2.5, 120: 1.5}),
        ("a hard impact of drawn drivers", drawn, {100: 2.5}),
        ("a contact at the second step", record, {1: 0.0}),
        ("a contact at the first step", record, {0: 0.0, 1: 0.0}),
    ):
        hits = (Event(step, EventKind.COLLISION, 2, 3, detail={"impact_speed_mps": v}) for step, v in contacts.items())
        found[name] = replace(of, events=(*record.events, *hits))
    for planned_s in (0.0, -0.06, 0.06):
        description = replace(record.description, duration_s=record.steps * STEP_S + planned_s)
        found[f"{planned_s} s more planned"] = replace(record, description=description)
    for topic in ("/clock", "/siren/events", "/emv/lidar/points"):
        times_ns = record.topics[topic].times_ns
        later = times_ns + STEP_NS * (np.arange(len(times_ns)) == 5)
        found[f"one less of {topic}"] = with_times(record, topic, np.delete(times_ns, 5))
        found[f"one later of {topic}"] = with_times(record, topic, later)
    found["two maps"] = with_times(record, "/siren/map", np.repeat(record.topics["/siren/map"].times_ns, 2))
    topics = {name: topic for name, topic in record.topics.items() if name != "/siren/yield_commands"}
    found["no commands"] = replace(record, topics=topics)
    times_ns = record.topics["/siren/events"].times_ns
    off_grid = times_ns + (np.arange(len(times_ns)) == 3)
    for name, stamps_ns, mismatches in (("", times_ns, 2), ("off the grid", off_grid, 0), ("both", off_grid, 1)):
        found[f"stamps {name}"] = with_times(record, "/siren/events", stamps_ns, stamp_mismatches=mismatches)
    # A sensor has the period of its shortest interval; one message alone is a latched one.
    times_ns = record.topics["/emv/lidar/points"].times_ns
    for name, sweeps_ns in (
        ("alone", times_ns[:1]),
        ("twice", np.sort(np.append(times_ns, times_ns[2]))),
        ("half a period later", np.sort(np.append(times_ns, times_ns[2] + STEP_NS))),
        ("without the last", times_ns[:-1]),
        ("without the first", times_ns[1:]),
    ):
        found[f"a sweep {name}"] = with_times(record, "/emv/lidar/points", sweeps_ns)
    return found


def test_what_fails_of_a_record_in_which_one_thing_is_wrong(record):
    """That a changed state no longer has its hash is told where nothing else was changed."""
    known = {}
    for name, changed in (_shaken(record) | _told_otherwise(record)).items():
        parts = parts_told(verify_episode(changed).failing)
        known[name] = (
            parts if len(parts) == 1 else {key: of for key, of in parts.items() if key != "wrong_state_hashes"}
        )
    assert_known(Path(__file__).parent / "known" / "faults.json", known)


def on_a_way(
    record: EpisodeRecord, direction: np.ndarray, driven_m: Sequence[float] | np.ndarray, speeds_mps: Sequence[float]
) -> EpisodeRecord:
    """The record of one vehicle, driven so far in a direction and as fast at each step."""
    return with_states(
        record,
        x_m=lambda state: np.array([direction[0] * driven_m[state.step]]),
        y_m=lambda state: np.array([direction[1] * driven_m[state.step]]),
        vx_mps=lambda state: np.array([direction[0] * speeds_mps[state.step]]),
        vy_mps=lambda state: np.array([direction[1] * speeds_mps[state.step]]),
    )


@pytest.mark.parametrize("heading", np.radians([0.0, 30.0, 120.0, -75.0]))
@pytest.mark.parametrize(("struck", "error_mps"), [((2, 3), 0.0), ((3, 2), 0.0), ((3, 4), 3.0), (None, 3.0)])
@pytest.mark.parametrize("more_mps", [0.0, 1.0])
def test_a_contact_takes_velocity_within_a_step_in_any_direction(heading, struck, error_mps, more_mps):
    """From 10 m/s to 4 m/s at the end of a step: the mean velocity is 3 m/s off, half of what the contact took.

    What is more than that is not explained by it.
    """
    way = np.array([np.cos(heading), np.sin(heading)])
    record = hand_made(crossing(), {2: Driven(NORTHBOUND, np.zeros(6))})
    speeds = [10.0, 10.0, 10.0, 4.0, 4.0, 4.0]
    driven = np.array([0.0, 0.5, 1.0, 1.5, 1.7, 1.9]) + more_mps * STEP_S * (np.arange(6) > 2)
    events = () if struck is None else (Event(3, EventKind.COLLISION, *struck, detail={"impact_speed_mps": 1.0}),)
    _, _, error = check_motion(replace(on_a_way(record, way, driven, speeds), events=events), VerifyLimits())
    assert error.value == pytest.approx(error_mps + more_mps, abs=1e-9)


def test_the_worst_case_is_named_with_a_change_of_its_owner():
    record = hand_made(crossing(), {2: Driven(NORTHBOUND, np.zeros(6)), 5: Driven(NORTHBOUND, np.full(6, 40.0))})
    handed = with_states(
        record,
        owner=lambda state: np.where((state.actor_id == 5) & (state.step >= 3), np.uint8(Owner.ROS), state.owner),
    )
    assert check_motion(handed, VerifyLimits())[0].holds
    moved = with_states(handed, lambda step: step >= 3, y_m=lambda state: state.y_m + 2.0 * (state.actor_id == 5))
    part, _, _ = check_motion(moved, VerifyLimits())
    assert (part.holds, part.value) == (False, pytest.approx(2.0))
    assert part.detail == "actor 5 at step 3 as its owner changes"


def test_a_record_without_moves_has_no_jumps_and_names_nobody():
    two_steps = hand_made(crossing(), {2: Driven(NORTHBOUND, np.zeros(2))})
    for part in check_motion(replace(two_steps, states=two_steps.states[:1]), VerifyLimits()):
        assert (part.holds, part.value, part.detail) == (True, 0.0, "")
    assert check_motion(two_steps, VerifyLimits())[0].detail == "actor 2 at step 1"


@pytest.mark.parametrize("way", [(3.0, 4.0), (-3.0, 4.0), (0.0, -5.0)])
@pytest.mark.parametrize(("beyond_m", "holds"), [(0.04, True), (0.06, False)])
def test_a_step_is_no_longer_than_the_faster_of_both_speeds_allows(way, beyond_m, holds):
    """From standstill to 5 m/s, or from there to standstill: 0.25 m and the margin of 5 cm."""
    direction = np.array(way) / 5.0
    for speeds in ((0.0, 5.0), (5.0, 0.0)):
        record = hand_made(crossing(), {2: Driven(NORTHBOUND, np.zeros(2))})
        part, _, _ = check_motion(on_a_way(record, direction, (0.0, 0.25 + beyond_m), speeds), VerifyLimits())
        assert (part.holds, part.value) == (holds, pytest.approx(beyond_m))


@pytest.mark.parametrize(
    ("predicate", "checks", "holds"),
    [(True, (True, True), True), (True, (True, False), False), (False, (True, True), False), (True, (), True)],
)
def test_an_episode_holds_where_its_predicate_and_every_check_do(predicate, checks, holds):
    part, *parts = (Part("x", 1.0, 1.0, it_holds, ">=", "") for it_holds in (predicate, *checks))
    verification = Verification(verdict_of((part,), "text"), tuple(parts))
    assert verification.holds is holds
    assert len(verification.failing) == (not predicate) + checks.count(False)


def test_headings_are_compared_across_pi():
    """A car that drives west and bends from just below pi to just above −pi."""
    way = line((50.0, -0.2), (0.0, 0.0), (-50.0, -0.2))
    record = hand_made(crossing(), {2: Driven(way, at_speed(48.0, 10.0, 10))})
    assert np.ptp(record.track(2).yaw_rad) > 6.0
    _, part, _ = check_motion(record, VerifyLimits())
    assert part.value == pytest.approx(0.008 - 12.0 / 10.0 * STEP_S, abs=1e-4)


def test_signals_are_part_of_the_hash_of_a_state():
    red, green = (
        hand_made(crossing(), {2: Driven(NORTHBOUND, np.zeros(3))}, lambda _, letters=letters: letters)
        for letters in ("rrr", "GGG")
    )
    hashes = {state.step: hash_state(state, red.traffic[state.step].signals) for state in red.states}
    wrong = [check_state_hashes(replace(record, state_hashes=hashes)).value for record in (red, green)]
    assert wrong == [0.0, 3.0]


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
    for hard, low, high in ((4, [], []), (6, ["civilian_accel_p0_5_mps2"], ["civilian_accel_p99_5_mps2"])):
        for accel, names in ((-9.0, low), (3.4, high)):
            assert failing(civilians([accel] * hard + [0.0] * (1000 - hard))) == names
    assert failing(civilians([-3.9] * 30 + [2.9] * 30)) == []


def test_no_civilian_steers_as_on_a_race_track():
    for side in (1.0, -1.0):
        assert failing(civilians([0.0] * 400, [side * 6.0] + [0.0] * 399)) == ["civilian_lateral_mps2"]
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


def test_every_check_of_a_busy_episode() -> None:
    found = verify_episode(busy_record())
    others = {key: told(one) for key, one in found.others.items()}
    known = {
        "verdict": told(found.verdict),
        "checks": parts_told(found.checks),
        "near": [[tuple(vars(one).values()) for one in near_passes(aside(shift_m))] for shift_m in range(-6, 7, 2)],
        "others": others,
        "facts": found.facts(),
    }
    assert_known(Path(__file__).parent / "known" / "verify.json", known)


def aside(shift_m: float) -> EpisodeRecord:
    """The busy record, with its people on foot elsewhere on the crossing."""
    record, way = busy_record(), shift_m * np.array([np.cos(TURN_RAD), np.sin(TURN_RAD)])

    def moved(state: ActorStates, axis: str, by_m: float) -> np.ndarray:
        return getattr(state, axis) + by_m * np.isin(state.actor_id, record.walker_ids)

    return with_states(
        record, x_m=lambda state: moved(state, "x_m", way[0]), y_m=lambda state: moved(state, "y_m", way[1])
    )
