"""Titles and severity of the classes, the conflicts in a camera's view, and the labels that follow from them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from busy_record import BEHIND, CROSSING, FIRST, busy_record
from evaluation.made_records import Track, moving, record_with
from known_outputs import assert_known

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import (
    DEFINITIONS,
    Camera,
    Evidence,
    Moments,
    Reason,
    RiskClass,
    RiskLabel,
    RiskThresholds,
    SeenContact,
    SeenEncroachment,
    evidence_of,
    in_view,
    label_of,
    most_severe,
    risk_class,
)
from siren_ros.scoring.judging.surrogate_safety import encounters_of
from siren_ros.sensing.specification import Mount
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import ActorClass, Event, EventKind


@pytest.mark.parametrize(
    ("written", "risk"),
    [
        *((risk.title, risk) for risk in RiskClass),
        *((f" {risk.title.upper()} ", risk) for risk in RiskClass),
        *((written, RiskClass.NEAR_MISS) for written in ("near miss", "NEAR_MISS", "Near-miss", "nearmiss")),
        *((written, None) for written in ("", "normality", "crash", "Normal or Collision")),
    ],
)
def test_words_for_a_class(written: str, risk: RiskClass | None) -> None:
    if risk is None:
        with pytest.raises(InputError, match="Near-Miss"):
            risk_class(written)
    else:
        assert risk_class(written) is risk


def test_the_more_severe_one_counts() -> None:
    assert most_severe([RiskClass.NORMAL, RiskClass.COLLISION, RiskClass.NEAR_MISS]) is RiskClass.COLLISION
    assert most_severe([RiskClass.NORMAL, RiskClass.NEAR_MISS]) is RiskClass.NEAR_MISS


LIMITS = RiskThresholds()


def moments(count: int, ttc_s: float, closing_mps: float, drac_mps2: float = 0.0, gap_m: float = 5.0) -> Moments:
    """Consecutive steps of one civilian from step 100 on."""
    values = (np.full(count, value) for value in (ttc_s, closing_mps, drac_mps2, gap_m, 0.0))
    return Moments(100 + np.arange(count), np.full(count, 7, np.uint32), *values)


NOTHING = moments(0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("found", "reason"),
    [
        (moments(4, 1.49, 1.1), Reason.TIME_TO_COLLISION),
        (moments(20, 0.0, 5.0), Reason.TIME_TO_COLLISION),
        (moments(3, 1.49, 1.1), Reason.NOTHING),
        (moments(8, 1.5, 5.0), Reason.NOTHING),
        (moments(8, 1.0, 1.0), Reason.NOTHING),
        (replace(moments(6, 1.0, 3.0), step=np.array([100, 101, 102, 104, 105, 106])), Reason.NOTHING),
        (replace(moments(6, 1.0, 3.0), actor_id=np.array([7, 7, 7, 8, 8, 8], np.uint32)), Reason.NOTHING),
        (moments(1, 2.0, 8.0, 3.5, 9.9), Reason.REQUIRED_DECELERATION),
        (moments(1, 2.0, 8.0, 3.4, 5.0), Reason.NOTHING),
        (moments(1, 2.0, 8.0, 5.0, 10.0), Reason.NOTHING),
        (SeenEncroachment(9, 50, 0.95), Reason.POST_ENCROACHMENT),
        (SeenEncroachment(9, 50, 1.0), Reason.NOTHING),
    ],
)
def test_what_is_near_and_what_is_just_not(found: Moments | SeenEncroachment, reason: Reason) -> None:
    """A short TTC has to last, of one civilian and without an interruption; at a limit itself nothing is near."""
    is_moments = isinstance(found, Moments)
    label = label_of(Evidence(found if is_moments else NOTHING, () if is_moments else (found,), ()), LIMITS)
    assert label.reason is reason
    assert label.risk is (RiskClass.NORMAL if reason is Reason.NOTHING else RiskClass.NEAR_MISS)
    actor, first = (7, 100) if is_moments else (9, 50)
    assert (label.actor_id, label.step) == ((0, 0) if reason is Reason.NOTHING else (actor, first))
    wider = replace(LIMITS, time_to_collision_s=2.5)
    assert label_of(Evidence(moments(8, 2.0, 5.0), (), ()), wider).risk is RiskClass.NEAR_MISS


@pytest.mark.parametrize("impact_mps", [0.0, 1.5])
def test_touching_is_a_collision_however_slow(impact_mps: float) -> None:
    label = label_of(Evidence(NOTHING, (), (SeenContact(3, 80, impact_mps),)), LIMITS)
    assert label == RiskLabel(RiskClass.COLLISION, Reason.CONTACT, 3, 80, impact_mps)


def test_the_most_severe_decides_and_then_the_earliest() -> None:
    conflict, contact = moments(8, 1.0, 5.0), SeenContact(3, 300, 4.0)
    encroachments = (SeenEncroachment(9, 90, 0.5), SeenEncroachment(8, 95, 0.1))
    assert label_of(Evidence(conflict, encroachments, (contact,)), LIMITS).step == 300
    assert label_of(Evidence(conflict, encroachments, ()), LIMITS).step == 90


def test_a_label_names_the_moment_that_decided_it() -> None:
    """The least TTC among the short ones, and the hardest deceleration among the near ones, not the first ones."""
    varied = replace(moments(6, 1.0, 5.0), time_to_collision_s=np.array([1.4, 1.2, 0.8, 1.1, 1.3, 0.5]))
    varied.closing_mps[5] = 0.5
    label = label_of(Evidence(varied, (), ()), LIMITS)
    assert (label.reason, label.actor_id, label.step, label.value) == (Reason.TIME_TO_COLLISION, 7, 102, 0.8)
    braking = replace(
        moments(4, 2.0, 8.0, 4.0),
        actor_id=np.array([7, 7, 8, 8], np.uint32),
        required_deceleration_mps2=np.array([3.5, 5.0, 4.0, 9.0]),
        gap_m=np.array([5.0, 5.0, 5.0, 12.0]),
    )
    label = label_of(Evidence(braking, (), ()), LIMITS)
    assert (label.reason, label.actor_id, label.step, label.value) == (Reason.REQUIRED_DECELERATION, 7, 101, 5.0)


def test_each_civilian_has_its_own_short_time() -> None:
    """The second one's lasts long enough, and it is that one's least time that counts."""
    two = replace(
        moments(7, 1.0, 3.0),
        actor_id=np.array([7, 7, 7, 9, 9, 9, 9], np.uint32),
        step=np.array([100, 101, 102, 150, 151, 152, 153]),
        time_to_collision_s=np.array([0.2, 0.3, 0.4, 1.2, 1.1, 0.9, 1.0]),
    )
    label = label_of(Evidence(two, (), ()), LIMITS)
    assert (label.actor_id, label.step, label.value) == (9, 152, 0.9)


LENGTH_M, WIDTH_M = 4.6, 1.8
TURNED_RAD = [0.0, 0.8, -2.4]


def placed(x_m: float, y_m: float, yaw_rad: float, turned_rad: float) -> Track:
    """A vehicle of one step in a scene that is turned about (40, −30)."""
    cos, sin = np.cos(turned_rad), np.sin(turned_rad)
    x, y = 40.0 + x_m * cos - y_m * sin, -30.0 + x_m * sin + y_m * cos
    return moving(x, y, 0.0, yaw_rad=yaw_rad + turned_rad, steps=1)


def sees(network: RoadNetwork, x_m: float, y_m: float, mount: Mount, turned_rad: float = 0.0, **view: float) -> bool:
    """Whether a vehicle that stands along x is seen from the origin, at 90 degrees and 50 m where nothing is said."""
    tracks = {1: placed(0.0, 0.0, 0.0, turned_rad), 2: placed(x_m, y_m, 0.0, turned_rad)}
    fov_rad, range_m = np.radians(view.get("fov_deg", 90.0)), view.get("range_m", 50.0)
    (visible,) = in_view(encounters_of(record_with(tracks, network), 1), mount, fov_rad, range_m).tolist()
    return bool(visible)


@pytest.mark.parametrize("turned_rad", TURNED_RAD)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_corner_at_the_edge_of_the_view(straight_road: RoadNetwork, side: float, turned_rad: float) -> None:
    """The corner that lies foremost and inmost is at 45° where it is as far ahead as aside."""
    eye = Mount(2.0, 0.0, 1.0)
    for aside_m, seen in ((9.95, True), (10.05, False)):
        x, y = 2.0 + 10.0 - 0.5 * LENGTH_M, side * (aside_m + 0.5 * WIDTH_M)
        assert sees(straight_road, x, y, eye, turned_rad=turned_rad) is seen


@pytest.mark.parametrize("turned_rad", TURNED_RAD)
def test_a_camera_that_is_not_in_the_middle_or_looks_to_the_left(straight_road: RoadNetwork, turned_rad: float) -> None:
    """1 m to the left it sees 1 m more on the left and 1 m less on the right."""
    eye = Mount(0.0, 1.0, 1.0)
    for y_m, seen in ((10.95, True), (11.05, False), (-8.95, True), (-9.05, False)):
        y = y_m + np.sign(y_m) * 0.5 * WIDTH_M
        assert sees(straight_road, 10.0 - 0.5 * LENGTH_M, y, eye, turned_rad=turned_rad) is seen
    eye = Mount(0.0, 0.0, 1.0, yaw_rad=np.pi / 2.0)
    for x, y, seen in ((0.0, 20.0, True), (0.0, -20.0, False), (20.0, 0.0, False)):
        assert sees(straight_road, x, y, eye, turned_rad=turned_rad) is seen


def test_the_range_is_from_the_camera_to_the_nearest_corner_and_behind_is_never_in_view(
    straight_road: RoadNetwork,
) -> None:
    eye = Mount(2.0, 0.0, 1.0)
    for x_m, seen in ((30.0, True), (30.2, False)):
        reach = np.hypot(30.1 - 2.0 - 0.5 * LENGTH_M, 0.5 * WIDTH_M)
        assert sees(straight_road, x_m, 0.0, eye, range_m=reach) is seen
    assert not sees(straight_road, -10.0, 0.0, Mount(0.0, 0.0, 1.0), fov_deg=170.0)


EMV = 1
FRONT = Camera(Mount(2.5, 0.0, 1.0), float(np.radians(100.0)))


def contacts_of(network: RoadNetwork, tracks: dict[int, Track], window: tuple[int, int], *events: Event) -> list[int]:
    """Steps of the contacts that count."""
    record = replace(record_with(tracks, network), events=events)
    return [contact.step for contact in evidence_of(record, EMV, FRONT, window).contacts]


def touch(step: int, first: int = 5, second: int = EMV) -> Event:
    return Event(step, EventKind.COLLISION, first, second, detail={"impact_speed_mps": 3.0})


def seen(
    network: RoadNetwork, others: dict[int, Track], steps: tuple[int, int] = (0, 40), yaw_rad: float = 0.0
) -> Evidence:
    tracks = {EMV: moving(0.0, 0.0, 10.0, yaw_rad=yaw_rad, steps=41, is_emv=True), **others}
    return evidence_of(record_with(tracks, network), EMV, FRONT, steps)


@pytest.mark.parametrize("turned_rad", [0.0, 1.1, -2.3])
def test_ahead_is_seen_and_behind_is_not(straight_road: RoadNetwork, turned_rad: float) -> None:
    """One stands ahead; another comes up from behind, faster than the EMV."""
    cos, sin = np.cos(turned_rad), np.sin(turned_rad)
    ahead = moving(30.0 * cos, 30.0 * sin, 0.0, yaw_rad=turned_rad, steps=41)
    behind = moving(-20.0 * cos, -20.0 * sin, 18.0, yaw_rad=turned_rad, steps=41)
    found = seen(straight_road, {5: ahead, 6: behind}, yaw_rad=turned_rad)
    assert set(found.moments.actor_id.tolist()) == {5}
    assert len(found.moments) > 10


@pytest.mark.parametrize("kind", [ActorClass.PEDESTRIAN, ActorClass.BICYCLE, ActorClass.MOTORCYCLE])
def test_people_are_civilians(straight_road: RoadNetwork, kind: ActorClass) -> None:
    """One crosses just before the EMV; then they touch."""
    crossing = moving(30.0, -12.8, 10.0, yaw_rad=np.pi / 2.0, steps=81, length_m=0.6, actor_class=kind)
    record = record_with({EMV: moving(0.0, 0.0, 15.0, steps=81, is_emv=True), 5: crossing}, straight_road)
    label = label_of(evidence_of(record, EMV, FRONT, (0, 81)), LIMITS)
    assert (label.risk, label.actor_id) == (RiskClass.NEAR_MISS, 5)
    touched = replace(record, events=(touch(30),))
    assert label_of(evidence_of(touched, EMV, FRONT, (0, 81)), LIMITS).reason is Reason.CONTACT


def test_numbers_of_a_moment(straight_road: RoadNetwork) -> None:
    """The EMV at 10 m/s, 30 m behind the centre of a standing car: 25.4 m of gap at step 0, 0.5 m less at each step."""
    found = seen(straight_road, {5: moving(30.0, 0.0, 0.0, steps=41)}, (4, 8)).moments
    gaps = 30.0 - 4.6 - 0.5 * np.arange(4, 8)
    assert found.gap_m == pytest.approx(gaps)
    assert found.time_to_collision_s == pytest.approx(gaps / 10.0)
    assert found.closing_mps == pytest.approx(np.full(4, 10.0))
    assert found.required_deceleration_mps2 == pytest.approx(100.0 / (2.0 * gaps))


@pytest.mark.parametrize(
    ("x_m", "steps", "window", "events", "counted"),
    [
        (20.0, 201, (20, 40), [touch(19), touch(20), touch(39), touch(40)], [20, 39]),
        (20.0, 30, (0, 60), [touch(30)], [30]),
        (20.0, 30, (0, 60), [touch(31)], []),
        (-6.0, 201, (0, 60), [touch(30)], []),
        (20.0, 201, (0, 100), [touch(9, 5, 6), touch(12, EMV, 5)], [12]),
    ],
    ids=["edges of the window", "a step after the last state", "two steps after it", "unseen, behind", "of others"],
)
def test_contacts_that_count(straight_road: RoadNetwork, x_m, steps, window, events, counted) -> None:
    others = {5: moving(x_m, 0.0, 0.0, steps=steps), 6: moving(90.0, 0.0, 0.0)}
    tracks = {EMV: moving(0.0, 0.0, 0.0, is_emv=True), **others}
    assert contacts_of(straight_road, tracks, window, *events) == counted


@pytest.mark.parametrize(
    ("place", "speed_mps", "window", "there"),
    [
        ((30.0, -8.0), 10.0, (0, 81), True),
        ((30.0, -8.0), 10.0, (0, 36), False),
        ((30.0, -8.0), 10.0, (38, 81), False),
        ((0.0, -30.0), 12.0, (0, 81), False),
    ],
)
def test_an_encroachment_lies_within_the_window_and_is_seen(
    straight_road: RoadNetwork, place: tuple[float, float], speed_mps: float, window: tuple[int, int], *, there: bool
) -> None:
    """A car crosses at about step 12 to 20, the EMV comes at about step 37; another crosses behind the EMV."""
    crossing = moving(*place, speed_mps, yaw_rad=np.pi / 2.0, steps=81)
    tracks = {EMV: moving(0.0, 0.0, 15.0, steps=81, is_emv=True), 5: crossing}
    assert bool(evidence_of(record_with(tracks, straight_road), EMV, FRONT, window).encroachments) is there


@pytest.mark.parametrize(("step", "counts"), [(49, True), (50, True), (51, False)])
def test_two_seconds_are_forty_steps(straight_road: RoadNetwork, step: int, *, counts: bool) -> None:
    """A car is ahead up to step 9 and behind from step 10 on; the step of a contact may be the first of touching."""
    states = np.zeros((60, 5))
    states[:, 0] = np.where(np.arange(60) < 10, 20.0, -20.0)
    tracks = {EMV: moving(0.0, 0.0, 0.0, steps=60, is_emv=True), 5: Track(states)}
    assert contacts_of(straight_road, tracks, (0, 60), touch(step)) == [step] * counts


def test_a_part_of_the_evidence_ends_before_its_last_step() -> None:
    steps = np.arange(10, 20)
    numbers = (np.full(10, 5, np.uint32), *(np.arange(10.0) + number for number in range(5)))
    found = Evidence(
        Moments(steps, *numbers),
        tuple(SeenEncroachment(5, step, 1.0) for step in (11, 12, 15, 16)),
        tuple(SeenContact(5, step, 2.0) for step in (11, 12, 15, 16)),
    ).within(12, 16)
    assert found.moments.step.tolist() == [12, 13, 14, 15]
    assert found.moments.time_to_collision_s.tolist() == [2.0, 3.0, 4.0, 5.0]
    assert [one.step for one in found.encroachments] == [12, 15]
    assert [one.step for one in found.contacts] == [12, 15]


def test_all_conflicts_that_three_emvs_see() -> None:
    camera, found = Camera(Mount(1.5, 0.2, 1.4, 0.1), 1.9), {}
    for emv_id in (FIRST, BEHIND, CROSSING):
        seen = evidence_of(busy_record(), emv_id, camera, (20, 310))
        short = seen.within(100, 200)
        found[str(emv_id)] = {
            "moments": {name: values[:: max(len(values) // 12, 1)] for name, values in vars(seen.moments).items()},
            "encroachments": seen.encroachments,
            "contacts": seen.contacts,
            "short": (len(short.moments), short.encroachments, short.contacts),
            **{name: [label_of(one, limits) for one in (seen, short)] for name, limits in DEFINITIONS.items()},
        }
    assert_known(Path(__file__).parent / "known" / "labels.json", found, digits=5)
