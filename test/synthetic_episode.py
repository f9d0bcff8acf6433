"""A small episode made of formulas: an EMV overtakes a platoon that changes out of its lane. No SUMO, no ROS."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from hand_made_record import actor_states, traffic_of

from siren_ros.base.numerics.units import STEP_S, time_ns_of_step
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.boxes import to_ground_truth
from siren_ros.data.interfaces.conversions import (
    to_actor_states,
    to_episode_description,
    to_episode_outcome,
    to_events,
    to_traffic_state,
    to_vehicle_commands,
)
from siren_ros.data.interfaces.measurements import to_point_cloud
from siren_ros.data.interfaces.messages import make_message, stamp
from siren_ros.sensing.lidar.lidar import LIDAR_POINT_DTYPE
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeEnd, EpisodeOutcome
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import (
    ActorClass,
    ActorDescription,
    ActorStates,
    Event,
    EventKind,
    Lights,
    Mode,
    Owner,
    TrafficState,
    hash_state,
)
from siren_ros.simulation.world.carrier import GroundTruth
from siren_ros.simulation.world.commands import COMMAND_DTYPES, VehicleCommands

EMV = 1
LIDAR_TOPIC = topics.LIDAR.of_sensor("lidar", 2)
RIGHT_Y_M, LEFT_Y_M = -5.25, -1.75
LANE_CHANGE_S = 3.0

NET_XML = """<net version="1.20">
<location netOffset="0.00,0.00" convBoundary="0.00,-7.00,320.00,7.00" origBoundary="0,0,1,1" projParameter="!"/>
<edge id="east" from="A" to="B" priority="1" shape="0.00,0.00 300.00,0.00">
<lane id="east_0" index="0" speed="13.89" length="300.00" width="3.50" shape="0.00,-5.25 300.00,-5.25"/>
<lane id="east_1" index="1" speed="13.89" length="300.00" width="3.50" shape="0.00,-1.75 300.00,-1.75"/>
</edge>
<edge id="west" from="B" to="A" priority="1" shape="300.00,0.00 0.00,0.00">
<lane id="west_0" index="0" speed="13.89" length="300.00" width="3.50" shape="300.00,5.25 0.00,5.25"/>
<lane id="west_1" index="1" speed="13.89" length="300.00" width="3.50" shape="300.00,1.75 0.00,1.75"/>
</edge>
<junction id="A" type="dead_end" x="0.00" y="0.00" incLanes="west_0 west_1" intLanes="" shape="0,-7 0,7"/>
<junction id="B" type="dead_end" x="300.00" y="0.00" incLanes="east_0 east_1" intLanes="" shape="300,7 300,-7"/>
</net>
"""


def rotate(points, yaw_rad):
    """Points of shape ``(..., 2)``, turned counter-clockwise about the origin."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return points @ np.array([[cos, sin], [-sin, cos]])


def split_net(seam_m: float) -> str:
    """The same road towards the east as two edges, joined by a junction of 3 m with a lane for each."""
    end_m = seam_m + 3.0

    def lane(name: str, index: int, x0: float, x1: float) -> str:
        y = (RIGHT_Y_M, LEFT_Y_M)[index]
        shape = f"{x0:.2f},{y:.2f} {x1:.2f},{y:.2f}"
        return (
            f'<lane id="{name}_{index}" index="{index}" speed="13.89" length="{x1 - x0}" width="3.5" shape="{shape}"/>'
        )

    def edge(name: str, attributes: str, x0: float, x1: float) -> str:
        return f'<edge id="{name}" {attributes}>{lane(name, 0, x0, x1)}{lane(name, 1, x0, x1)}</edge>'

    connections = "".join(
        f'<connection from="east" to="east2" fromLane="{index}" toLane="{index}" via=":S_0_{index}" dir="s" state="M"/>'
        f'<connection from=":S_0" to="east2" fromLane="{index}" toLane="{index}" dir="s" state="M"/>'
        for index in (0, 1)
    )
    return (
        '<net version="1.20"><location netOffset="0.00,0.00" convBoundary="0,-7,320,7" origBoundary="0,0,1,1" '
        'projParameter="!"/>'
        + edge(":S_0", 'function="internal"', seam_m, end_m)
        + edge("east", 'from="A" to="S" priority="1"', 0.0, seam_m)
        + edge("east2", 'from="S" to="B" priority="1"', end_m, 300.0)
        + '<junction id="A" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,-7 0,7"/>'
        + f'<junction id="S" type="priority" x="{seam_m}" y="0" incLanes="east_0 east_1" intLanes=":S_0_0 :S_0_1" '
        + f'shape="{seam_m},-7 {seam_m},0 {end_m},0 {end_m},-7"/>'
        + '<junction id="B" type="dead_end" x="300" y="0" incLanes="east2_0 east2_1" intLanes="" shape="300,7 300,-7"/>'
        + connections
        + "</net>"
    )


@dataclass(frozen=True)
class Scene:
    """What may be varied."""

    duration_s: float = 16.0
    civilians: int = 4
    changing: int = 4
    """Of the civilians ahead, how many leave the lane; the EMV drives through the others."""
    siren: bool = True
    lidar: bool = False
    level: str = "L2"
    seed: int = 0


