"""A made record that has more than one of everything, for tests that compare whole results with stored ones.

Three EMVs on the small crossing, which is turned and moved so that no road is along an axis: two come from the south
one behind the other, a fire truck from the west crosses their way. Cars make way to the right and to the left, one is
hit twice; a bus, a motorcycle, a cyclist on a road of its own, and two people on foot on a crossing.
"""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from hand_made_record import (
    EASTBOUND,
    LEFT_X_M,
    NORTHBOUND,
    PARALLEL,
    SHOULDER_X_M,
    SOUTHBOUND,
    Driven,
    crossing,
    hand_made,
    line,
    traffic_of,
)

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_NS, STEP_S
from siren_ros.data.interfaces.topics import CORE_TOPICS
from siren_ros.data.recording.episode_record import EpisodeRecord, TopicRecord
from siren_ros.data.tracks import places_of
from siren_ros.simulation.roads.road_network import JunctionKind, Lane, RoadNetwork
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import (
    NO_ACTOR,
    ActorClass,
    ActorDescription,
    Event,
    EventKind,
    Lights,
    Mode,
    Owner,
    hash_state,
)

TURN_RAD, MOVED_M = 0.6, np.array([400.0, -250.0])
FIRST, BEHIND, CROSSING = 1, 9, 12
"""The EMVs."""
RIGHT, BUS, EAST, VAN, MOTORCYCLE, WALKER, CYCLIST, QUEUED, LATE, CHILD = 2, 3, 4, 5, 6, 7, 8, 10, 11, 13
BODIES = {
    FIRST: (ActorClass.AMBULANCE, 6.2, 2.1),
    RIGHT: (ActorClass.SEDAN, 4.6, 1.8),
    BUS: (ActorClass.BUS, 12.0, 2.5),
    EAST: (ActorClass.SUV, 4.7, 1.9),
    VAN: (ActorClass.VAN, 5.4, 2.0),
    MOTORCYCLE: (ActorClass.MOTORCYCLE, 2.2, 0.8),
    WALKER: (ActorClass.PEDESTRIAN, 0.5, 0.5),
    CYCLIST: (ActorClass.BICYCLE, 1.8, 0.6),
    BEHIND: (ActorClass.POLICE, 4.8, 1.85),
    QUEUED: (ActorClass.HATCHBACK, 4.0, 1.75),
    LATE: (ActorClass.PICKUP, 5.3, 1.95),
    CROSSING: (ActorClass.FIRE_TRUCK, 8.5, 2.5),
    CHILD: (ActorClass.PEDESTRIAN, 0.4, 0.4),
}
STEPS = 321


def driven(start_m: float, *pieces: tuple[float, float]) -> Floats:
    """Arc lengths of (acceleration in m/s², time in s) pieces, the first of which begins at a speed, told as a time."""
    (speed, _), *rest = pieces
    change = np.concatenate([np.full(round(time_s / STEP_S), accel) for accel, time_s in rest])
    speeds = np.maximum(speed + np.concatenate(([0.0], np.cumsum(change * STEP_S))), 0.0)[:STEPS]
    return start_m + np.concatenate(([0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * STEP_S)))


def modes(*pieces: tuple[Mode, float]) -> np.ndarray:
    """(mode, time in s) pieces; the last one goes on."""
    told = np.concatenate([np.full(round(time_s / STEP_S), mode, np.uint8) for mode, time_s in pieces])
    return np.concatenate((told, np.full(STEPS, pieces[-1][0], np.uint8)))[:STEPS]


_PULLS_RIGHT = line((5.25, -120.0), (5.25, -66.0), (7.7, -52.0), (7.7, -28.0), (5.25, -16.0), (5.25, 110.0))
_PULLS_LEFT = line(
    (LEFT_X_M, -120.0), (LEFT_X_M, -40.0), (0.9, -25.0), (0.9, -5.0), (LEFT_X_M, 10.0), (LEFT_X_M, 110.0)
)
_NORTH, _EAST = line((5.2, -120.0), (5.3, 110.0)), line((-110.0, -5.3), (120.0, -5.2))
_BETWEEN = line((3.75, -120.0), (3.65, 110.0))
_OVER = line((16.0, -16.0), (-8.0, -16.0))
_BACK_OVER = line((-3.0, -17.0), (18.0, -17.0))
_ASIDE = line((SHOULDER_X_M, -120.0), (SHOULDER_X_M, -20.0))


