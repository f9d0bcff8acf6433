"""Records made of formulas: a few vehicles on given tracks, on a given map."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from synthetic_episode import NET_XML

from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.actors import ACTOR_STATE_DTYPES, ActorClass, ActorDescription, ActorStates, Floats
from siren_ros.world.episode import EpisodeDescription
from siren_ros.world.levels import EmergencyLevel
from siren_ros.world.net_parser import parse_road_network
from siren_ros.world.polyline import Polyline
from siren_ros.world.road_network import Connection, Edge, Lane, LaneKind, RoadNetwork
from siren_ros.world.units import STEP_S


@dataclass(frozen=True)
class Track:
    """x, y, vx, vy, yaw over consecutive steps from ``first_step`` on, shape ``(K, 5)``."""

    states: Floats
    first_step: int = 0
    length_m: float = 4.6
    is_emv: bool = False
    without: frozenset[int] = field(default_factory=frozenset)
    """Steps at which nothing was recorded."""


def moving(
    x_m: float,
    y_m: float,
    speed_mps: float,
    accel_mps2: float = 0.0,
    yaw_rad: float = 0.0,
    steps: int = 201,
    **more: Any,
) -> Track:
    """A straight track of constant acceleration."""
    time = np.arange(steps) * STEP_S
    along = speed_mps * time + 0.5 * accel_mps2 * time**2
    speed = speed_mps + accel_mps2 * time
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    columns = (x_m + along * cos, y_m + along * sin, speed * cos, speed * sin, np.full(steps, yaw_rad))
    return Track(np.stack(columns, axis=1), **more)


def record_with(tracks: Mapping[int, Track], network: RoadNetwork, template: str = "S2") -> EpisodeRecord:
    """The record of vehicles on given tracks; SUMO said nothing about them."""
    actors = {
        key: ActorDescription(
            key, f"v{key}", ActorClass.SEDAN, track.length_m, 1.8, 1.5, (90, 90, 90), is_emv=track.is_emv
        )
        for key, track in tracks.items()
    }
    steps = max(track.first_step + len(track.states) for track in tracks.values())
    description = EpisodeDescription(
        template, EmergencyLevel.L2, 0, "made", "0" * 64, steps * STEP_S, "none", "paper", emv_ids=()
    )
    states = tuple(_states(tracks, step) for step in range(steps))
    return EpisodeRecord(description, network, actors, states, (), {}, (), None, complete=True, topics={})


def _states(tracks: Mapping[int, Track], step: int) -> ActorStates:
    there = {
        key: track.states[step - track.first_step]
        for key, track in sorted(tracks.items())
        if 0 <= step - track.first_step < len(track.states) and step not in track.without
    }
    columns: dict[str, Any] = {name: np.zeros(len(there), dtype) for name, dtype in ACTOR_STATE_DTYPES.items()}
    columns["actor_id"] = np.array(list(there), dtype=np.uint32)
    if there:
        columns.update(
            zip(("x_m", "y_m", "vx_mps", "vy_mps", "yaw_rad"), np.array(list(there.values())).T, strict=True)
        )
    return ActorStates(step=step, **columns)


@pytest.fixture(scope="session")
def straight_road() -> RoadNetwork:
    """Lanes eastwards at y = −5.25 and −1.75, westwards above, 300 m, 13.89 m/s."""
    return parse_road_network(NET_XML.encode())


def _lane(index: int, edge: int, kind: LaneKind, points: list[tuple[float, float]]) -> Lane:
    return Lane(index, f"l{index}", edge, 0, kind, Polyline.through(points), 3.5, 10.0, True, True)


@pytest.fixture(scope="session")
def crossroads() -> RoadNetwork:
    """From lane 0 (100 m east to the origin) left to lane 1, straight on to lane 2, right to lane 3; paths 4, 5, 6."""
    lanes = (
        _lane(0, 0, LaneKind.DRIVING, [(-100.0, 0.0), (0.0, 0.0)]),
        _lane(1, 1, LaneKind.DRIVING, [(20.0, 20.0), (20.0, 120.0)]),
        _lane(2, 2, LaneKind.DRIVING, [(40.0, 0.0), (140.0, 0.0)]),
        _lane(3, 3, LaneKind.DRIVING, [(20.0, -20.0), (20.0, -120.0)]),
        _lane(4, 4, LaneKind.INTERNAL, [(0.0, 0.0), (14.0, 6.0), (20.0, 20.0)]),
        _lane(5, 5, LaneKind.INTERNAL, [(0.0, 0.0), (40.0, 0.0)]),
        _lane(6, 6, LaneKind.INTERNAL, [(0.0, 0.0), (14.0, -6.0), (20.0, -20.0)]),
    )
    edges = tuple(Edge(lane.index, f"e{lane.index}", (lane.index,), "a", "b", lane.index > 3) for lane in lanes)
    connections = tuple(
        Connection(0, to_lane, (to_lane + 3,), letter, None, -1, False, "j")
        for to_lane, letter in ((1, "l"), (2, "s"), (3, "r"))
    )
    return RoadNetwork(lanes, edges, connections, {}, (0.0, 0.0), "!")
