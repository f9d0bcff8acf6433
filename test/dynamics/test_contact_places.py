"""Where vehicles touch, how fast they meet there, and who is near enough; at any place and turn."""

import numpy as np
import pytest

from siren_ros.dynamics.collisions import Footprints, find_contacts, overlapping
from siren_ros.numerics.geometry import rotate

PLACES = [(0.0, 0.0), (40.0, -70.0), (-25.0, 60.0)]
TURNS = np.radians([0.0, 35.0, 110.0, -140.0])


def boxes(place, turn, *rows):
    """Rows of x, y, yaw, vx, vy, yaw rate of vehicles of 4 m by 2 m, all turned about the origin and moved."""
    x, y, yaw, vx, vy, rate = np.array(rows, dtype=float).T
    at = rotate(np.stack((x, y), axis=-1), turn) + place
    velocity = rotate(np.stack((vx, vy), axis=-1), turn)
    n = len(rows)
    ids = np.arange(1, n + 1, dtype=np.uint32)
    return Footprints(ids, *at.T, yaw + turn, *velocity.T, rate, length_m=np.full(n, 4.0), width_m=np.full(n, 2.0))


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("side", "rate", "speed"), [(1, 2.0, 3.0), (-1, -2.0, 3.0), (-1, 2.0, 0.0), (1, -2.0, 0.0)])
def test_a_spinning_vehicle_meets_another_one_with_the_speed_of_the_point_of_contact(place, turn, side, rate, speed):
    """The bodies overlap by 1 m along and 5 cm across; the middle of that is 1.5 m ahead of who spins."""
    rows = [(0.0, 0.0, 0.0, 0.0, 0.0, rate), (3.0, side * 1.95, 0.0, 0.0, 0.0, 0.0)]
    (contact,), _ = find_contacts(boxes(place, turn, *rows), frozenset())
    at = rotate(np.array([contact.x_m, contact.y_m]) - place, -turn)
    assert at == pytest.approx([1.5, side * 0.975])
    assert contact.impact_speed_mps == pytest.approx(speed)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("ahead", "closing"), [(3.95, 6.0), (-3.95, -6.0)])
def test_head_on_the_impact_speed_is_the_difference_of_velocities(place, turn, ahead, closing):
    rows = [(0.0, 0.0, 0.0, closing, 0.0, 0.0), (ahead, 0.0, 0.0, closing - np.sign(ahead) * 6.0, 0.0, 0.0)]
    (contact,), _ = find_contacts(boxes(place, turn, *rows), frozenset())
    assert contact.impact_speed_mps == pytest.approx(6.0)
    at = rotate(np.array([contact.x_m, contact.y_m]) - place, -turn)
    assert at == pytest.approx([ahead / 2.0, 0.0], abs=0.05)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(
    ("x", "y", "touches"),
    [
        (3.99, 0.0, True),
        (4.3, 0.0, False),
        (0.0, 1.99, True),
        (0.0, 2.3, False),
        (3.9, 1.9, True),
        (3.9, -1.9, True),
        (4.3, 2.3, False),
    ],
)
def test_bodies_touch_or_not(turn, x, y, touches):
    pair = boxes((7.0, 9.0), turn, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0), (x, y, 0.0, 0.0, 0.0, 0.0))
    contacts, touching = find_contacts(pair, frozenset())
    assert bool(contacts) is touches
    assert bool(touching) is touches


def test_of_pairs_that_touch_those_that_overlap_are_told_by_their_rows():
    """Actors 1 and 2 touch with a gap, 2 and 3 overlap, 1 and 4 are far apart."""
    rows = [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (4.01, 0.0, 0.0, 0.0, 0.0, 0.0)]
    rows += [(7.9, 0.5, 0.0, 0.0, 0.0, 0.0), (50.0, 50.0, 0.0, 0.0, 0.0, 0.0)]
    assert overlapping(boxes((3.0, -4.0), 0.6, *rows), ((1, 2), (1, 4), (2, 3))) == ((1, 2),)
    assert overlapping(boxes((3.0, -4.0), 0.6, *rows), ()) == ()
