import numpy as np
import pytest
from hand_made_record import NORTHBOUND, SOUTHBOUND, Driven, at_speed
from hypothesis import given
from hypothesis import strategies as st
from repository import REPOSITORY
from seen_on_crossing import sight_at

from siren_ros.running.seat.features import EMV, NEIGHBOUR, NEIGHBOURS, OWN, SIZE, features_of
from siren_ros.simulation.world.actors import Lights

_SPACING = 1.5 / 60.0
"""A way knows its lines to a metre."""


def named(vector: np.ndarray) -> dict[str, float]:
    """The numbers of the own vehicle and the EMV by name."""
    names = [feature.name for feature in (*OWN, *EMV)]
    return dict(zip(names, vector.tolist(), strict=False))


def neighbours(vector: np.ndarray) -> list[dict[str, float]]:
    names = [feature.name for feature in NEIGHBOUR]
    rows = vector[len(OWN) + len(EMV) :].reshape(NEIGHBOURS, len(NEIGHBOUR)).tolist()
    return [dict(zip(names, row, strict=True)) for row in rows]


def test_the_own_numbers_are_those_of_the_scene() -> None:
    sight = sight_at(own_m=50.0, own_mps=10.0, aside_m=(0.5, 0.5), lights=int(Lights.INDICATOR_RIGHT))
    own = named(features_of(sight))
    assert own["speed"] == pytest.approx(10.0 / 25.0)
    assert own["offset"] == pytest.approx(0.5 / 8.0)
    assert own["heading"] == pytest.approx(0.0, abs=1e-7)
    assert (own["indicator_left"], own["indicator_right"]) == (0.0, 1.0)
    assert (own["lanes_left"], own["lanes_right"]) == (0.25, 0.0)
    assert own["right_edge"] == pytest.approx((0.5 + 1.75 + 2.5) / 10.0)
    assert own["limit"] == pytest.approx(13.9 / 25.0)
    assert own["in_junction"] == 0.0
    assert own["rest"] == pytest.approx((230.0 - 50.5) / 500.0)
    assert own["line"] == pytest.approx((100.0 - 52.5) / 60.0, abs=_SPACING)


@pytest.mark.parametrize(("signal", "near"), [("rrrrrrr", True), ("yyyyyyy", True), ("GGGGGGG", False), ("", False)])
def test_a_red_line_is_seen_before_it(signal: str, near: bool) -> None:
    red = named(features_of(sight_at(signal=signal)))["red"]
    assert red == (pytest.approx((100.0 - 52.5) / 60.0, abs=_SPACING) if near else 1.0)


def test_the_emv_is_seen_in_the_own_frame() -> None:
    seen = named(features_of(sight_at(own_m=50.0, emv_m=20.0, emv_mps=12.0, own_mps=12.0, aside_m=(1.0, 1.0))))
    assert seen["emv_here"] == seen["emv_siren"] == seen["emv_behind"] == 1.0
    assert seen["emv_x"] == pytest.approx(-30.0 / 100.0)
    assert seen["emv_y"] == pytest.approx(-1.0 / 20.0)
    assert seen["emv_speed"] == pytest.approx(12.0 / 25.0)
    assert (seen["emv_cos"], seen["emv_sin"]) == pytest.approx((1.0, 0.0), abs=1e-7)
    assert named(features_of(sight_at(own_m=50.0, emv_m=80.0)))["emv_behind"] == 0.0


def test_neighbours_come_by_their_distance_without_the_emv() -> None:
    others = {
        3: Driven(NORTHBOUND, at_speed(70.0, 4.0, 2)),
        4: Driven(SOUTHBOUND, at_speed(170.0, 10.0, 2)),
    }
    vector = features_of(sight_at(others=others))
    first, second, *rest = neighbours(vector)
    # 4 goes south: it is at y = -60.5 m, 9 m ahead of the own place (y = -69.5 m), and 7 m to the left
    assert (first["x"], first["y"]) == pytest.approx((9.0 / 80.0, 7.0 / 20.0))
    assert first["vx"] == pytest.approx(-20.0 / 25.0)
    assert (first["cos"], first["sin"]) == pytest.approx((-1.0, 0.0), abs=1e-7)
    assert (second["x"], second["y"]) == pytest.approx((19.7 / 80.0, 0.0), abs=1e-7)
    assert second["vx"] == pytest.approx(-6.0 / 25.0)
    assert (second["length"], second["width"]) == pytest.approx((4.0 / 20.0, 1.8 / 4.0))
    assert all(set(row.values()) == {0.0} for row in rest)


@given(st.floats(0.0, 220.0), st.floats(0.0, 60.0), st.floats(0.0, 220.0), st.floats(-30.0, 30.0))
def test_every_number_stays_within_its_bounds(own_m: float, own_mps: float, emv_m: float, aside_m: float) -> None:
    vector = features_of(sight_at(own_m, own_mps, emv_m, aside_m=(aside_m, aside_m)))
    assert vector.shape == (SIZE,)
    assert vector.dtype == np.float32
    assert (np.abs(vector) <= 1.0).all()


def test_the_page_has_the_size() -> None:
    assert f"Box(-1, 1, ({SIZE},), float32)" in (REPOSITORY / "docs" / "learning.md").read_text(encoding="utf-8")
