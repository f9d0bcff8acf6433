"""NGSIM's lane numbers, cells, manoeuvres and classes of vehicles, each on both sides of its limit."""

import numpy as np
import pytest
from made_streets import A_LEFT, A_RIGHT, B_LEFT, B_RIGHT, NEAR, streets

from siren_ros.datasets.ngsim_frame import (
    ACCELERATE,
    BRAKE,
    KEEP,
    LEFT,
    NORMAL,
    OUTSIDE,
    RIGHT,
    grid_cells,
    lane_numbers,
    lanes_to_the_right,
    lateral_class,
    longitudinal_class,
    vehicle_class,
)
from siren_ros.roads.road_network import NO_LANE
from siren_ros.world.actors import ActorClass

ROADS = streets()
PRESENT = 50


def test_lanes_are_numbered_from_the_left() -> None:
    numbers = lane_numbers(ROADS)
    assert [numbers[lane] for lane in (A_LEFT, A_RIGHT, B_LEFT, B_RIGHT, NEAR)] == [1, 2, 1, 2, 1]


@pytest.mark.parametrize(
    ("lanes", "to_the_right"),
    [
        ((A_LEFT, A_RIGHT, A_RIGHT, A_LEFT), [0, 1, 1, 0]),
        ((A_RIGHT, A_LEFT, A_LEFT), [0, -1, -1]),
        ((A_RIGHT, B_LEFT, B_LEFT), [0, 0, 0]),
        ((A_LEFT, NO_LANE, A_RIGHT, A_LEFT), [0, 0, 0, -1]),
        ((A_LEFT, A_RIGHT, B_RIGHT, B_LEFT), [0, 1, 1, 0]),
    ],
)
def test_changes_of_one_road_count_to_the_right(lanes: tuple[int, ...], to_the_right: list[int]) -> None:
    numbers = {**lane_numbers(ROADS), NO_LANE: 0}
    there = np.array([numbers[lane] for lane in lanes], dtype=np.int64)
    assert lanes_to_the_right(ROADS, np.array(lanes, dtype=np.int32), there).tolist() == to_the_right


@pytest.mark.parametrize(("change", "turn"), [(1.0, RIGHT), (-1.0, LEFT)])
@pytest.mark.parametrize(
    ("at", "seen"), [(PRESENT - 40, False), (PRESENT - 39, True), (PRESENT + 40, True), (PRESENT + 41, False)]
)
def test_a_change_within_4_s_before_or_after_is_a_manoeuvre(change: float, turn: int, at: int, seen: bool) -> None:
    lanes = np.where(np.arange(120) >= at, 5.0 + change, 5.0)
    assert lateral_class(lanes, PRESENT) == (turn if seen else KEEP)


@pytest.mark.parametrize(
    ("past", "coming", "kind"),
    [
        (10.0, 7.9, BRAKE),
        (10.0, 8.1, NORMAL),
        (10.0, 12.4, NORMAL),
        (10.0, 12.6, ACCELERATE),
        (0.0, 1.0, ACCELERATE),
        (0.0, 0.0, NORMAL),
    ],
)
def test_who_is_slower_or_faster_by_a_fifth_brakes_or_accelerates(past: float, coming: float, kind: int) -> None:
    """Mean speeds in feet a frame of the 3 s before and the 5 s after, which differ in length."""
    frame = np.arange(-30.0, 51.0)
    assert longitudinal_class(np.where(frame < 0.0, past * frame, coming * frame), 30) == kind
    assert longitudinal_class(np.where(frame < 0.0, past * frame, coming * frame)[30:], 0) == NORMAL


@pytest.mark.parametrize(
    ("lane", "ahead_ft", "cell"),
    [
        (0.0, 10.0, 13 + 7),
        (0.0, -10.0, 13 + 5),
        (0.0, 7.0, 13 + 6),
        (-1.0, 0.0, 6),
        (1.0, 0.0, 26 + 6),
        (1.0, 89.9, 26 + 12),
        (1.0, -89.9, 26),
        (1.0, 90.0, OUTSIDE),
        (1.0, -90.0, OUTSIDE),
        (2.0, 0.0, OUTSIDE),
        (-2.0, 0.0, OUTSIDE),
        (0.0, 0.0, OUTSIDE),
    ],
)
def test_cells_are_15_feet_long_and_a_lane_wide(lane: float, ahead_ft: float, cell: int) -> None:
    assert grid_cells(np.array([lane]), np.array([ahead_ft])).tolist() == [cell]


def test_trucks_are_those_that_are_as_long() -> None:
    trucks = {kind for kind in ActorClass if vehicle_class(kind) == 3}
    assert trucks == {ActorClass.TRUCK, ActorClass.BUS, ActorClass.FIRE_TRUCK}
    assert {vehicle_class(kind) for kind in ActorClass} == {2, 3}
