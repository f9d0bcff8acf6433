"""A stand-in for a CARLA server: it proves the client's side of the wire, not pictures, sweeps, boxes, spawns, timing.

It speaks msgpack-rpc and CARLA's binary streams on two ports of this machine. Its LiDAR returns one point in each
channel, its cameras colours that follow from the carrier's place. ``fault`` names what goes wrong, and when.
"""

import re
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.managers import BaseManager
from pathlib import Path
from typing import Any, Final

import msgpack

from siren_ros.data.interfaces.carla import blueprints
from siren_ros.simulation.world.actors import ActorClass

VERSION: Final = "0.9.16"
WORLD, LIDAR, RGB, DEPTH, SEMANTIC = 17, 11, 13, 1, 14
STREAM_OF: Final = {
    "sensor.lidar.ray_cast": LIDAR,
    "sensor.camera.rgb": RGB,
    "sensor.camera.depth": DEPTH,
    "sensor.camera.semantic_segmentation": SEMANTIC,
}
SPAWN, DESTROY, TRANSFORM, WALK, LIGHTS = 0, 1, 6, 7, 18
NOTHING: Final = [[False]]
ALWAYS: Final = {
    "get_required_files": [[1, []]],
    "query_lights_state": [[1, []]],
    "is_traffic_manager_running": [[1, False]],
    "get_traffic_manager_running": [[1, ["", 0]]],
    "add_traffic_manager_running": [[1, False]],
}
GREEN: Final = 2


@dataclass
class Actor:
    """What the server keeps of an actor; poses as on the wire: x, y, z in metres, pitch, yaw, roll in degrees."""

    id: int
    parent: int
    description: list[Any]
    box: list[Any]
    pose: list[float]
    lights: int = 0
    physics: bool = True
    speed_mps: float = 0.0
    sign: str = ""
    state: int = 0
    wheels: dict[int, float] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        return str(self.description[1])

    def wire(self) -> list[Any]:
        token = struct.pack("<IHBB16x", self.id, 0, 1, 1) if self.kind.startswith("sensor") else b""
        return [self.id, self.parent, self.description, self.box, b"", token]

    def attributes(self) -> dict[str, str]:
        return {name: value for name, _, value in self.description[2]}


@dataclass
class Fault:
    """A fault: its name, and the number of frames after the first step before it comes."""

    name: str = ""
    after: int = 0


