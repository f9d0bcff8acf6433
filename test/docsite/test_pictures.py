import numpy as np
import pytest
from hand_made_record import EASTBOUND, LEFT_X_M, NORTHBOUND, SOUTHBOUND, Driven, at_speed, crossing, hand_made, line

from docsite.pictures import film_start_s
from docsite.sensor_pictures import tiled, vehicles_ahead


@pytest.mark.parametrize(
    ("site_time_s", "duration_s", "start_s"),
    [
        (30.0, 45.0, 11.0),  # 26 s that end 7 s after the site
        (44.0, 45.0, 19.0),  # the episode ends before that
        (9.0, 45.0, 0.0),  # the EMV is there soon
        (None, 40.0, 14.0),  # never
    ],
)
def test_a_film_shows_the_way_to_the_site(site_time_s: float | None, duration_s: float, start_s: float) -> None:
    assert film_start_s(site_time_s, duration_s) == start_s


def test_pictures_are_tiled_row_by_row() -> None:
    shades = [np.full((2, 3, 3), shade, np.uint8) for shade in (10, 20, 30)]
    whole = tiled(shades, 2)
    assert whole.shape == (8, 10, 3)
    assert [whole[0, 0, 0], whole[1, 9, 0], whole[7, 2, 0], whole[7, 9, 0], whole[3, 0, 0]] == [10, 20, 30, 0, 0]


def test_the_vehicles_ahead_are_those_of_its_direction_nearest_first() -> None:
    left = line((LEFT_X_M, -120.0), (LEFT_X_M, 110.0))
    starts = {1: (NORTHBOUND, 40.0), 2: (NORTHBOUND, 90.0), 3: (left, 60.0), 4: (NORTHBOUND, 20.0)}
    starts |= {5: (SOUTHBOUND, 100.0), 6: (EASTBOUND, 100.0)}
    record = hand_made(crossing(), {key: Driven(path, at_speed(at, 5.0, 20)) for key, (path, at) in starts.items()})
    assert vehicles_ahead(record, 0.5, 2) == [3, 2]
    assert vehicles_ahead(record, 0.5, 1) == [3]
