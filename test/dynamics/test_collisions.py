import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.dynamics.collisions import SEPARATION_GAP_M, Footprints, find_contacts
from siren_ros.numerics.geometry import footprint_corners, separation_m

LENGTH_M, WIDTH_M = 4.0, 2.0


def _boxes(*rows: tuple[float, float, float, float, float], rate: tuple[float, ...] | None = None) -> Footprints:
    """Rows of x, y, yaw, vx, vy; ids 1, 2, …"""
    x, y, yaw, vx, vy = np.array(rows, dtype=np.float64).reshape(-1, 5).T
    n = len(x)
    rates = np.zeros(n) if rate is None else np.array(rate)
    ids = np.arange(1, n + 1, dtype=np.uint32)
    return Footprints(ids, x, y, yaw, vx, vy, rates, np.full(n, LENGTH_M), np.full(n, WIDTH_M))


def test_two_boxes_meet_at_the_known_time_and_speed() -> None:
    gap_m, closing_mps, step_s = 10.0, 8.0, 0.05
    touching: tuple[tuple[int, int], ...] = ()
    found = []
    for step in range(60):
        rear_x = closing_mps * step * step_s
        boxes = _boxes((rear_x, 0.0, 0.0, closing_mps, 0.0), (LENGTH_M + gap_m, 0.3, 0.0, 0.0, 0.0))
        contacts, touching = find_contacts(boxes, touching)
        found += [(step, contact) for contact in contacts]
    assert len(found) == 1
    step, contact = found[0]
    assert step == int(np.ceil(gap_m / closing_mps / step_s))
    assert (contact.actor_id, contact.other_id) == (1, 2)
    assert contact.impact_speed_mps == pytest.approx(closing_mps)
    assert contact.x_m == pytest.approx(LENGTH_M / 2.0 + gap_m, abs=0.4)
    assert contact.y_m == pytest.approx(0.15)


def test_rear_impact_with_small_sideways_overlap_has_the_longitudinal_speed() -> None:
    boxes = _boxes((0.0, 0.0, 0.0, 12.0, 0.0), (3.5, 1.9, 0.0, 2.0, 0.0))
    (contact,), _ = find_contacts(boxes, ())
    assert contact.impact_speed_mps == pytest.approx(10.0)


def test_side_swipe_has_only_the_lateral_speed() -> None:
    boxes = _boxes((0.0, 0.0, 0.0, 10.0, 0.5), (0.5, 1.98, 0.0, 8.0, 0.0))
    (contact,), _ = find_contacts(boxes, ())
    assert contact.impact_speed_mps == pytest.approx(0.5)


def test_crossing_impact() -> None:
    boxes = _boxes((0.0, 0.0, 0.0, 10.0, 0.0), (2.8, 0.0, np.pi / 2.0, 0.0, 6.0))
    (contact,), _ = find_contacts(boxes, ())
    assert contact.impact_speed_mps == pytest.approx(10.0)
    assert contact.x_m == pytest.approx(1.9)
    assert contact.y_m == pytest.approx(0.0, abs=1e-9)


def test_a_turning_tail_hits_with_the_speed_of_its_corner() -> None:
    boxes = _boxes((0.0, 0.0, 0.0, 0.0, 0.0), (3.9, 0.0, 0.0, 0.0, 0.0), rate=(0.0, 0.0))
    (still,), _ = find_contacts(boxes, ())
    assert still.impact_speed_mps == 0.0
    boxes = _boxes((0.0, 0.0, 0.0, 0.0, 0.0), (1.9, 1.99, 0.0, 0.0, 0.0), rate=(0.0, 1.0))
    (turning,), _ = find_contacts(boxes, ())
    assert turning.impact_speed_mps == pytest.approx(1.9 - turning.x_m, rel=1e-6)
    assert turning.impact_speed_mps > 0.5


def test_a_lasting_contact_is_one_event_until_it_ends() -> None:
    touching: tuple[tuple[int, int], ...] = ()
    distances = [4.2, 3.99, 3.8, 4.0 + 0.5 * SEPARATION_GAP_M, 3.99, 4.0 + 2.0 * SEPARATION_GAP_M, 3.99]
    counts = []
    for distance in distances:
        contacts, touching = find_contacts(_boxes((0.0, 0.0, 0.0, 0.0, 0.0), (distance, 0.0, 0.0, 0.0, 0.0)), touching)
        counts.append(len(contacts))
    assert counts == [0, 1, 0, 0, 0, 0, 1]


def test_boxes_that_touch_exactly_have_a_place() -> None:
    (contact,), touching = find_contacts(_boxes((0.0, 0.0, 0.0, 1.0, 0.0), (4.0, 0.0, 0.0, 0.0, 0.0)), ())
    assert (contact.x_m, contact.y_m) == pytest.approx((2.0, 0.0))
    assert contact.impact_speed_mps == pytest.approx(1.0)
    assert touching == ((1, 2),)


def test_several_contacts_come_sorted() -> None:
    rows = [(3.0 * k, 0.0, 0.0, 0.0, 0.0) for k in range(4)]
    contacts, touching = find_contacts(_boxes(*rows), ())
    assert [(c.actor_id, c.other_id) for c in contacts] == [(1, 2), (2, 3), (3, 4)]
    assert touching == ((1, 2), (2, 3), (3, 4))


@pytest.mark.parametrize("count", [0, 1])
def test_few_vehicles_touch_nobody(count: int) -> None:
    boxes = _boxes(*[(0.0, 0.0, 0.0, 0.0, 0.0)] * count)
    assert find_contacts(boxes, ()) == ((), ())


@settings(max_examples=60, deadline=None)
@given(
    x=st.floats(-6.0, 6.0),
    y=st.floats(-6.0, 6.0),
    yaw=st.floats(-3.1, 3.1),
    vx=st.floats(-20.0, 20.0),
    vy=st.floats(-20.0, 20.0),
    frame=st.floats(-3.1, 3.1),
)
def test_contacts_do_not_depend_on_the_frame(
    x: float, y: float, yaw: float, vx: float, vy: float, frame: float
) -> None:
    here, _ = find_contacts(_boxes((0.0, 0.0, 0.0, 0.0, 0.0), (x, y, yaw, vx, vy)), ())
    cos, sin = np.cos(frame), np.sin(frame)
    turned = (x * cos - y * sin, x * sin + y * cos, yaw + frame, vx * cos - vy * sin, vx * sin + vy * cos)
    there, _ = find_contacts(_boxes((0.0, 0.0, frame, 0.0, 0.0), turned), ())
    if here and there:  # at a gap of zero, rounding decides whether they touch
        assert there[0].x_m == pytest.approx(here[0].x_m * cos - here[0].y_m * sin, abs=1e-6)
        assert 0.0 <= here[0].impact_speed_mps <= np.hypot(vx, vy) + 1e-9
        assert np.hypot(here[0].x_m, here[0].y_m) < np.hypot(LENGTH_M, WIDTH_M) / 2.0 + 1e-6
    elif here or there:
        boxes = _boxes((0.0, 0.0, 0.0, 0.0, 0.0), (x, y, yaw, vx, vy))
        corners = footprint_corners(boxes.x_m, boxes.y_m, boxes.yaw_rad, boxes.length_m, boxes.width_m)
        assert abs(separation_m(corners[:1], corners[1:])[0]) < 1e-9