def _vehicles() -> dict[int, Driven]:
    """Each on its line; times and accelerations are chosen so that most things happen more than once."""
    drives = (Mode.YIELD_REACTING, 1.0), (Mode.YIELD_PULL_OVER, 3.5), (Mode.YIELD_HOLD, 2.5), (Mode.REJOIN, 3.0)
    swerves = (Mode.NOMINAL, 3.0), (Mode.YIELD_REACTING, 0.6), (Mode.YIELD_DEFERRED, 1.0), (Mode.YIELD_LANE_CHANGE, 3.0)
    driven_ways = {
        FIRST: Driven(
            _NORTH,
            driven(20.0, (11.0, 0.0), (0.8, 2.5), (-3.2, 2.0), (0.0, 1.0), (2.2, 3.0), (0.0, 8.0)),
            modes((Mode.ROUTE_FOLLOW, 5.0), (Mode.GAP_ESCAPE, 2.0), (Mode.ROUTE_FOLLOW, 1.0)),
        ),
        RIGHT: Driven(
            _PULLS_RIGHT,
            driven(48.0, (7.0, 0.0), (0.0, 1.5), (-1.9, 3.0), (0.0, 3.0), (1.5, 3.0), (0.0, 9.0)),
            modes((Mode.NOMINAL, 1.0), *drives, (Mode.NOMINAL, 1.0)),
        ),
        BUS: Driven(
            _PULLS_LEFT,
            driven(70.0, (6.0, 0.0), (-0.8, 2.0), (0.0, 5.0), (0.7, 4.0), (0.0, 9.0)),
            modes(*swerves, (Mode.YIELD_KEEP_LANE, 2.0), (Mode.NOMINAL, 1.0)),
        ),
        EAST: Driven(EASTBOUND, driven(80.0, (9.0, 0.0), (0.0, 2.0), (-2.5, 1.2), (1.2, 4.0), (0.0, 9.0))),
        VAN: Driven(SOUTHBOUND, driven(30.0, (8.0, 0.0), (0.5, 4.0), (-2.0, 3.0), (0.0, 12.0)), Mode.EXTERNAL),
        MOTORCYCLE: Driven(_BETWEEN, driven(58.0, (9.0, 0.0), (0.6, 4.0), (-1.5, 3.0), (0.0, 12.0))),
        WALKER: Driven(_OVER, driven(11.0, (1.4, 0.0), (0.0, 12.0))),
        CYCLIST: Driven(PARALLEL, driven(60.0, (4.5, 0.0), (0.0, 16.0))),
        BEHIND: Driven(
            line((LEFT_X_M, -120.0), (LEFT_X_M, -60.0), (5.25, -35.0), (5.25, 110.0)),
            driven(2.0, (12.0, 0.0), (0.0, 3.0), (-2.4, 2.5), (0.0, 1.5), (2.0, 3.0), (0.0, 9.0)),
            Mode.ROUTE_FOLLOW,
        ),
        QUEUED: Driven(
            NORTHBOUND,
            driven(96.0, (0.0, 0.0), (0.0, 2.0), (2.1, 5.0), (0.0, 9.0)),
            modes((Mode.NOMINAL, 8.0), (Mode.STOPPED, 1.0)),
        ),
        LATE: Driven(_ASIDE, driven(10.0, (5.0, 0.0), (-0.5, 12.0)), Mode.NOMINAL, 60),
        CROSSING: Driven(_EAST, driven(-6.0, (9.0, 0.0), (0.5, 5.0), (-1.0, 4.0), (0.0, 9.0)), Mode.ROUTE_FOLLOW),
        CHILD: Driven(_BACK_OVER, driven(0.0, (0.9, 0.0), (0.0, 3.0), (0.4, 2.0), (0.0, 12.0)), Mode.NOMINAL, 140),
    }
    return {key: replace(one, arc_m=one.arc_m[: STEPS - one.first_step]) for key, one in driven_ways.items()}


