"""Who is in view, at the edges of the view, from cameras that are moved and turned on the vehicle."""

from dataclasses import replace

import numpy as np
import pytest
from evaluation.made_records import Track, moving, record_with

from siren_ros.evaluation.risk.labels import (
    SEEN_BEFORE_STEPS,
    Camera,
    Evidence,
    Moments,
    SeenContact,
    SeenEncroachment,
    evidence_of,
    in_view,
)
from siren_ros.evaluation.surrogate_safety import encounters_of
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.sensors.specification import Mount
from siren_ros.world.traffic_state import Event, EventKind

LENGTH_M, WIDTH_M = 4.6, 1.8
TURNED_RAD = [0.0, 0.8, -2.4]


def placed(x_m: float, y_m: float, yaw_rad: float, turned_rad: float) -> Track:
    """A vehicle of one step in a scene that is turned about (40, −30)."""
    cos, sin = np.cos(turned_rad), np.sin(turned_rad)
    return moving(
        40.0 + x_m * cos - y_m * sin, -30.0 + x_m * sin + y_m * cos, 0.0, yaw_rad=yaw_rad + turned_rad, steps=1
    )


def sees(
    network: RoadNetwork,
    x_m: float,
    y_m: float,
    mount: Mount,
    fov_deg: float = 90.0,
    range_m: float = 50.0,
    turned_rad: float = 0.0,
) -> bool:
    """Whether a vehicle that stands along x is seen from the origin."""
    tracks = {1: placed(0.0, 0.0, 0.0, turned_rad), 2: placed(x_m, y_m, 0.0, turned_rad)}
    (found,) = in_view(encounters_of(record_with(tracks, network), 1), mount, np.radians(fov_deg), range_m).tolist()
    return bool(found)


@pytest.mark.parametrize("turned_rad", TURNED_RAD)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_corner_at_the_edge_of_the_view(straight_road: RoadNetwork, side: float, turned_rad: float) -> None:
    """The corner that lies foremost and inmost is at 45° where it is as far ahead as aside."""
    eye = Mount(2.0, 0.0, 1.0)
    for aside_m, seen in ((9.95, True), (10.05, False)):
        x, y = 2.0 + 10.0 - 0.5 * LENGTH_M, side * (aside_m + 0.5 * WIDTH_M)
        assert sees(straight_road, x, y, eye, turned_rad=turned_rad) is seen


@pytest.mark.parametrize("turned_rad", TURNED_RAD)
def test_a_camera_that_is_not_in_the_middle(straight_road: RoadNetwork, turned_rad: float) -> None:
    """1 m to the left it sees 1 m more on the left and 1 m less on the right."""
    eye = Mount(0.0, 1.0, 1.0)
    for y_m, seen in ((10.95, True), (11.05, False), (-8.95, True), (-9.05, False)):
        y = y_m + np.sign(y_m) * 0.5 * WIDTH_M
        assert sees(straight_road, 10.0 - 0.5 * LENGTH_M, y, eye, turned_rad=turned_rad) is seen


@pytest.mark.parametrize("turned_rad", TURNED_RAD)
def test_a_camera_that_looks_to_the_left(straight_road: RoadNetwork, turned_rad: float) -> None:
    eye = Mount(0.0, 0.0, 1.0, yaw_rad=np.pi / 2.0)
    assert sees(straight_road, 0.0, 20.0, eye, turned_rad=turned_rad)
    assert not sees(straight_road, 0.0, -20.0, eye, turned_rad=turned_rad)
    assert not sees(straight_road, 20.0, 0.0, eye, turned_rad=turned_rad)


def test_the_range_is_from_the_camera_to_the_nearest_corner(straight_road: RoadNetwork) -> None:
    eye = Mount(2.0, 0.0, 1.0)
    for x_m, seen in ((30.0, True), (30.2, False)):
        reach = np.hypot(30.1 - 2.0 - 0.5 * LENGTH_M, 0.5 * WIDTH_M)
        assert sees(straight_road, x_m, 0.0, eye, range_m=reach) is seen