class SyntheticEpisode:
    """The messages of one episode, in the order in which the recorder stores them."""

    def __init__(self, scene: Scene | None = None) -> None:
        self.scene = scene or Scene()
        self.steps = round(self.scene.duration_s / STEP_S)
        self.time_s = np.arange(self.steps) * STEP_S

    @cached_property
    def description(self) -> EpisodeDescription:
        return EpisodeDescription(
            template="S2",
            level=EmergencyLevel[self.scene.level],
            seed=self.scene.seed,
            map_name="straight",
            map_sha256="0" * 64,
            duration_s=self.scene.duration_s,
            sensor_suite="lidar" if self.scene.lidar else "none",
            preset="paper",
            emv_ids=(EMV,),
            parameters={"predicate": {"name": "lane_cleared", "thresholds": {"lane_changes_min": 3, "passed_min": 3}}},
            versions={"siren_ros": "0.1.0"},
            site={"kind": "multi_lane_road", "edge": "east"},
        )

    @cached_property
    def actors(self) -> dict[int, ActorDescription]:
        emv = ActorDescription(EMV, "emv0", ActorClass.AMBULANCE, 6.2, 2.1, 2.6, (240, 240, 240), is_emv=True)
        actors = {EMV: emv}
        for number in range(self.scene.civilians):
            key = number + 2
            paint = ((40 + 30 * number) % 256, 90, 160)
            actors[key] = ActorDescription(key, f"civ{number}", ActorClass.SEDAN, 4.6, 1.8, 1.45, paint)
        return actors

    def _start_of_change_s(self, number: int) -> float:
        """When the EMV has come within 40 m."""
        return (30.0 + 15.0 * number - 40.0) / 8.0 + 1.5

    @cached_property
    def paths(self) -> dict[int, npt.NDArray[np.float64]]:
        """x, y, vx, vy, yaw of each actor over the steps, shape ``(steps, 5)``."""
        paths = {EMV: self._path(10.0 + 14.0 * self.time_s, 14.0, None)}
        for number in range(self.scene.civilians):
            change = self._start_of_change_s(number) if number < self.scene.changing else None
            paths[number + 2] = self._path(40.0 + 15.0 * number + 6.0 * self.time_s, 6.0, change)
        return paths

    def _path(self, x: npt.NDArray[np.float64], vx: float, change_s: float | None) -> npt.NDArray[np.float64]:
        share = np.zeros(self.steps)
        rate = np.zeros(self.steps)
        if change_s is not None:
            u = np.clip((self.time_s - change_s) / LANE_CHANGE_S, 0.0, 1.0)
            share, rate = u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2 / LANE_CHANGE_S
        vy = rate * (LEFT_Y_M - RIGHT_Y_M)
        y = RIGHT_Y_M + share * (LEFT_Y_M - RIGHT_Y_M)
        return np.stack((x, y, np.full(self.steps, vx), vy, np.arctan2(vy, vx)), axis=1)

    def mode_of(self, actor_id: int, step: int) -> Mode:
        if actor_id == EMV:
            return Mode.ROUTE_FOLLOW
        number = actor_id - 2
        since = step * STEP_S - self._start_of_change_s(number)
        if number >= self.scene.changing or since < -0.75:
            return Mode.NOMINAL
        if since < 0.0:
            return Mode.YIELD_REACTING
        if since < LANE_CHANGE_S:
            return Mode.YIELD_LANE_CHANGE
        behind = self.paths[actor_id][step, 0] + 8.0 < self.paths[EMV][step, 0]
        return Mode.NOMINAL if behind else Mode.YIELD_KEEP_LANE

    def states(self, step: int) -> ActorStates:
        ids = list(self.actors)
        rows = np.array([self.paths[key][step] for key in ids])
        columns = dict(zip(("x_m", "y_m", "vx_mps", "vy_mps", "yaw_rad"), rows.T, strict=True))
        modes = [self.mode_of(key, step) for key in ids]
        driven = [key == EMV or mode is Mode.YIELD_LANE_CHANGE for key, mode in zip(ids, modes, strict=True)]
        owner = [Owner.ROS if flag else Owner.SUMO for flag in driven]
        lights = [Lights.BEACON | (Lights.SIREN if self.scene.siren else Lights.NONE), *[0] * (len(ids) - 1)]
        columns |= {"lights": lights, "residual_m": [0.0 if flag else 0.05 for flag in driven]}
        return actor_states(step, actor_id=ids, mode=modes, owner=owner, **columns)

    def events(self, step: int) -> tuple[Event, ...]:
        events = []
        if step == 0 and self.scene.siren:
            events.append(self._event(step, EventKind.SIREN_ON, EMV))
        changes = {
            Mode.YIELD_REACTING: EventKind.YIELD_REQUESTED,
            Mode.YIELD_LANE_CHANGE: EventKind.YIELD_STARTED,
            Mode.YIELD_KEEP_LANE: EventKind.YIELD_COMPLETED,
            Mode.NOMINAL: EventKind.YIELD_RELEASED,
        }
        events += [
            replace(self._event(step, changes[self.mode_of(key, step)], key), other_id=EMV)
            for key in self.actors
            if key != EMV and self.mode_of(key, step) is not (self.mode_of(key, step - 1) if step else Mode.NOMINAL)
        ]
        return tuple(events)

    def _event(self, step: int, kind: EventKind, actor_id: int) -> Event:
        x, y = self.paths[actor_id][step, :2]
        return Event(step, kind, actor_id, x_m=float(x), y_m=float(y))

    def state_hash(self, step: int) -> int:
        return hash_state(self.states(step), self.traffic(step).signals)

    def traffic(self, step: int) -> TrafficState:
        states = self.states(step)
        told = {"owner": states.owner, "lights": states.lights, "lane": states.y_m > (RIGHT_Y_M + LEFT_Y_M) / 2.0}
        told |= {"spawned": tuple(self.actors.values()) if step == 0 else (), "events": self.events(step)}
        poses = np.column_stack((states.x_m, states.y_m, states.yaw_rad, states.speed_mps))
        return traffic_of(step, "", poses, actor_id=states.actor_id, **told)

    def commands(self, step: int, source: str) -> VehicleCommands:
        states = self.states(step)
        mine = (states.actor_id == EMV) == (source == "emv_controller")
        rows = states.select(mine & (states.owner == Owner.ROS))
        columns: dict[str, Any] = {name: np.zeros(len(rows), dtype) for name, dtype in COMMAND_DTYPES.items()}
        columns.update(actor_id=rows.actor_id, owner=rows.owner, mode=rows.mode, lights=rows.lights)
        return VehicleCommands(step=step, source=source, **columns)

    def ground_truth(self, step: int) -> GroundTruth:
        states = self.states(step)
        others = states.select(np.arange(1, len(states)))
        actors = [self.actors[int(key)] for key in others.actor_id]
        delta = np.stack((others.x_m - states.x_m[0], others.y_m - states.y_m[0]), axis=-1)
        ahead, left = rotate(delta, -float(states.yaw_rad[0])).T
        return GroundTruth(
            step=step,
            carrier_id=EMV,
            actor_id=others.actor_id,
            actor_class=np.array([actor.actor_class for actor in actors], dtype=np.uint8),
            is_emv=np.array([actor.is_emv for actor in actors]),
            x_m=ahead,
            y_m=left,
            z_m=np.array([actor.height_m / 2.0 - 1.93 for actor in actors]),
            yaw_rad=others.yaw_rad - states.yaw_rad[0],
            length_m=np.array([actor.length_m for actor in actors]),
            width_m=np.array([actor.width_m for actor in actors]),
            height_m=np.array([actor.height_m for actor in actors]),
            vx_mps=others.vx_mps,
            vy_mps=others.vy_mps,
            accel_mps2=others.accel_mps2,
            lidar_points=np.full(len(actors), 12, dtype=np.uint32),
        )

    def sweep(self, step: int) -> npt.NDArray[np.void]:
        points = np.zeros(300, LIDAR_POINT_DTYPE)
        rng = np.random.default_rng(step)
        for axis in ("x", "y", "z"):
            points[axis] = rng.normal(scale=10.0, size=len(points))
        points["intensity"] = rng.random(len(points))
        return points

    def outcome(self, predicate_holds: bool | None = True) -> EpisodeOutcome:
        return EpisodeOutcome(EpisodeEnd.COMPLETE, "", self.steps, predicate_holds, {"passed": 4})

    def recorded_topics(self) -> tuple[topics.Topic, ...]:
        core = [topic for topic in topics.CORE_TOPICS if topic != topics.OUTCOME]
        sensors = [topics.GROUND_TRUTH, LIDAR_TOPIC] if self.scene.lidar else []
        return (*core, *sensors, topics.OUTCOME)

    def messages(self) -> Iterator[tuple[topics.Topic, int, Any]]:
        """Topic, step and message, in the recorder's order."""
        yield topics.EPISODE, 0, to_episode_description(self.description)
        yield topics.MAP, 0, make_message("std_msgs/msg/String", data=NET_XML)
        for step in range(self.steps):
            clock = make_message("rosgraph_msgs/msg/Clock", clock=stamp(time_ns_of_step(step)))
            yield topics.CLOCK, step, clock
            yield topics.TRAFFIC, step, to_traffic_state(self.traffic(step))
            for topic, source in ((topics.EMV_COMMANDS, "emv_controller"), (topics.YIELD_COMMANDS, "yield_manager")):
                yield topic, step, to_vehicle_commands(self.commands(step, source))
            yield topics.ACTORS, step, to_actor_states(self.states(step))
            yield topics.EVENTS, step, to_events(step, self.state_hash(step), self.events(step))
            if self.scene.lidar and step % 2 == 0:
                yield topics.GROUND_TRUTH, step, to_ground_truth(self.ground_truth(step))
                yield LIDAR_TOPIC, step, to_point_cloud(step, "lidar", self.sweep(step))
        yield topics.OUTCOME, self.steps - 1, to_episode_outcome(self.outcome())