def _events() -> tuple[Event, ...]:
    def event(step: int, kind: EventKind, actor_id: int, other_id: int = NO_ACTOR, **detail: float | str) -> Event:
        return Event(step, kind, actor_id, other_id, detail=detail)

    def touches(step: int, actor_id: int, other_id: int, impact_speed_mps: float) -> Event:
        return event(step, EventKind.COLLISION, actor_id, other_id, impact_speed_mps=impact_speed_mps)

    told = [
        *(event(0, EventKind.SIREN_ON, FIRST), event(0, EventKind.SIREN_ON, CROSSING)),
        event(20, EventKind.YIELD_REQUESTED, RIGHT, FIRST),
        event(40, EventKind.YIELD_STARTED, RIGHT, FIRST),
        event(60, EventKind.YIELD_REQUESTED, BUS, FIRST),
        event(72, EventKind.YIELD_DEFERRED, BUS, FIRST),
        event(92, EventKind.YIELD_STARTED, BUS, FIRST),
        event(100, EventKind.GAP_ESCAPE_ENTERED, FIRST),
        event(110, EventKind.YIELD_HELD, RIGHT, FIRST),
        event(140, EventKind.GAP_ESCAPE_LEFT, FIRST),
        event(152, EventKind.YIELD_COMPLETED, BUS, FIRST),
        event(158, EventKind.STOP_LINE_CROSSED, FIRST, signal_state="r"),
        *(touches(150, RIGHT, QUEUED, 1.2), touches(160, QUEUED, FIRST, 3.4), touches(161, CHILD, EAST, 0.7)),
        event(170, EventKind.YIELD_RELEASED, RIGHT, BEHIND),
        event(175, EventKind.STOP_LINE_CROSSED, BEHIND, signal_state="r"),
        *(event(192, EventKind.YIELD_RELEASED, BUS, BEHIND), event(200, EventKind.SIREN_OFF, CROSSING)),
        event(210, EventKind.TELEPORT, VAN),
    ]
    return tuple(told)


def turned(points: Points) -> Points:
    """Places of the small crossing, where they are in this record."""
    cos, sin = np.cos(TURN_RAD), np.sin(TURN_RAD)
    return points @ np.array([[cos, sin], [-sin, cos]]) + MOVED_M


def busy_network(control: JunctionKind = JunctionKind.SIGNAL) -> RoadNetwork:
    """The crossing, turned and moved, with a crossing for people on its southern side."""
    plain = crossing(control)

    def moved(lane: Lane) -> Lane:
        return replace(lane, centre=Polyline.through(turned(lane.centre.points)))

    junctions = {}
    for key, item in plain.junctions.items():
        x_m, y_m = turned(np.array((item.x_m, item.y_m))).tolist()
        junctions[key] = replace(item, outline=turned(item.outline), x_m=x_m, y_m=y_m)
    stripes = turned(line((-4.0, -18.5), (17.0, -18.5), (17.0, -14.5), (-4.0, -14.5)))
    return replace(plain, lanes=tuple(map(moved, plain.lanes)), junctions=junctions, crossings=(stripes,))


def signal(step: int) -> str:
    """Red for those from the south and the north until 13 s, green for those from the west until 9 s."""
    north = "G" if step >= 260 else "r"
    east = "G" if step < 180 else ("y" if step < 220 else "r")
    return "".join((*north * 4, east, north, "o"))