class CarlaServer:
    """The state of the server; each connection has a thread of its own."""

    def __init__(self, drive: str, blueprints: dict[str, tuple[float, float, float]], lights: dict[str, list[float]]):
        self.drive, self.blueprints, self.fault = drive, blueprints, Fault()
        self.version, self.map_name, self.host = VERSION, "Carla/Maps/Town", "127.0.0.1"
        self.settings: list[Any] = [False, False, [False], True, 0.01, 10, 0.0, True, 3000.0, 2000.0, True]
        self.weather: list[float] = [0.0] * 14
        self.frame, self.episode, self.next_id = 100, 7, 1
        self.actors: dict[int, Actor] = {}
        self.streams: dict[int, list[socket.socket]] = {}
        self.history: list[dict[int, Actor]] = []
        self.calls: list[str] = []
        self.frozen = False
        self.lock = threading.RLock()
        self.open: list[socket.socket] = []
        for sign, pose in lights.items():
            actor = self.add("traffic.traffic_light", [], pose, 0)
            actor.sign = sign
        self.rpc, self.stream = (self._listen(answer) for answer in (self._serve, self._subscribe))
        threading.Thread(target=self._idle, daemon=True).start()

    def port(self) -> int:
        """Where clients connect."""
        return int(self.rpc.getsockname()[1])

    def set(self, **values: Any) -> None:
        """Change what the server says of itself, or what goes wrong (``fault``, as a name and a number of frames)."""
        for name, value in values.items():
            setattr(self, name, Fault(*value) if name == "fault" else value)

    def get(self, name: str) -> Any:
        """A part of the server's state."""
        return getattr(self, name)

    def add(self, kind: str, attributes: list[Any], pose: list[float], parent: int) -> Actor:
        length, width, height = self.blueprints.get(kind, (0.0, 0.0, 0.0))
        # A box a little ahead of the origin and above the ground, as CARLA's vehicles have.
        ahead = 0.1 if length else 0.0
        box = [
            [ahead, 0.0, height / 2.0 + 0.02 * bool(length)],
            [length / 2.0, width / 2.0, height / 2.0],
            [0.0, 0.0, 0.0],
            0,
        ]
        with self.lock:
            actor = Actor(self.next_id, parent, [0, kind, attributes], box, list(pose))
            self.actors[self.next_id] = actor
            self.next_id += 1
        return actor

    def close(self) -> None:
        for one in (self.rpc, self.stream, *self.open):
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _listen(self, answer: Any) -> socket.socket:
        listener = socket.create_server((self.host, 0))

        def accept() -> None:
            with suppress(OSError):
                while True:
                    connection, _ = listener.accept()
                    self.open.append(connection)
                    threading.Thread(target=answer, args=(connection,), daemon=True).start()

        threading.Thread(target=accept, daemon=True).start()
        return listener

    def _serve(self, connection: socket.socket) -> None:
        unpacker = msgpack.Unpacker(raw=False, strict_map_key=False)
        with suppress(OSError):
            while data := connection.recv(1 << 16):
                unpacker.feed(data)
                for _, number, method, arguments in unpacker:
                    self.calls.append(method)
                    if self.fault.name == "die connecting" and method == "get_episode_info":
                        self.close()
                    reply = self._answer(method, arguments[1:])
                    connection.sendall(msgpack.packb([1, number, None, reply]))

    def _answer(self, method: str, arguments: list[Any]) -> Any:
        try:
            handler = getattr(self, f"on_{method}", None)
            with self.lock:
                return ALWAYS.get(method, NOTHING) if handler is None else handler(*arguments)
        except KeyError as error:
            return [[0, [f"unknown actor {error}"]]]

    def _subscribe(self, connection: socket.socket) -> None:
        with suppress(OSError, struct.error):
            (stream,) = struct.unpack("<I", connection.recv(4, socket.MSG_WAITALL))
            with self.lock:
                self.streams.setdefault(stream, []).append(connection)
            connection.recv(1)

    def _send(self, stream: int, kind: int, pose: list[float], payload: bytes) -> None:
        message = struct.pack("<QQd6f", kind, self.frame, self.frame * 0.05, *pose) + payload
        for connection in self.streams.get(stream, ()):
            with suppress(OSError):
                connection.sendall(struct.pack("<I", len(message)) + message)

    def _idle(self) -> None:
        """Frames while nobody ticks, as in asynchronous mode."""
        while self.rpc.fileno() >= 0:
            time.sleep(0.02)
            with self.lock:
                if not self.settings[0]:
                    self._advance()

    def _advance(self) -> None:
        self.frame += 1
        actors = b"".join(
            struct.pack("<IB6f9f", actor.id, 1, *actor.pose, *[0.0] * 9) + self._state(actor)
            for actor in self.actors.values()
        )
        self._send(0, WORLD, [0.0] * 6, struct.pack("<Qdf3iI", self.episode, time.time(), 0.05, 0, 0, 0, 0) + actors)
        for actor in list(self.actors.values()):
            kind = STREAM_OF.get(actor.kind)
            if kind is not None and not (self.fault.name == "drop a frame" and self._faulty()):
                self._send(actor.id, kind, self.place(actor), self._measured(actor, kind))

    @staticmethod
    def _state(actor: Actor) -> bytes:
        if actor.sign:
            times = struct.pack("<4fI?B", 10.0, 3.0, 2.0, 0.0, 0, True, actor.state)
            return actor.sign.encode().ljust(32, b"\0") + times
        return bytes(54)

    def place(self, actor: Actor) -> list[float]:
        """The pose of an actor, of its parent where it has one."""
        return self.actors[actor.parent].pose if actor.parent else actor.pose

    def _measured(self, sensor: Actor, kind: int) -> bytes:
        asked = sensor.attributes()
        if kind == LIDAR:
            channels = int(asked["channels"])
            points = [struct.pack("<4f", 5.0, 1.0 + k, -1.0, 0.5) for k in range(channels)]
            return struct.pack(f"<fI{channels}I", 0.0, channels, *[1] * channels) + b"".join(points)
        width, height = int(asked["image_size_x"]), int(asked["image_size_y"])
        pixel = {
            RGB: bytes((10, 20, int(abs(self.place(sensor)[0]) * 100.0) % 256, 255)),
            DEPTH: bytes((0, 0, 1, 255)),
            SEMANTIC: bytes((0, 0, 14, 255)),
        }
        return struct.pack("<IIf", width, height, float(asked["fov"])) + pixel[kind] * (width * height)

    def _faulty(self) -> bool:
        return len(self.history) > self.fault.after

    def on_version(self) -> Any:
        return [[1, self.version]]

    def on_get_episode_info(self) -> Any:
        return [[1, [self.episode, [self._token(0)]]]]

    def _token(self, stream: int) -> bytes:
        return (
            struct.pack("<IHBB", stream, self.stream.getsockname()[1], 1, 1) + socket.inet_aton(self.host) + bytes(12)
        )

    def on_get_sensor_token(self, stream: int) -> Any:
        return [[1, [self._token(stream)]]]

    def on_get_episode_settings(self) -> Any:
        return [[1, self.settings]]

    def on_set_episode_settings(self, settings: list[Any]) -> Any:
        self.settings = settings
        return [[1, self.frame]]

    def on_get_weather_parameters(self) -> Any:
        return [[1, self.weather]]

    def on_set_weather_parameters(self, weather: list[float]) -> Any:
        self.weather = weather
        return NOTHING

    def on_get_map_info(self) -> Any:
        return [[1, [self.map_name, [[[0.0, 0.0, 0.5], [0.0, 0.0, 0.0]]]]]]

    def on_get_map_data(self) -> Any:
        return [[1, self.drive]]

    def on_get_actor_definitions(self) -> Any:
        sensors = {
            "sensor.lidar.ray_cast": "channels range points_per_second rotation_frequency upper_fov lower_fov "
            "atmosphere_attenuation_rate dropoff_general_rate dropoff_intensity_limit dropoff_zero_intensity "
            "noise_stddev",
            **{
                f"sensor.camera.{kind}": "image_size_x image_size_y fov"
                for kind in ("rgb", "depth", "semantic_segmentation")
            },
        }
        rows = {**dict.fromkeys(self.blueprints, "color role_name"), **sensors}
        return [
            [1, [[number, name, name.replace(".", ","), [[key, 3, "0", [], True, False] for key in keys.split()]]
                 for number, (name, keys) in enumerate(rows.items(), 1)]]
        ]  # fmt: skip

    def on_get_actors_by_id(self, ids: list[int]) -> Any:
        return [[1, [self.actors[one].wire() for one in ids if one in self.actors]]]

    def on_spawn_actor(self, description: list[Any], pose: Any, parent: int = 0, *_: Any) -> Any:
        if self.fault.name == "refuse spawn" and description[1].startswith("vehicle"):
            return [[0, ["Spawn failed because of collision at spawn position"]]]
        if self.fault.name == "die spawning" and description[1].startswith("vehicle"):
            self.close()
        flat = [*pose[0], *pose[1]]
        return [[1, self.add(description[1], description[2], flat, parent).wire()]]

    on_spawn_actor_with_parent = on_spawn_actor

    def on_destroy_actor(self, actor: int) -> Any:
        del self.actors[actor]
        return [[1, True]]

    def on_get_actor_bounding_box(self, actor: int) -> Any:
        return [[1, self.actors[actor].box]]

    def on_get_vehicle_light_states(self, *_: Any) -> Any:
        return [[1, [[one.id, one.lights] for one in self.actors.values() if one.kind.startswith("vehicle")]]]

    def on_set_actor_simulate_physics(self, actor: int, on: bool) -> Any:
        self.actors[actor].physics = on
        return NOTHING

    def on_set_traffic_light_state(self, actor: int, state: int) -> Any:
        self.actors[actor].state = state
        return NOTHING

    def on_freeze_all_traffic_lights(self, on: bool) -> Any:
        self.frozen = on
        return NOTHING

    def on_set_wheel_steer_direction(self, actor: int, wheel: int, degrees: float) -> Any:
        self.actors[actor].wheels[wheel] = degrees
        return NOTHING

    def on_apply_batch(self, commands: list[Any], tick: bool) -> Any:  # noqa: ARG002 - the wire's
        return [self._command(*command[0]) for command in commands]

    def _command(self, kind: int, content: list[Any]) -> Any:
        actor = self.actors[content[0]] if kind != SPAWN else None
        if kind == DESTROY:
            del self.actors[content[0]]
        elif kind in {TRANSFORM, WALK}:
            actor.pose = [*content[1][0], *content[1][1]]
            actor.speed_mps = content[2] if kind == WALK else 0.0
        elif kind == LIGHTS:
            actor.lights = content[1]
        return [[1, content[0]]]

    def on_tick_cue(self, *_: Any) -> Any:
        if self.fault.name == "slow":
            time.sleep(0.2)
        if self._faulty() and self.fault.name == "never tick":
            time.sleep(60.0)
        self._advance()
        self.history.append({one.id: Actor(**{**vars(one), "pose": list(one.pose)}) for one in self.actors.values()})
        return [[1, self.frame]]


