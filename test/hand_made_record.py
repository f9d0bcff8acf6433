"""Records made by hand on a small crossing, for predicates: every vehicle follows a line at given arc lengths."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Points
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.simulation.roads.road_network import (
    Connection,
    Edge,
    Junction,
    JunctionKind,
    Lane,
    LaneKind,
    RoadNetwork,
)
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    TRAFFIC_STATE_DTYPES,
    ActorClass,
    ActorDescription,
    ActorStates,
    Mode,
    SignalState,
    TrafficState,
)

EMV = 1
EMV_LENGTH_M, CAR_LENGTH_M = 6.0, 4.0
STOP_LINE_Y_M = -20.0
"""Of the approach from the south, whose lanes end 100 m after they begin."""
SHOULDER_X_M, RIGHT_X_M, LEFT_X_M = 8.25, 5.25, 1.75
"""Lanes of that approach; the line between the two driving lanes lies at 3.5 m."""


def quarter_right(x_m: float, radius_m: float) -> Points:
    """A quarter circle from heading north at the stop line to heading east."""
    angle = np.linspace(0.0, np.pi / 2.0, 19)
    return np.stack((x_m + radius_m * (1.0 - np.cos(angle)), STOP_LINE_Y_M + radius_m * np.sin(angle)), axis=-1)


def line(*points: tuple[float, float]) -> Points:
    return np.array(points, dtype=np.float64)


SHOULDER_TURN = quarter_right(SHOULDER_X_M, 11.75)
LANE_TURN = quarter_right(RIGHT_X_M, 14.75)
NORTHBOUND = line((RIGHT_X_M, -120.0), (RIGHT_X_M, 110.0))
"""In the right lane straight across; the stop line is at 100 m, the exit lane begins at 130 m."""
SOUTHBOUND = line((-1.75, 110.0), (-1.75, -120.0))
EASTBOUND = line((-110.0, -5.25), (120.0, -5.25))
"""Crosses the way of those who go north; the stop line is at 100 m, the exit lane begins at 130 m."""
PARALLEL = line((14.0, -120.0), (14.0, 110.0))
"""A road of its own beside the one to the north."""
ON_SHOULDER = np.concatenate((line((SHOULDER_X_M, -120.0)), SHOULDER_TURN, line((120.0, -8.25))))
IN_TURN_LANE = np.concatenate((line((RIGHT_X_M, -120.0)), LANE_TURN, line((120.0, -5.25))))

_EDGES: dict[str, list[tuple[LaneKind, Points]]] = {
    "s_in": [
        (LaneKind.SHOULDER, line((SHOULDER_X_M, -120.0), (SHOULDER_X_M, -20.0))),
        (LaneKind.DRIVING, line((RIGHT_X_M, -120.0), (RIGHT_X_M, -20.0))),
        (LaneKind.DRIVING, line((LEFT_X_M, -120.0), (LEFT_X_M, -20.0))),
    ],
    "n_out": [
        (LaneKind.DRIVING, line((RIGHT_X_M, 10.0), (RIGHT_X_M, 110.0))),
        (LaneKind.DRIVING, line((LEFT_X_M, 10.0), (LEFT_X_M, 110.0))),
    ],
    "e_out": [
        (LaneKind.SHOULDER, line((20.0, -8.25), (120.0, -8.25))),
        (LaneKind.DRIVING, line((20.0, -5.25), (120.0, -5.25))),
    ],
    "w_in": [(LaneKind.DRIVING, line((-110.0, -5.25), (-10.0, -5.25)))],
    "n_in": [(LaneKind.DRIVING, line((-1.75, 110.0), (-1.75, 10.0)))],
    "s_out": [(LaneKind.DRIVING, line((-1.75, -20.0), (-1.75, -120.0)))],
    "p_in": [(LaneKind.DRIVING, line((14.0, -120.0), (14.0, -20.0)))],
    "p_out": [(LaneKind.DRIVING, line((14.0, 10.0), (14.0, 110.0)))],
}
_MOVEMENTS: list[tuple[str, int, str, int, str, Points]] = [
    ("s_in", 1, "n_out", 0, "s", line((RIGHT_X_M, -20.0), (RIGHT_X_M, 10.0))),
    ("s_in", 2, "n_out", 1, "s", line((LEFT_X_M, -20.0), (LEFT_X_M, 10.0))),
    ("s_in", 0, "e_out", 0, "r", SHOULDER_TURN),
    ("s_in", 1, "e_out", 1, "r", LANE_TURN),
    ("w_in", 0, "e_out", 1, "s", line((-10.0, -5.25), (20.0, -5.25))),
    ("n_in", 0, "s_out", 0, "s", line((-1.75, 10.0), (-1.75, -20.0))),
    ("p_in", 0, "p_out", 0, "s", line((14.0, -20.0), (14.0, 10.0))),
]
STRAIGHT, STRAIGHT_LEFT, SHOULDER_RIGHT, RIGHT, EAST, SOUTH, BESIDE = range(len(_MOVEMENTS))
"""Indices of the movements, which are their signal links as well."""


def crossing(control: JunctionKind = JunctionKind.SIGNAL) -> RoadNetwork:
    """The crossing J; with stop signs, one binds the approach from the south."""
    lanes: list[Lane] = []
    edges: list[Edge] = []

    def add_edge(name: str, contents: Sequence[tuple[LaneKind, Points]], ends: tuple[str, str]) -> Edge:
        internal = name.startswith(":")
        first = len(lanes)
        for position, (kind, points) in enumerate(contents):
            centre, width = Polyline.through(points), 2.5 if kind is LaneKind.SHOULDER else 3.5
            civil = kind is not LaneKind.SHOULDER
            index = len(lanes)
            lanes.append(
                Lane(index, f"{name}_{position}", len(edges), position, kind, centre, width, 13.9, True, civil)
            )
        edges.append(Edge(len(edges), name, tuple(range(first, len(lanes))), *ends, internal))
        return edges[-1]

    by_name = {
        name: add_edge(name, contents, ("J", name) if name.endswith("out") else (name, "J"))
        for name, contents in _EDGES.items()
    }
    connections = []
    for link, (source, from_position, target, to_position, direction, points) in enumerate(_MOVEMENTS):
        via = add_edge(f":J_{link}", [(LaneKind.INTERNAL, points)], ("J", "J"))
        connections.append(
            Connection(
                from_lane=by_name[source].lanes[from_position],
                to_lane=by_name[target].lanes[to_position],
                via=via.lanes,
                direction=direction,
                signal_id="J" if control is JunctionKind.SIGNAL else None,
                signal_link=link if control is JunctionKind.SIGNAL else -1,
                must_stop=control is JunctionKind.PRIORITY_STOP and source == "s_in",
                junction="J",
            )
        )
    outline = line((-10.0, -20.0), (20.0, -20.0), (20.0, 10.0), (-10.0, 10.0))
    junctions = {"J": Junction("J", control, outline, 5.0, -5.0)}
    return RoadNetwork(tuple(lanes), tuple(edges), tuple(connections), junctions, (0.0, 0.0), "!")


@dataclass(frozen=True)
class Driven:
    """One vehicle: the points that it drives through, where on them it is at each step, and its mode."""

    points: Points
    arc_m: npt.NDArray[np.float64]
    mode: Mode | npt.NDArray[np.uint8] = Mode.NOMINAL
    first_step: int = 0


def at_speed(start_m: float, speed_mps: float, steps: int) -> npt.NDArray[np.float64]:
    """Arc lengths of constant speed."""
    return start_m + speed_mps * STEP_S * np.arange(steps)


def hand_made(
    network: RoadNetwork, vehicles: dict[int, Driven], signal: Callable[[int], str] = lambda _: ""
) -> EpisodeRecord:
    """The record of vehicles; number 1 is the EMV.

    Args:
        network: The map.
        vehicles: By actor id.
        signal: State string of the signal J at a step; empty without one.
    """
    actors = {
        key: ActorDescription(
            key,
            f"v{key}",
            ActorClass.AMBULANCE if key == EMV else ActorClass.SEDAN,
            EMV_LENGTH_M if key == EMV else CAR_LENGTH_M,
            2.1 if key == EMV else 1.8,
            1.5,
            (200, 200, 200),
            is_emv=key == EMV,
        )
        for key in sorted(vehicles)
    }
    steps = max(item.first_step + len(item.arc_m) for item in vehicles.values())
    columns = {key: _columns(vehicles[key]) for key in actors}
    states = tuple(_states(step, vehicles, columns) for step in range(steps))
    return EpisodeRecord(
        description=EpisodeDescription("S3", EmergencyLevel.L1, 0, "crossing", "0" * 64, 10.0, "none", "paper", (EMV,)),
        network=network,
        actors=actors,
        states=states,
        traffic=tuple(traffic_of(step, signal(step)) for step in range(steps)),
        commands={},
        events=(),
        outcome=None,
        complete=False,
        topics={},
    )


def with_states(
    record: EpisodeRecord, when: Callable[[int], bool] = lambda _step: True, **columns: Callable[[ActorStates], Any]
) -> EpisodeRecord:
    """The record with columns of its states replaced, each by a function of the state, at some steps."""

    def changed(state: ActorStates) -> ActorStates:
        values: dict[str, Any] = {name: column(state) for name, column in columns.items()}
        return replace(state, **values) if when(state.step) else state

    return replace(record, states=tuple(map(changed, record.states)))


def without(record: EpisodeRecord, actor_id: int, when: Callable[[int], bool]) -> EpisodeRecord:
    """The record without the states of an actor at some steps."""
    states = (state.select(state.actor_id != actor_id) if when(state.step) else state for state in record.states)
    return replace(record, states=tuple(states))


def _columns(vehicle: Driven) -> dict[str, npt.NDArray[np.float64]]:
    path = Polyline.through(vehicle.points)
    xy, yaw = path.at(vehicle.arc_m), path.heading_rad(vehicle.arc_m)
    speed = np.gradient(vehicle.arc_m, STEP_S)
    mode = np.broadcast_to(np.asarray(vehicle.mode, dtype=np.uint8), yaw.shape)
    columns = {"x_m": xy[:, 0], "y_m": xy[:, 1], "yaw_rad": yaw, "mode": mode}
    return {**columns, "vx_mps": speed * np.cos(yaw), "vy_mps": speed * np.sin(yaw)}


def _states(step: int, vehicles: dict[int, Driven], columns: dict[int, dict[str, Any]]) -> ActorStates:
    present = [key for key in columns if 0 <= step - vehicles[key].first_step < len(vehicles[key].arc_m)]
    rows = [{name: values[step - vehicles[key].first_step] for name, values in columns[key].items()} for key in present]
    told = {name: [row[name] for row in rows] for name in (rows or [{}])[0]}
    return actor_states(step, actor_id=present, **told)


def actor_states(step: int, **told: Any) -> ActorStates:
    """A step with some columns; the others are zero."""
    zero = [0] * len(told["actor_id"])
    return ActorStates(step, **{name: np.array(told.get(name, zero), of) for name, of in ACTOR_STATE_DTYPES.items()})


def traffic_of(step: int, state: str = "", poses: npt.ArrayLike = (), **told: Any) -> TrafficState:
    """A step with some columns and other fields; what is not told is zero or empty.

    ``poses`` are rows of x, y, yaw and speed, SUMO's and the simulated ones, for each of ``actor_id``.
    """
    for name, column in zip(("x_m", "y_m", "yaw_rad", "speed_mps"), np.transpose(poses), strict=False):
        told |= {name: column, f"sumo_{name}": column}
    rows = len(told.get("actor_id", ()))
    told = {"removed": [], "route_offset": [0] * (rows + 1), "route_edges": [], **told}
    arrays = {name: np.array(told.pop(name, [0] * rows), dtype) for name, dtype in TRAFFIC_STATE_DTYPES.items()}
    signals = (SignalState("J", state),) if state else ()
    return TrafficState(**{"step": step, "spawned": (), "emvs": (), "signals": signals, **told, **arrays})