@cache
def busy_record(template: str = "S3", level: str = "L2", seed: int = 7, **told: Any) -> EpisodeRecord:
    """The record; what is told replaces fields of its description."""
    vehicles = {key: replace(one, points=turned(one.points)) for key, one in _vehicles().items()}
    plain = hand_made(busy_network(), vehicles, signal)
    emvs = FIRST, BEHIND, CROSSING
    actors = {
        key: ActorDescription(key, f"v{key}", kind, *size_m, 1.5 + 0.1 * (key % 3), (10 * key, 90, 40), key in emvs)
        for key, (kind, *size_m) in BODIES.items()
    }
    about = replace(
        plain.description,
        template=template,
        level=EmergencyLevel[level],
        seed=seed,
        duration_s=16.0,
        emv_ids=emvs,
        parameters={
            "template": {"emv.speed_mps": 12.0, "response.response_distance_m": 40.0},
            "av": {"actor_id": VAN, "sensors": "none"},
            "crossing": {"emv_ids": [CROSSING], "junction": "J"},
        },
        site={"kind": "signal_junction", "junction": "J"},
    )
    record = replace(plain, description=replace(about, **told), actors=dict(sorted(actors.items())), events=_events())
    return _complete(_with_motion(record))


def _with_motion(record: EpisodeRecord) -> EpisodeRecord:
    """Accelerations and turns of the recorded speeds, lights and owners."""
    names = "accel_mps2", "yaw_rate_radps", "lateral_accel_mps2", "residual_m"
    found = {}
    for key in record.actors:
        track = record.track(key)
        accel, rate = (np.gradient(values, STEP_S) for values in (track.speed_mps, np.unwrap(track.yaw_rad)))
        residual_m = 0.02 * (np.sin(0.1 * track.step) + key)
        found[key] = int(track.step[0]), np.stack((accel, rate, track.speed_mps * rate, residual_m))
    states = []
    for state in record.states:
        columns = np.array([found[key][1][:, state.step - found[key][0]] for key in state.actor_id.tolist()]).T
        is_emv = np.isin(state.actor_id, record.emv_ids)
        ours = is_emv | ~np.isin(state.mode, (Mode.NOMINAL, Mode.YIELD_KEEP_LANE))
        sounds = is_emv & ((state.actor_id != BEHIND) | (state.step >= 60))
        lights = sounds * int(Lights.BEACON | Lights.SIREN) + (columns[0] < -1.0) * int(Lights.BRAKE)
        owner = np.where(ours, Owner.ROS, Owner.SUMO).astype(np.uint8)
        motion = dict(zip(names, columns, strict=True))
        states.append(replace(state, **motion, lights=lights.astype(np.uint8), owner=owner))
    return replace(record, states=tuple(states))


def _complete(record: EpisodeRecord) -> EpisodeRecord:
    """SUMO's traffic with the lane of each row, hashes, and the counts of the core topics."""
    rows = record.rows
    places = places_of(replace(record, traffic=()), rows)
    columns = {"lane": places.lane, "lane_position_m": places.arc_m, "lateral_offset_m": places.offset_m}
    traffic = []
    for state in record.states:
        poses = np.column_stack((state.x_m, state.y_m, state.yaw_rad, state.speed_mps))
        told: dict[str, Any] = {name: values[rows.step == state.step] for name, values in columns.items()}
        told |= {name: getattr(state, name) for name in ("actor_id", "owner", "lights")}
        told["events"] = tuple(event for event in record.events if event.step == state.step)
        told["spawned"] = tuple(record.actors.values()) if state.step == 0 else ()
        traffic.append(traffic_of(state.step, signal(state.step), poses, **told))
    times_ns = np.arange(record.steps, dtype=np.int64) * STEP_NS
    counted = {}
    for topic in CORE_TOPICS:
        of_topic = times_ns[:1] if topic.latched else times_ns
        counted[topic.name] = TopicRecord(topic.name, topic.type_name, len(of_topic), 40, of_topic, 0)
    hashes = {state.step: hash_state(state, one.signals) for state, one in zip(record.states, traffic, strict=True)}
    return replace(record, traffic=tuple(traffic), topics=counted, state_hashes=hashes, complete=True)