def test_behind_is_never_in_view(straight_road: RoadNetwork) -> None:
    assert not sees(straight_road, -10.0, 0.0, Mount(0.0, 0.0, 1.0), fov_deg=170.0)


EMV = 1
FRONT = Camera(Mount(2.5, 0.0, 1.0), float(np.radians(100.0)))


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


def test_the_window_limits_the_evidence(straight_road: RoadNetwork) -> None:
    found = seen(straight_road, {5: moving(30.0, 0.0, 0.0, steps=41)}, (10, 20))
    assert found.moments.step.tolist() == list(range(10, 20))


def test_who_was_seen_counts_for_two_seconds(straight_road: RoadNetwork) -> None:
    """The EMV passes a standing car within a second: a contact soon after counts, one much later does not."""
    count = SEEN_BEFORE_STEPS + 60
    tracks = {EMV: moving(0.0, 0.0, 10.0, steps=count, is_emv=True), 5: moving(6.0, 3.0, 0.0, steps=count)}
    soon = Event(30, EventKind.COLLISION, EMV, 5, detail={"impact_speed_mps": 2.0})
    late = replace(soon, step=SEEN_BEFORE_STEPS + 50)
    record = replace(record_with(tracks, straight_road), events=(soon, late))
    assert [one.step for one in evidence_of(record, EMV, FRONT, (0, count)).contacts] == [30]


def test_contacts_of_others_are_not_the_emvs(straight_road: RoadNetwork) -> None:
    tracks = {EMV: moving(0.0, 0.0, 0.0, is_emv=True), 5: moving(20.0, 0.0, 0.0), 6: moving(26.0, 0.0, 0.0)}
    record = record_with(tracks, straight_road)
    events = (
        Event(9, EventKind.COLLISION, 5, 6, detail={"impact_speed_mps": 3.0}),
        Event(12, EventKind.COLLISION, 6, EMV, detail={"impact_speed_mps": 2.5}),
    )
    found = evidence_of(replace(record, events=events), EMV, FRONT, (0, 100))
    assert [(one.actor_id, one.step, one.impact_mps) for one in found.contacts] == [(6, 12, 2.5)]


def test_a_vehicle_that_crosses_just_before(straight_road: RoadNetwork) -> None:
    crossing = moving(30.0, -6.0, 10.0, yaw_rad=np.pi / 2.0, steps=81)
    tracks = {EMV: moving(0.0, 0.0, 15.0, steps=81, is_emv=True), 5: crossing}
    found = evidence_of(record_with(tracks, straight_road), EMV, FRONT, (0, 81))
    (encroachment,) = found.encroachments
    assert encroachment.actor_id == 5
    assert 0.3 < encroachment.time_s < 1.3


def test_numbers_of_a_moment(straight_road: RoadNetwork) -> None:
    """The EMV at 10 m/s, 30 m behind the centre of a standing car: 25.4 m of gap at step 0, 0.5 m less at each step."""
    found = seen(straight_road, {5: moving(30.0, 0.0, 0.0, steps=41)}, (4, 8)).moments
    gaps = 30.0 - 4.6 - 0.5 * np.arange(4, 8)
    assert found.gap_m == pytest.approx(gaps)
    assert found.time_to_collision_s == pytest.approx(gaps / 10.0)
    assert found.closing_mps == pytest.approx(np.full(4, 10.0))
    assert found.required_deceleration_mps2 == pytest.approx(100.0 / (2.0 * gaps))


def test_a_contact_at_the_windows_edges(straight_road: RoadNetwork) -> None:
    tracks = {EMV: moving(0.0, 0.0, 0.0, is_emv=True), 5: moving(20.0, 0.0, 0.0)}
    events = tuple(
        Event(step, EventKind.COLLISION, 5, EMV, detail={"impact_speed_mps": 3.0}) for step in (19, 20, 39, 40)
    )
    record = replace(record_with(tracks, straight_road), events=events)
    assert [one.step for one in evidence_of(record, EMV, FRONT, (20, 40)).contacts] == [20, 39]