SIZES: Final = {
    name: (0.4, 0.4, 1.8) if kind is ActorClass.PEDESTRIAN else (length_m, 1.9, 1.6)
    for kind, rows in blueprints().items()
    for name, length_m in rows.items()
}
"""A server with all blueprints of the table."""


def signals_in(drive: str) -> dict[str, list[float]]:
    """The traffic lights of an OpenDRIVE map that SIREN exported, each at the origin."""
    return {name: [0.0] * 6 for name in re.findall(r'<signal id="([^"]+)"[^>]*dynamic="yes"', drive)}


class _Manager(BaseManager):
    """Runs the server in a process of its own: the client holds the interpreter's lock while it waits for answers."""


_Manager.register("CarlaServer", CarlaServer)


@contextmanager
def carla_server(
    drive: str, blueprints: dict[str, tuple[float, float, float]], lights: dict[str, list[float]] | None = None
) -> Iterator[Any]:
    """A server with a map, blueprints by id with their sizes, and signals by their OpenDRIVE ids with their poses."""
    with _Manager(ctx=get_context("spawn")) as manager:
        yield manager.CarlaServer(drive, blueprints, lights or {})  # type: ignore[attr-defined]


def play_words(bag: Path, port: int, out: Path) -> list[str]:
    """The command that plays a bag in a server on this machine."""
    return ["carla", "play", str(bag), "--host", "127.0.0.1", "--port", str(port), "--out", str(out)]
