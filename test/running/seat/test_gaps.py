import pytest
from made_sights import LIMIT_MPS, car, sight

from siren_ros.running.seat.gaps import is_free


@pytest.mark.parametrize(
    ("gap_m", "left_m", "speed_mps", "free"),
    [
        (-3.0, -3.5, LIMIT_MPS, False),  # beside it, where it goes
        (-3.0, 3.5, LIMIT_MPS, True),  # on the other side
        (-3.0, -7.0, LIMIT_MPS, True),  # farther away than it goes
        (-3.0, -1.8, LIMIT_MPS, False),  # on the way there
        (-12.0, -3.5, LIMIT_MPS, True),  # behind, as fast
        (-12.0, -3.5, LIMIT_MPS + 4.0, False),  # comes
        (5.0, -3.5, LIMIT_MPS, True),  # ahead, as fast
        (5.0, -3.5, LIMIT_MPS - 4.0, False),  # is caught up with
    ],
)
def test_a_move_to_the_right_needs_a_gap(gap_m, left_m, speed_mps, free) -> None:
    seen = sight(others=(car(gap_m, left_m, speed_mps),))
    assert is_free(-3.5, seen) is free
    assert is_free(0.0, seen), "nobody is in the own place"


def test_somebody_who_is_too_near_already_does_not_keep_it_from_going_away() -> None:
    seen = sight(left_m=-2.5, others=(car(-3.0, -3.5, LIMIT_MPS),))
    assert is_free(0.0, seen)
    assert not is_free(-3.0, seen)
