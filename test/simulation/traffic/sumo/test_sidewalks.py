"""People keep off the road."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from traffic_helpers import load_map

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.simulation.roads.road_network import Lane, LaneKind
from siren_ros.simulation.traffic.sumo import sidewalks as sidewalks_module
from siren_ros.simulation.traffic.sumo.sidewalks import Corners, Kerbs

CITY = load_map(Path("city"))[1]
CYCLE_LANE = next(lane for lane in CITY.lanes if lane.kind is LaneKind.CYCLE and lane.length_m > 60.0)


OFF_M = 0.45
"""Least distance from the road."""


def kept_off(lane: Lane, offsets_m: Floats, turned_rad: float, *, crossing: bool = False) -> tuple[Floats, Flags]:
    """Distances of people to the left of a lane's middle, who are turned to the left of it, and who of them crosses."""
    x_m, y_m = np.array([lane.centre.offset_points(np.array([30.0]), side)[0] for side in offsets_m]).T
    yaw_rad = np.full(len(x_m), float(lane.centre.heading_rad(30.0)) + turned_rad)
    poses, crosses = np.stack((x_m, y_m, yaw_rad)), np.full(len(x_m), crossing)
    Kerbs(CITY).keep_off(poses, crosses)
    return lane.centre.project(poses[:2].T)[1], crosses


@pytest.mark.parametrize("turned_rad", [0.0, 0.7, -0.7, np.pi - 0.7])
def test_those_who_walk_along_the_road_are_moved_to_its_edge(turned_rad: float) -> None:
    half = CYCLE_LANE.width_m / 2.0
    offsets = np.array([-half - OFF_M + 3.1, -half + 0.3, -half - 0.2, -half - 1.0])
    left, crosses = kept_off(CYCLE_LANE, offsets, turned_rad)
    np.testing.assert_allclose(left, np.minimum(offsets, -half - OFF_M), atol=0.02)
    assert not crosses.any()
    np.testing.assert_allclose(kept_off(CYCLE_LANE, offsets, turned_rad, crossing=True)[0], offsets, atol=0.02)


@pytest.mark.parametrize("turned_rad", [0.9, 0.5 * np.pi, -0.9])
def test_those_who_walk_into_the_road_wait_at_its_edge_or_cross(turned_rad: float) -> None:
    """They do not stay behind by more than a step: SUMO's people go on meanwhile."""
    edge = -CYCLE_LANE.width_m / 2.0 - OFF_M
    offsets = edge + np.array([-0.5, 0.8, 1.0, 3.1])
    left, crosses = kept_off(CYCLE_LANE, offsets, turned_rad)
    np.testing.assert_allclose(left, [offsets[0], edge, *offsets[2:]], atol=0.02)
    assert crosses.tolist() == [False, False, True, True]


def test_those_far_inside_the_road_cross_it() -> None:
    lane = next(lane for lane in CITY.lanes if lane.kind is LaneKind.DRIVING and lane.length_m > 60.0)
    wide = 3.2 + OFF_M + 0.1 - lane.width_m / 2.0
    left, crosses = kept_off(lane, np.array([wide]), 0.0)
    assert (left.tolist(), crosses.tolist()) == ([pytest.approx(wide)], [True])


def test_the_road_begins_before_those_who_look_at_it_from_the_kerb() -> None:
    heading = float(CYCLE_LANE.centre.heading_rad(30.0))
    place = CYCLE_LANE.centre.offset_points(np.array([30.0]), -0.5 * CYCLE_LANE.width_m - 1.0)[0]
    yaws = np.array([heading + 0.5 * np.pi, heading - 0.5 * np.pi])
    assert Kerbs(CITY).ahead(*np.repeat(place, 2).reshape(2, 2), yaws).tolist() == [True, False]


SIDEWALKS = {"out": ("x", "j"), "back": ("j", "x"), "on": ("j", "y")}
LINKS = {
    "out_0": (":j_w0_0", ":x_w0_0"),
    "on_0": (":j_w0_0",),
    "back_0": (":j_w1_0", ":x_w0_0"),
    ":j_w0_0": (":j_c0_0",),
    ":j_c0_0": (":j_w1_0",),
}
"""A street with a sidewalk on both sides: a crossing joins these at one end, a corner at the other one."""


@pytest.mark.parametrize(
    ("uncrossed", "after", "met"),
    [("", "back", {"j", "x"}), ("", "on", {"j"}), ("j", "back", set()), ("j", "on", {"j"}), ("x", "back", {"j", "x"})],
)
def test_nobody_crosses_at_the_junction_that_stays_uncrossed(
    monkeypatch: pytest.MonkeyPatch, uncrossed: str, after: str, met: set[str]
) -> None:
    lane = SimpleNamespace(getIDList=lambda: LINKS, getLinks=lambda name: [(to,) for to in LINKS[name]])
    monkeypatch.setattr(sidewalks_module, "libsumo", SimpleNamespace(lane=lane))
    edges = {name: SimpleNamespace(from_junction=a, to_junction=b) for name, (a, b) in SIDEWALKS.items()}
    network: Any = SimpleNamespace(edge_by_id=edges)
    assert Corners(network, uncrossed).met_at("out", after) == met
