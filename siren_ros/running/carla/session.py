"""A CARLA server that senses an episode: connected, cast, ticked once a step, left as it was found.

Every call has a deadline. What the server refuses before the first step is an error of the input, later one of the
episode.
"""

import hashlib
import math
import queue
import re
import socket
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from importlib import import_module
from importlib.metadata import version
from types import TracebackType
from typing import Any, Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Matrix
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.carla import actor_pose, blueprints, carla_lights, carla_pose, cast_of, signal_colour
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.sensor_messages.mounted_suite import MountedSuite, Published, TrailingSensing, mounted_suites
from siren_ros.data.sensor_messages.sensor_topics import Carrier, noise_seed
from siren_ros.errors import EpisodeError, InputError
from siren_ros.running.carla.sensed import LIDAR, carla_sensors, frame_of, sweep_of
from siren_ros.running.carla.server_map import (
    MOST_M,
    TRAFFIC_LIGHT,
    is_same,
    lane_distances,
    place_of,
    signal_heads,
)
from siren_ros.sensing.camera.camera import CameraFrame
from siren_ros.sensing.lidar.lidar import LidarSweep
from siren_ros.sensing.look import Look, load_look, look_of
from siren_ros.sensing.specification import CameraSpec, LidarSpec, Mount
from siren_ros.sensing.suite import SensorSuite
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.world.actors import (
    TWO_WHEELED,
    ActorClass,
    ActorDescription,
    ActorStates,
    SignalState,
)

DEFAULT_PORT: Final = 2000
CALL_S: Final = 10.0
"""Deadline of each call and of each frame, as in CARLA's own examples; half of what the lockstep gives a step."""
CLOSE_S: Final = 2.0
"""Deadline of each call that puts a server back, so that one that is gone does not hold up the end."""
LOAD_S: Final = 60.0
"""Deadline of the call that loads a map, for which a server needs half a minute."""
_THREADS: Final = 4
"""Threads of the client: with one, a callback in Python and a call that waits for a frame wait for each other."""
_WARM_UP_FRAMES: Final = 20
"""Frames within which every sensor has sent its first; the first one or two are empty in a real server."""
_SPAWN_HEIGHTS_M: Final = (50.0, 100.0, 150.0)
"""Heights above the ground at which actors are spawned, where nothing stands; then they are put to their places."""
_STEER_DEG: Final = 0.5
_WHEEL_RADIUS_M: Final = 0.33
"""Of passenger cars; wheels turn by it."""
_HEAVIEST_RAIN_MM_PER_H: Final = 50.0
"""Violent rain begins here (WMO); CARLA's rain is a percentage."""

_RAW_PARTS: Final = topics.IMAGE.name.count("/")
"""Colours are published for a listener; depth, classes and instances, whose topics have more parts, where recorded."""

_ASK_VERSION: Final = b"\x94\x00\x01\xa7version\x91\x91\xc2"
_TOLD: Final = b"\x94\x01\x01\xc0"
"""MessagePack-RPC: the call ``version`` with the number 1, and how its answer without an error begins."""

Key = tuple[str, str, str]
"""A sensor in the server: names of its carrier and of itself, and its blueprint."""


@contextmanager
def calling(address: str, *, begun: bool = True) -> Iterator[None]:
    """Around calls of the client: its error is one of the episode, or of the input while nothing has begun.

    Raises:
        EpisodeError, InputError: With what the client says.
    """
    try:
        yield
    except (RuntimeError, IndexError) as error:  # the second: a blueprint that the server does not have
        told = " ".join(str(error).split())
        if begun:
            raise EpisodeError(f"the CARLA server at {address}: {told}") from error
        raise InputError("carla", address, f"a CARLA server that answers ({told})") from error


def connected(address: str, timeout_s: float = CALL_S) -> tuple[Any, Any]:
    """CARLA's client library, and a client of the server at ``HOST:PORT``, after a look at its version.

    Raises:
        InputError: No library; nothing listens there, it is no CARLA server, or it has another version than the client.
    """
    host, _, port = address.partition(":")
    try:
        carla, number = import_module("carla"), int(port or DEFAULT_PORT)
        theirs, ours = _version_at(host, number, timeout_s), version("carla")
    except ImportError as error:
        raise InputError("carla", address, "an environment with CARLA's client (./env --with carla)") from error
    except (OSError, ValueError, OverflowError) as error:
        raise InputError("carla", address, f"HOST:PORT of a running CARLA server ({error})") from error
    if theirs != ours:
        raise InputError("carla", address, f"a CARLA server of the client's version {ours}; this one is {theirs}")
    client = carla.Client(host, number, _THREADS)
    client.set_timeout(timeout_s)
    return carla, client


