"""All sensors of one carrier over one world: the facade that ``sensor_sim`` drives."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from siren_ros.sensors.camera import Camera, CameraFrame
from siren_ros.sensors.ground_truth import ground_truth
from siren_ros.sensors.lidar import CarrierMotion, Lidar, LidarSweep
from siren_ros.sensors.mount import Matrix, map_from_base
from siren_ros.sensors.placement import Catalogue, Placement
from siren_ros.sensors.raycast_world import RaycastWorld
from siren_ros.sensors.render.look import Look
from siren_ros.sensors.render.renderer import Renderer
from siren_ros.sensors.scene.config import SceneConfig
from siren_ros.sensors.scene.mesh import StaticScene, VehicleShape
from siren_ros.sensors.scene.static_scene import static_scene
from siren_ros.sensors.scene.vehicle_shapes import vehicle_shape
from siren_ros.sensors.suite import SensorSuite, period_steps
from siren_ros.world.actors import ActorClass, ActorDescription, ActorStates, rows_of_ids
from siren_ros.world.ground_truth import GroundTruth
from siren_ros.world.road_network import RoadNetwork
from siren_ros.world.traffic_state import SignalState
from siren_ros.world.units import STEP_S

BASE_FRAME = "base_link"


@dataclass(frozen=True, eq=False)
class Observations:
    """What the sensors that were due at a step measured."""

    step: int
    sweeps: tuple[LidarSweep, ...]
    frames: tuple[CameraFrame, ...]
    truth: GroundTruth


class Odometers:
    """How far every actor has driven, so that wheels turn."""

    def __init__(self) -> None:
        self._step: int | None = None
        self._ids = np.empty(0, np.uint32)
        self._rolled_m = np.empty(0, np.float64)

    def advance(self, states: ActorStates) -> npt.NDArray[np.float64]:
        """Distance rolled by each row of the states, counted from when the actor was first seen."""
        rows = rows_of_ids(self._ids, states.actor_id)
        rolled = np.where(rows >= 0, self._rolled_m[rows], 0.0) if len(self._ids) else np.zeros(len(states))
        elapsed_s = 0.0 if self._step is None else (states.step - self._step) * STEP_S
        forward = states.vx_mps * np.cos(states.yaw_rad) + states.vy_mps * np.sin(states.yaw_rad)
        rolled = rolled + forward * elapsed_s
        self._step, self._ids, self._rolled_m = states.step, states.actor_id, rolled
        return rolled


class SensorRig:
    """Sensors of a suite over a map. Pictures are drawn in the thread that first calls ``observe`` or ``prepare``."""

    def __init__(
        self,
        suite: SensorSuite,
        network: RoadNetwork,
        seed: int,
        config: SceneConfig | None = None,
        look: Look | None = None,
        scene: StaticScene | None = None,
        noise_seed: int | None = None,
    ) -> None:
        """Build the scene that the sensors see.

        Args:
            suite: The sensors.
            network: The map.
            seed: Of the episode: buildings and trees.
            config: Numbers of the generated world; defaults where None.
            look: Sun, sky and haze; a clear morning where None.
            scene: A ready static scene in place of the generated one.
            noise_seed: Of all sensor noise; ``seed`` where None.
        """
        self.suite = suite
        self._seed = seed if noise_seed is None else noise_seed
        self._look = look
        self._shapes: Mapping[ActorClass, VehicleShape] = {kind: vehicle_shape(kind) for kind in ActorClass}
        self._static = scene
        if self._static is None and (suite.lidars or suite.cameras):
            self._static = static_scene(network, seed, config)
        self._lidars: tuple[Lidar, ...] = ()
        if self._static is not None and suite.lidars:
            world = RaycastWorld(self._static, self._shapes)
            self._lidars = tuple(Lidar(spec, world, self._seed) for spec in suite.lidars)
        self._cameras: tuple[Camera, ...] | None = None
        self._catalogue = Catalogue(self._shapes)
        self._odometers = Odometers()

    @property
    def scene(self) -> StaticScene | None:
        """What stands still around the sensors, for a second rig in the same world; None where nothing is sensed."""
        return self._static

    @property
    def truth_frame(self) -> str:
        """Frame of the labels: the first LiDAR, or the carrier's ``base_link`` where there is none."""
        return self.suite.lidars[0].name if self.suite.lidars else BASE_FRAME

    @property
    def base_from_truth(self) -> Matrix:
        """Pose of the labels' frame on the carrier, shape ``(4, 4)``."""
        return self.suite.lidars[0].mount.base_from_sensor if self.suite.lidars else np.eye(4)

    def prepare(self) -> None:
        """Compile the shaders now, in the thread that will observe.

        Raises:
            RendererUnavailableError: the suite has cameras and this machine cannot draw.
        """
        if self._cameras is None:
            self._cameras = ()
            if self._static is not None and self.suite.cameras:
                renderer = Renderer(self._static, self._shapes, self._look)
                self._cameras = tuple(Camera(spec, renderer, self._seed) for spec in self.suite.cameras)

    def observe(
        self,
        states: ActorStates,
        descriptions: Mapping[int, ActorDescription],
        signals: Iterable[SignalState],
        carrier_id: int,
    ) -> Observations:
        """Measure with the sensors that are due at the states' step.

        Where the carrier is not among the actors nothing is measured.

        Args:
            states: All actors at this step.
            descriptions: What they are, by id.
            signals: The traffic lights.
            carrier_id: Who carries the sensors.

        Raises:
            RendererUnavailableError: at the first call, where the suite has cameras and this machine cannot draw.
        """
        self.prepare()
        step = states.step
        rolled_m = self._odometers.advance(states)
        row = int(rows_of_ids(states.actor_id, np.array([carrier_id], np.uint32))[0])
        if row < 0:
            return Observations(
                step, (), (), self._truth(ActorStates.empty(step), descriptions, carrier_id, np.eye(4), None)
            )
        base = map_from_base(
            float(states.x_m[row]), float(states.y_m[row]), float(states.z_m[row]), float(states.yaw_rad[row])
        )
        placement = self._catalogue.place(states, descriptions, hidden_id=carrier_id)
        motion = CarrierMotion(float(states.vx_mps[row]), float(states.vy_mps[row]), float(states.yaw_rate_radps[row]))
        sweeps = tuple(self._sweeps(step, base, placement, motion))
        others = states.actor_id != carrier_id
        frames = tuple(self._frames(step, base, placement, rolled_m[others], signals))
        first = next((sweep for sweep in sweeps if sweep.sensor == self.truth_frame), None)
        truth = self._truth(states, descriptions, carrier_id, base, first)
        return Observations(step, sweeps, frames, truth)

    def _truth(
        self,
        states: ActorStates,
        descriptions: Mapping[int, ActorDescription],
        carrier_id: int,
        base: Matrix,
        sweep: LidarSweep | None,
    ) -> GroundTruth:
        truth = ground_truth(states, descriptions, carrier_id, base @ self.base_from_truth, sweep)
        return replace(truth, frame_id=self.truth_frame)

    def _sweeps(self, step: int, base: Matrix, placement: Placement, motion: CarrierMotion) -> Iterable[LidarSweep]:
        for lidar in self._lidars:
            if step % period_steps(lidar.spec.rate_hz) == 0:
                yield lidar.scan(step, base @ lidar.spec.mount.base_from_sensor, placement, motion)

    def _frames(
        self,
        step: int,
        base: Matrix,
        placement: Placement,
        rolled_m: npt.NDArray[np.float64],
        signals: Iterable[SignalState],
    ) -> Iterable[CameraFrame]:
        states = {signal.signal_id: signal.state for signal in signals}
        for camera in self._cameras or ():
            if step % period_steps(camera.spec.rate_hz) == 0:
                pose = base @ camera.spec.mount.base_from_sensor
                yield camera.expose(step, pose, placement, rolled_m, states)
