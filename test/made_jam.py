"""Records of a jam on a straight motorway made by hand: two rows of cars, and an EMV that drives between them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from hand_made_record import EMV, Driven, hand_made

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.simulation.roads.road_network import Edge, Lane, LaneKind, RoadNetwork

WIDTH_M, SHOULDER_M, LENGTH_M = 3.75, 3.0, 1000.0
TURN_RAD = 0.4
"""The road points elsewhere than along x."""
EMV_WIDTH_M, CAR_WIDTH_M = 2.1, 1.8
AT_SIDE_M = 0.5 * (WIDTH_M - CAR_WIDTH_M) - 0.2
"""Offset of a car that keeps to the side of its lane."""


def at(along_m: float, left_m: float) -> tuple[float, float]:
    cos, sin = np.cos(TURN_RAD), np.sin(TURN_RAD)
    return float(cos * along_m - sin * left_m), float(sin * along_m + cos * left_m)


def motorway(lanes: int = 2, limit_mps: float = 36.0) -> RoadNetwork:
    """One edge with a hard shoulder; the leftmost lane's centre line is the axis of the road's frame."""
    contents = [(LaneKind.DRIVING, -WIDTH_M * (lanes - 1 - k), WIDTH_M) for k in range(lanes)]
    contents.insert(0, (LaneKind.SHOULDER, -WIDTH_M * (lanes - 0.5) - 0.5 * SHOULDER_M, SHOULDER_M))
    made = []
    for position, (kind, left_m, width_m) in enumerate(contents):
        centre = Polyline.through([at(0.0, left_m), at(LENGTH_M, left_m)])
        civil = kind is LaneKind.DRIVING
        made.append(Lane(position, f"road_{position}", 0, position, kind, centre, width_m, limit_mps, True, civil))
    edge = Edge(0, "road", tuple(range(len(made))), "A", "B", False)
    return RoadNetwork(tuple(made), (edge,), (), {}, (0.0, 0.0), "!")


def stands(along_m: float, left_m: float, steps: int) -> Driven:
    return Driven(np.array([at(0.0, left_m), at(LENGTH_M, left_m)]), np.full(steps, along_m))


def jam(
    left_offset_m: float = AT_SIDE_M,
    right_offset_m: float = -AT_SIDE_M,
    speed_mps: float = 8.0,
    more: Sequence[tuple[float, float]] = (),
    lanes: int = 2,
    drive_m: float = 440.0,
) -> EpisodeRecord:
    """Twenty cars in each of two lanes from 300 m on, 8 m apart; the EMV comes from 50 m on the line between them."""
    steps = int(drive_m / speed_mps / STEP_S)
    places = [(300.0 + 8.0 * k, side) for k in range(20) for side in (left_offset_m, right_offset_m - WIDTH_M)]
    cars = {2 + k: stands(*place, steps) for k, place in enumerate([*places, *more])}
    line = np.array([at(0.0, -0.5 * WIDTH_M), at(LENGTH_M, -0.5 * WIDTH_M)])
    emv = Driven(line, 50.0 + speed_mps * STEP_S * np.arange(steps))
    record = hand_made(motorway(lanes), {EMV: emv, **cars})
    site = {"stretch": ["road"], "route": ["road"]}
    return replace(record, description=replace(record.description, site=site))