def test_a_car_that_stays_behind_touches_unseen(straight_road: RoadNetwork) -> None:
    tracks = {EMV: moving(0.0, 0.0, 0.0, is_emv=True), 5: moving(-6.0, 0.0, 0.0)}
    event = Event(30, EventKind.COLLISION, 5, EMV, detail={"impact_speed_mps": 3.0})
    record = replace(record_with(tracks, straight_road), events=(event,))
    assert evidence_of(record, EMV, FRONT, (0, 60)).contacts == ()


def test_a_contact_may_be_told_a_step_after_the_last_state(straight_road: RoadNetwork) -> None:
    tracks = {EMV: moving(0.0, 0.0, 0.0, is_emv=True), 5: moving(20.0, 0.0, 0.0, steps=30)}
    for step, counts in ((30, True), (31, False)):
        event = Event(step, EventKind.COLLISION, 5, EMV, detail={"impact_speed_mps": 3.0})
        record = replace(record_with(tracks, straight_road), events=(event,))
        assert bool(evidence_of(record, EMV, FRONT, (0, 60)).contacts) is counts


@pytest.mark.parametrize(("window", "there"), [((0, 81), True), ((0, 36), False), ((38, 81), False)])
def test_an_encroachment_lies_within_the_window(
    straight_road: RoadNetwork, window: tuple[int, int], *, there: bool
) -> None:
    """A car crosses at about step 12 to 20, the EMV comes at about step 37."""
    crossing = moving(30.0, -8.0, 10.0, yaw_rad=np.pi / 2.0, steps=81)
    tracks = {EMV: moving(0.0, 0.0, 15.0, steps=81, is_emv=True), 5: crossing}
    found = evidence_of(record_with(tracks, straight_road), EMV, FRONT, window)
    assert bool(found.encroachments) is there


def test_who_crosses_behind_the_camera_is_no_encroachment(straight_road: RoadNetwork) -> None:
    """The car comes out of a side road after the EMV has passed, and was never seen."""
    crossing = moving(0.0, -30.0, 12.0, yaw_rad=np.pi / 2.0, steps=81)
    tracks = {EMV: moving(0.0, 0.0, 15.0, steps=81, is_emv=True), 5: crossing}
    assert evidence_of(record_with(tracks, straight_road), EMV, FRONT, (0, 81)).encroachments == ()


@pytest.mark.parametrize(("step", "counts"), [(49, True), (50, True), (51, False)])
def test_two_seconds_are_forty_steps(straight_road: RoadNetwork, step: int, *, counts: bool) -> None:
    """A car is ahead up to step 9 and behind from step 10 on; the step of a contact may be the first of touching."""
    states = np.zeros((60, 5))
    states[:, 0] = np.where(np.arange(60) < 10, 20.0, -20.0)
    tracks = {EMV: moving(0.0, 0.0, 0.0, steps=60, is_emv=True), 5: Track(states)}
    event = Event(step, EventKind.COLLISION, 5, EMV, detail={"impact_speed_mps": 3.0})
    record = replace(record_with(tracks, straight_road), events=(event,))
    assert bool(evidence_of(record, EMV, FRONT, (0, 60)).contacts) is counts


def test_a_part_of_the_evidence_ends_before_its_last_step() -> None:
    steps = np.arange(10, 20)
    numbers = (np.full(10, 5, np.uint32), *(np.arange(10.0) + number for number in range(4)))
    found = Evidence(
        Moments(steps, *numbers),
        tuple(SeenEncroachment(5, step, 1.0) for step in (11, 12, 15, 16)),
        tuple(SeenContact(5, step, 2.0) for step in (11, 12, 15, 16)),
    ).within(12, 16)
    assert found.moments.step.tolist() == [12, 13, 14, 15]
    assert found.moments.time_to_collision_s.tolist() == [2.0, 3.0, 4.0, 5.0]
    assert [one.step for one in found.encroachments] == [12, 15]
    assert [one.step for one in found.contacts] == [12, 15]
