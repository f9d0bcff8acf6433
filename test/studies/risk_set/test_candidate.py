"""The window of a video lies within the EMV's time, with the decisive moment inside."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.studies.risk_set.candidate import FRAME_STEPS, WINDOW_STEPS, window_start


@given(begin=st.integers(0, 50), length=st.integers(0, 600), share=st.floats(0.0, 1.0), seed=st.integers(0, 1000))
def test_the_window_is_inside_and_shows_the_moment(begin: int, length: int, share: float, seed: int) -> None:
    end = begin + WINDOW_STEPS + FRAME_STEPS + length
    moment = begin + int(share * (end - begin - 1))
    first = window_start(moment, begin, end, seed)
    assert first % FRAME_STEPS == 0
    assert begin <= first
    assert first + WINDOW_STEPS <= end
    assert first - FRAME_STEPS < moment < first + WINDOW_STEPS + FRAME_STEPS


def test_the_moments_place_is_drawn_between_40_and_80_percent() -> None:
    places = [(2000 - window_start(2000, 0, 4000, seed)) / WINDOW_STEPS for seed in range(200)]
    assert 0.39 < min(places) < 0.45
    assert 0.75 < max(places) < 0.81
    assert sum(places) / len(places) == pytest.approx(0.6, abs=0.02)