def _version_at(host: str, port: int, timeout_s: float) -> str:
    """The version that a server names; the client comes later, as another program's words abort its process.

    OSError where nothing answers there, ValueError where what answers is no CARLA server.
    """
    with socket.create_connection((host, port), timeout_s) as connection:
        connection.sendall(_ASK_VERSION)
        told = connection.recv(200)
    if not told.startswith(_TOLD) or not (found := re.search(rb"\d+\.\d+[\w.-]*", told)):
        raise ValueError("what answers there is no CARLA server")
    return found.group().decode()


def _sensors_of(suite: SensorSuite) -> tuple[LidarSpec | CameraSpec, ...]:
    """The sensors of a suite that CARLA simulates."""
    return (*suite.lidars, *suite.cameras)


class CarlaSession:
    """A server during one episode; as a context manager it leaves the server as it was."""

    def __init__(self, address: str, timeout_s: float = CALL_S) -> None:
        """Connect; InputError as ``connected``."""
        self.address, self._timeout_s = address, timeout_s
        self.carla, self.client = connected(address, timeout_s)
        self.things: dict[int, Any] = {}
        """CARLA's actors by our ids."""
        self.boxes: dict[int, tuple[Floats, Floats]] = {}
        """Centre and half sizes of an actor's box in CARLA's axes, zeros where it has none."""
        self._sizes: dict[int, ActorDescription] = {}
        self._told: dict[tuple[object, str], float] = {}
        """What the server was told last of a thing, so that it is told changes."""
        self._heads: dict[str, set[tuple[str, int]]] = {}
        self._lamps: dict[str, Any] = {}
        self._sensors: dict[Key, Any] = {}
        self._arrived: dict[Key, queue.SimpleQueue[Any]] = {}
        self._waiting: list[tuple[Carrier, int, SensorSuite, Mount | None]] = []
        self._encoder = ThreadPoolExecutor(1, "jpeg")
        self._frame, self._changed = 0, False
        self._differences: dict[str, float] = {}
        with calling(address, begun=False):
            self._look_at(self.client.get_world())

    def _look_at(self, world: Any) -> None:
        self.world, self.map = world, world.get_map()
        self._library = world.get_blueprint_library()
        self.blueprint_names = frozenset(each.id for each in self._library)
        self._settings, self._weather = world.get_settings(), world.get_weather()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def load(self, drive: str) -> None:
        """Make the server build a map of OpenDRIVE, where it does not have it; InputError where it fails."""
        # CARLA makes lights only of signals of this type; SUMO's exports have types for arrows.
        drive = re.sub(r'type="10000\d\d"', f'type="{TRAFFIC_LIGHT}"', drive)
        self.client.set_timeout(LOAD_S)
        with calling(self.address, begun=False):
            self._look_at(self.client.generate_opendrive_world(drive, self.carla.OpendriveGenerationParameters()))
        self.client.set_timeout(self._timeout_s)

    def _begin(self, network: RoadNetwork, look: Look) -> None:
        """Check the map, take over the clock and the signals, and set the weather. InputError: another map."""
        self._differences = lane_distances(self.carla, self.map, network)
        if not is_same(self._differences):
            allowed = f"the map of the episode, with lanes within {MOST_M} m at 95 % of the places"
            raise InputError("carla", f"{self.map.name}: {self._differences.get('share_m', math.inf):.1f} m", allowed)
        with calling(self.address, begun=False):
            settings, self._changed = self.world.get_settings(), True
            settings.synchronous_mode, settings.fixed_delta_seconds = True, STEP_S
            self.world.apply_settings(settings, self._timeout_s)
            self._heads = signal_heads(self.map, network)
            lamps = self.world.get_actors().filter("traffic.traffic_light*")
            self._lamps = {each.get_opendrive_id(): each for each in lamps}
            if self._lamps:
                self.world.freeze_all_traffic_lights(True)
            weather = self.world.get_weather()
            weather.sun_altitude_angle = math.degrees(look.sun_elevation_rad)
            weather.sun_azimuth_angle = -math.degrees(look.sun_azimuth_rad) % 360.0
            weather.cloudiness, weather.wetness = 100.0 * look.cloud_cover, 100.0 * look.wetness
            weather.precipitation = 100.0 * min(1.0, look.rain_mm_per_h / _HEAVIEST_RAIN_MM_PER_H)
            self.world.set_weather(weather)

    def suites(
        self, episode: EpisodeDescription, network: RoadNetwork, wants_raw: Callable[[Topic], bool]
    ) -> tuple[MountedSuite, ...]:
        """The suites of an episode, whose LiDARs and cameras are the server's; they are mounted with their carriers.

        Raises:
            InputError: A suite that cannot be loaded, or another map.
        """
        self._begin(network, load_look(look_of(episode), episode.files))
        mounted = tuple(
            mounted_suites(
                episode,
                network,
                lambda topic: topic.name.count("/") == _RAW_PARTS and wants_raw(topic),
                in_background=False,
                elsewhere=lambda suite, carrier: partial(
                    self._measured, suite, carrier.name, noise_seed(episode.seed, carrier)
                ),
            )
        )
        for each in mounted:
            each.rig.simulator = self.account
            self._waiting.append((each.carrier, each.messages.carrier_id, each.rig.suite, each.rig.station))
        return mounted

    @property
    def account(self) -> dict[str, object]:
        """The server, and what of the episode it shows otherwise."""
        actors = [ActorDescription(1, "", kind, 0, 0, 0, (0, 0, 0)) for kind in blueprints()]
        stands = {
            actor.actor_class.name.lower(): next(iter(cast_of(actor, self.blueprint_names)), "nothing")
            for actor in actors
            if not blueprints()[actor.actor_class].keys() & self.blueprint_names
        }
        return {
            "simulator": f"CARLA {self.client.get_client_version()}",
            "pictures_by": "CARLA",
            "map": {
                "name": self.map.name,
                "sha256": hashlib.sha256(self.map.to_opendrive().encode()).hexdigest(),
                "lanes": self._differences,
            },
            "signals": f"{len(self._heads.keys() & self._lamps.keys())} of {len(self._lamps)}",
            "replaced": stands,
        }

    def messages(
        self,
        sensing: TrailingSensing,
        states: ActorStates,
        actors: Mapping[int, ActorDescription],
        signals: Sequence[SignalState],
    ) -> Iterator[Published]:
        """Show a step in the server, let it sense, and yield the messages of the step.

        Raises:
            EpisodeError: The server refuses, is gone, or does not answer in time.
        """
        with calling(self.address):
            self._destroy([self.things.pop(each) for each in tuple(self.things) if each not in states.actor_id])
            for row, actor_id in enumerate(states.actor_id.tolist()):
                if actor_id not in self.things:
                    self._spawn(float(states.x_m[row]), float(states.y_m[row]), actors[actor_id])
            self._place(states, actors)
            self._show_signals(signals)
            self._mount()
            self._frame = self.world.tick(self._timeout_s)
        yield from sensing.step(states, {**actors, **self._sizes}, signals)

    def _spawn(self, x_m: float, y_m: float, actor: ActorDescription) -> None:
        carla, names = self.carla, cast_of(actor, self.blueprint_names)
        blueprint = self._library.find(names[0] if names else actor.actor_class.name.lower())
        if blueprint.has_attribute("color") and not actor.actor_class.is_emergency:
            blueprint.set_attribute("color", ",".join(map(str, actor.colour_rgb)))
        if blueprint.has_attribute("role_name"):
            carries = any(actor.actor_id == carrier for _, carrier, _, _ in self._waiting)
            blueprint.set_attribute("role_name", "hero" if carries else f"siren_{actor.actor_id}")
        for height_m in _SPAWN_HEIGHTS_M:
            place = carla.Location(x_m, -y_m, self._ground_m(x_m, y_m) + height_m)
            try:
                thing = self.world.spawn_actor(blueprint, carla.Transform(place, carla.Rotation()))
                break
            except RuntimeError as error:
                if height_m == _SPAWN_HEIGHTS_M[-1] or "spawn" not in str(error).lower():
                    raise EpisodeError(f"actor {actor.actor_id} ({blueprint.id}) in CARLA: {error}") from error
        self.things[actor.actor_id] = thing
        thing.set_simulate_physics(False)
        box = thing.bounding_box
        centre, extent = (np.array([each.x, each.y, each.z]) for each in (box.location, box.extent))
        if actor.actor_class in TWO_WHEELED or extent.min() <= 0.0:
            centre, extent = np.zeros(3), np.zeros(3)
        else:
            length_m, width_m, height_m = (2.0 * extent).tolist()
            self._sizes[actor.actor_id] = replace(actor, length_m=length_m, width_m=width_m, height_m=height_m)
        self.boxes[actor.actor_id] = (centre, extent)

    def _ground_m(self, x_m: float, y_m: float) -> float:
        return float(place_of(self.carla, self.map, x_m, y_m).transform.location.z)

    def _place(self, states: ActorStates, actors: Mapping[int, ActorDescription]) -> None:
        command, batch = self.carla.command, []
        for row, actor_id in enumerate(states.actor_id.tolist()):
            x, y, yaw = (float(values[row]) for values in (states.x_m, states.y_m, states.yaw_rad))
            pose = self._transform(actor_pose(x, y, yaw, self._ground_m(x, y), *self.boxes[actor_id]))
            thing, speed_mps = self.things[actor_id], float(states.speed_mps[row])
            if actors[actor_id].actor_class is ActorClass.PEDESTRIAN:
                batch.append(command.ApplyWalkerState(thing.id, pose, speed_mps))
                continue
            batch.append(command.ApplyTransform(thing.id, pose))
            lights = carla_lights(int(states.lights[row]))  # with an actor in place of its id, the client sends 1
            if self._is_new(actor_id, "lights", lights):
                batch.append(command.SetVehicleLightState(thing.id, lights))
            if actors[actor_id].actor_class not in TWO_WHEELED:
                self._turn_wheels(actor_id, float(np.degrees(states.steer_rad[row])), speed_mps * STEP_S)
        for response in self.client.apply_batch_sync(batch, False):
            if response.has_error():
                raise EpisodeError(f"the CARLA server at {self.address}: {response.error}")

    def _is_new(self, thing: object, what: str, value: float, change: float = 0.0) -> bool:
        """Whether a value differs by more than a change from what the server was told last, which is 0 at first."""
        new = abs(self._told.get((thing, what), 0.0) - value) > change
        if new:
            self._told[thing, what] = value
        return new

    def _turn_wheels(self, actor_id: int, steer_deg: float, moved_m: float) -> None:
        thing, wheels = self.things[actor_id], self.carla.VehicleWheelLocation
        if self._is_new(actor_id, "steering", steer_deg, _STEER_DEG):
            for wheel in (wheels.FL_Wheel, wheels.FR_Wheel):
                thing.set_wheel_steer_direction(wheel, -steer_deg)
        rolled_m = self._told.get((actor_id, "rolled"), 0.0) + moved_m
        if self._is_new(actor_id, "rolled", rolled_m):
            turned_deg = math.degrees(rolled_m / _WHEEL_RADIUS_M) % 360.0
            for wheel in (wheels.FL_Wheel, wheels.FR_Wheel, wheels.BL_Wheel, wheels.BR_Wheel):
                thing.set_wheel_pitch_angle(wheel, -turned_deg)

    def _show_signals(self, signals: Iterable[SignalState]) -> None:
        states = {signal.signal_id: signal.state for signal in signals}
        for name, lamp in self._lamps.items():
            letters = [states[signal][link] for signal, link in self._heads.get(name, ()) if signal in states]
            colour = signal_colour(letters)
            if letters and self._is_new(name, "colour", colour + 1):
                lamp.set_state(self.carla.TrafficLightState.values[colour])

    def _mount(self) -> None:
        """Attach the suites whose carriers are there, and wait until all their sensors send."""
        ready = [each for each in self._waiting if each[3] is not None or each[1] in self.things]
        if not ready:
            return
        self._waiting = [each for each in self._waiting if each not in ready]
        for carrier, actor_id, suite, station in ready:
            for spec in _sensors_of(suite):
                pose, parent = spec.mount.base_from_sensor, None
                if station is not None:
                    pose = station.base_from_sensor @ pose
                    pose[2, 3] += self._ground_m(pose[0, 3], pose[1, 3])
                else:
                    parent, (centre, extent) = self.things[actor_id], self.boxes[actor_id]
                    pose[:3, 3] += (centre[0], -centre[1], centre[2] - extent[2])
                for kind, attributes in carla_sensors(spec):
                    blueprint, key = self._library.find(kind), (carrier.name, spec.name, kind)
                    for name, value in attributes.items():
                        blueprint.set_attribute(name, value)
                    thing = self.world.spawn_actor(blueprint, self._transform(carla_pose(pose)), attach_to=parent)
                    self._sensors[key], self._arrived[key] = thing, queue.SimpleQueue()
                    thing.listen(self._arrived[key].put)
        for _ in range(_WARM_UP_FRAMES):
            frame = self.world.tick(self._timeout_s)
            waiting = [key for key, queue_ in self._arrived.items() if queue_.empty()]
            if not waiting:
                for key in self._arrived:
                    self._take(key, frame)
                return
        raise EpisodeError(f"the CARLA server at {self.address}: no frame of {waiting[0][1]} in {_WARM_UP_FRAMES}")

    def _transform(self, pose: tuple[float, float, float, float, float, float]) -> Any:
        return self.carla.Transform(self.carla.Location(*pose[:3]), self.carla.Rotation(*pose[3:]))

    def _take(self, key: Key, frame: int) -> Any:
        """What a sensor measured at a frame; earlier frames are dropped."""
        with suppress(queue.Empty):
            while (measured := self._arrived[key].get(timeout=self._timeout_s)).frame < frame:
                pass
            if measured.frame == frame:
                return measured
        raise EpisodeError(f"the CARLA server at {self.address}: no frame {frame} of {key[1]} in {self._timeout_s:g} s")

    def _measured(
        self,
        suite: SensorSuite,
        carrier: str,
        seed: int,
        states: ActorStates,
        actors: Mapping[int, ActorDescription],
        base: Matrix,
        drawn: tuple[CameraFrame, ...],
    ) -> tuple[tuple[LidarSweep, ...], tuple[CameraFrame, ...]]:
        """Sweeps and pictures of a carrier that are due at the step that was shown last; see ``Elsewhere``."""
        step, labels = states.step, {frame.sensor: frame.image.instance for frame in drawn}
        got = {key[1:]: self._take(key, self._frame) for key in self._sensors if key[0] == carrier}
        sweeps, frames = [], []
        for spec in _sensors_of(suite):
            of = {kind: measured for (name, kind), measured in got.items() if name == spec.name}
            if step % spec.period_steps or not of:
                continue
            if isinstance(spec, LidarSpec):
                sweeps.append(sweep_of(spec, of[LIDAR], base @ spec.mount.base_from_sensor, states, actors))
                continue
            frame = frame_of(spec, seed, step, of, self._encoder)
            frames.append(replace(frame, image=replace(frame.image, instance=labels.get(spec.name))))
        return tuple(sweeps), tuple(frames)

    def _destroy(self, things: Sequence[Any]) -> None:
        if things:
            self.client.apply_batch_sync([self.carla.command.DestroyActor(each.id) for each in things], False)

    def close(self) -> None:
        """Destroy what was spawned, and restore signals, weather and settings, as far as the server still answers."""
        self.client.set_timeout(min(CLOSE_S, self._timeout_s))
        try:
            for sensor in self._sensors.values():
                sensor.stop()
            self._destroy([*self._sensors.values(), *self.things.values()])
            if self._changed:
                if self._lamps:
                    self.world.freeze_all_traffic_lights(False)
                self.world.set_weather(self._weather)
                self.world.apply_settings(self._settings, CLOSE_S)
        except RuntimeError:
            pass  # the server is gone, and with it what it had
        finally:
            self._sensors.clear()
            self.things.clear()
            self._changed = False
            self._encoder.shutdown()
