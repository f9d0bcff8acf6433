"""All sensors of one carrier. The rig measures at a step, in part in background threads.

A roadside unit stands at a given place, at the corner of the episode's junction, or at the side of its road.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final

import numpy as np
import shapely

from siren_ros.base.numerics.arrays import Floats, Floats32, Matrix, Rows
from siren_ros.errors import InputError, SirenError
from siren_ros.sensing.camera.camera import Camera, CameraFrame, RaycastRenderer
from siren_ros.sensing.camera.renderer import Renderer, RendererUnavailableError
from siren_ros.sensing.lidar.embree import RaycastWorld
from siren_ros.sensing.lidar.lidar import CarrierMotion, Lidar, LidarSweep
from siren_ros.sensing.look import Look
from siren_ros.sensing.meshes.mesh import Catalogue, Material, StaticScene, VehiclePlacement, VehicleShape
from siren_ros.sensing.navigation import Odometers
from siren_ros.sensing.scene.static_scene import kept_scene
from siren_ros.sensing.scene.surfaces import SceneConfig
from siren_ros.sensing.specification import CameraSpec, CarrierView, Mount, SensorSpec, map_from_base
from siren_ros.sensing.suite import SENSOR_TYPES, LabelKinds, SensorSuite, Station
from siren_ros.sensing.truth import ImageLabeller, label_boxes
from siren_ros.sensing.vehicles.vehicle_shapes import vehicle_shape
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.roads.sites import middle_of_site
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    NO_ACTOR,
    ActorClass,
    ActorDescription,
    ActorStates,
    SignalState,
    rows_of_ids,
)
from siren_ros.simulation.world.carrier import BASE_FRAME, LABEL_PERIOD_STEPS, STATION_FRAME, CameraTruth, GroundTruth

_BESIDE_M: Final = 0.8
"""Distance between the pole and the nearest lane."""
_SPACING_M: Final = 1.0
_REACH_M: Final = 80.0
_SOLID: Final = (Material.BUILDING_WALL, Material.BUILDING_ROOF, Material.FOLIAGE, Material.TREE_TRUNK)
_ASIDE_M: Final = (1.7e-5, 2.3e-5)
"""Offset of a ray straight up from the sensor, so that it does not pass exactly through the edge of two triangles."""
_TRAFFIC: Final = (LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL)


def station_mount(station: Station, network: RoadNetwork, site: Mapping[str, object] | None = None) -> Mount:
    """The pose of a station in the ``map`` frame, on the ground.

    At a site, given as in the episode's description, it is the free place nearest to the site's middle that is off all
    lanes, facing that middle; of several the one nearest to the east. The middle of a road is half way along it.

    Raises:
        InputError: The station waits for a site, and there is none.
    """
    if station.place is not None:
        return station.place
    middle = middle_of_site(network, site or {})
    if middle is None:
        raise InputError("sensors", "station: site", "an episode with a site, or a station with x_m and y_m")
    place = shapely.Point(*middle)
    lanes = shapely.union_all(
        [
            shapely.LineString(lane.centre.points).buffer(lane.width_m / 2.0 + _BESIDE_M)
            for lane in network.lanes
            if lane.kind in _TRAFFIC and shapely.LineString(lane.centre.points).distance(place) < _REACH_M
        ]
    )
    blocks = [block for block in shapely.get_parts(lanes) if block.distance(place) < _REACH_M]
    edge = max(blocks, key=lambda block: float(block.area)).exterior
    count = max(2, int(edge.length / _SPACING_M))
    places = shapely.get_coordinates(shapely.line_interpolate_point(edge, np.arange(count) * edge.length / count))
    away = places - middle
    chosen = int(np.lexsort((np.abs(np.arctan2(away[:, 1], away[:, 0])).round(6), np.hypot(*away.T).round(3)))[0])
    x_m, y_m = (float(value) for value in places[chosen])
    return Mount(x_m, y_m, 0.0, float(np.arctan2(middle[1] - y_m, middle[0] - x_m)))


def check_outdoors(scene: StaticScene, suite: SensorSuite, station: Mount) -> None:
    """Raise InputError if a sensor is inside a building or tree.

    A ray straight up from there crosses an odd number of surfaces.
    """
    solid = np.isin(scene.mesh.material, [int(kind) for kind in _SOLID])
    corners = scene.mesh.vertices_m[scene.mesh.triangles[solid]].astype(np.float64)
    for name, mount in suite.mounts:
        x, y, z = (station.base_from_sensor @ mount.base_from_sensor)[:3, 3]
        if crossings_above(corners, float(x), float(y), float(z)) % 2:
            place = f"({x:.1f}, {y:.1f}, {z:.1f}) m in the map frame"
            raise InputError(f"{suite.name}: {name}.mount", place, "a place outside of buildings and trees")


def crossings_above(corners: Floats, x_m: float, y_m: float, z_m: float) -> int:
    """How many triangles of shape ``(T, 3, 3)`` a ray straight up from a point crosses: odd inside a closed body."""
    a, b, c = (corners[:, k, :2] - (x_m + _ASIDE_M[0], y_m + _ASIDE_M[1]) for k in range(3))
    ab, bc, ca = _cross(a, b), _cross(b, c), _cross(c, a)
    around = ((ab > 0) & (bc > 0) & (ca > 0)) | ((ab < 0) & (bc < 0) & (ca < 0))
    weight = np.stack((bc, ca, ab), axis=1)[around]
    height = np.einsum("ij,ij->i", weight, corners[around, :, 2]) / weight.sum(axis=1)
    return int(np.count_nonzero(height > z_m))


def _cross(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


_PARKED_M: Final = 150.0
"""Vehicles parked farther away than this are left out."""


Elsewhere = Callable[
    [ActorStates, Mapping[int, ActorDescription], Matrix, tuple[CameraFrame, ...]],
    tuple[tuple[LidarSweep, ...], tuple[CameraFrame, ...]],
]
"""Gives the sweeps and pictures of another simulator at a step, from all actors but the carrier, what they are, the
pose of the carrier, and the pictures that this machine drew for labels."""


@dataclass(frozen=True, eq=False)
class Observations:
    """Measurements of the sensors that were due at a step."""

    step: int
    sweeps: tuple[LidarSweep, ...]
    frames: tuple[CameraFrame, ...]
    truth: GroundTruth | None
    """Labels in space; present every ``LABEL_PERIOD_STEPS``."""
    labels: Mapping[str, CameraTruth] = field(default_factory=dict)
    """Labels of the pictures by camera, if the suite or a listener asks for them."""
    others: tuple[tuple[SensorSpec, Any], ...] = ()
    """Measurements of the suite's other sensors, each with its specification."""


@dataclass(frozen=True, eq=False)
class Sensing:
    """Measurements of a step that have begun and are not finished yet."""

    under_way: bool
    """Whether other threads are still making pictures or sweeps."""
    finish: Callable[[], Observations]
    """Waits for the threads and returns all measurements. Call it once, before the next step's measurements begin."""


class SensorRig:
    """The sensors of a suite on a map. The thread that first calls ``observe`` or ``prepare`` draws the pictures."""

    def __init__(
        self,
        suite: SensorSuite,
        network: RoadNetwork,
        seed: int,
        config: SceneConfig | None = None,
        look: Look | None = None,
        scene: StaticScene | None = None,
        noise_seed: int | None = None,
        site: Mapping[str, object] | None = None,
        label_kinds: Callable[[CameraSpec], LabelKinds] | None = None,
        in_background: bool = False,
        elsewhere: Elsewhere | None = None,
    ) -> None:
        """Build the scene that the sensors see.

        ``seed`` is the episode's and decides buildings and trees; ``noise_seed`` is that of all sensor noise, ``seed``
        where None. Without a look it is a clear morning. ``scene`` replaces the generated static scene. ``site`` is
        where the episode happens, as its description gives it, for roadside suites. ``label_kinds`` gives the labels
        that go with a camera's pictures; without it, those that the suite records. With ``in_background`` a background
        thread makes the sweeps while the caller goes on until it calls ``finish``; otherwise all processors share a
        sweep, and the caller waits. ``elsewhere`` are LiDARs and cameras of another simulator; this machine then draws
        only the pictures that labels are made of.

        Raises:
            InputError: A suite that stands at a site, and there is none; or sensors inside a building.
        """
        self.suite = suite
        self._seed = seed if noise_seed is None else noise_seed
        self._look = look or Look()
        types = {row.spec: row for row in SENSOR_TYPES.values()}
        casts = any(types[type(spec)].casts for spec in suite.others)
        self._sees_bodies = bool(suite.lidars or suite.cameras or casts)
        self._elsewhere = elsewhere
        self.simulator: Mapping[str, object] = {}
        """What ``account`` says of another simulator that measures."""
        self._drawn = suite.cameras
        lidars = suite.lidars
        if elsewhere is not None:
            kinds_of = label_kinds or partial(LabelKinds.of, suite)
            self._drawn = tuple(spec for spec in suite.cameras if kinds_of(spec).instance or kinds_of(spec).boxes)
            lidars, self._sees_bodies = (), bool(self._drawn or casts)
        kinds = ActorClass if self._sees_bodies else ()
        self._shapes: Mapping[ActorClass, VehicleShape] = {kind: vehicle_shape(kind) for kind in kinds}
        self._static = scene
        if self._static is None and self._sees_bodies:
            self._static = kept_scene(network, seed, config)
        self._lidars: tuple[Lidar, ...] = ()
        self._world: RaycastWorld | None = None
        if self._static is not None and (lidars or casts):
            self._world = RaycastWorld(self._static, self._shapes)
            share = 0.0 if config is None else config.colour_share
            self._lidars = tuple(Lidar(spec, self._world, self._seed, self._look, share) for spec in lidars)
        self._background = ThreadPoolExecutor(1, "sweep") if in_background and self._lidars else None
        self._cameras: tuple[Camera, ...] | None = None
        self._catalogue = Catalogue(self._shapes)
        self._nobody = self._catalogue.place(ActorStates.empty(), {})
        self._odometers = Odometers()
        self._label_kinds = label_kinds or partial(LabelKinds.of, suite)
        self._labeller = ImageLabeller(self._shapes)
        begins = ((spec, types[type(spec)].begin) for spec in suite.others)
        self._others = tuple((spec, begin(spec, network, self._seed)) for spec, begin in begins if begin is not None)
        self.notes: tuple[str, ...] = ()
        """What the user should know of how this machine simulates the sensors; known after ``prepare``."""
        self._device = ""
        self.station = None if suite.station is None else station_mount(suite.station, network, site)
        """Where the suite stands in the ``map`` frame; None on a vehicle."""
        if self.station is not None and self._static is not None:
            check_outdoors(self._static, suite, self.station)

    @property
    def scene(self) -> StaticScene | None:
        """The static scene, for a second rig in the same world; None where no sensor sees it."""
        return self._static

    @property
    def truth_frame(self) -> str:
        """Frame of the labels: that of the first LiDAR, or the carrier's ``base_link`` without a LiDAR."""
        if self.suite.lidars:
            return self.suite.lidars[0].name
        return BASE_FRAME if self.suite.station is None else STATION_FRAME

    @property
    def base_from_truth(self) -> Matrix:
        """Pose of the labels' frame on the carrier, shape ``(4, 4)``."""
        return self.suite.lidars[0].mount.base_from_sensor if self.suite.lidars else np.eye(4)

    @property
    def account(self) -> dict[str, object]:
        """How this machine simulates the sensors, for the episode's record; complete after ``prepare``."""
        return {"suite": self.suite.name, "pictures_by": self._device, "notes": list(self.notes), **self.simulator}

    def prepare(self) -> None:
        """Compile the shaders and load the loops over rays now, in the thread that will observe.

        Where this machine cannot draw, the cameras cast rays instead, and ``notes`` says so.
        """
        if self._cameras is None:
            self._cameras = ()
            if self._static is not None and self._drawn:
                renderer: Renderer | RaycastRenderer
                try:
                    renderer = Renderer(self._static, self._shapes, self._look)
                except RendererUnavailableError as error:
                    self.notes = (f"{error}; the cameras cast rays instead: slower, without shadows and textures",)
                    renderer = RaycastRenderer(self._static, self._shapes, self._look)
                self._device = renderer.device
                encoder = ThreadPoolExecutor(1, "jpeg")
                self._cameras = tuple(Camera(spec, renderer, self._seed, encoder) for spec in self._drawn)
            no_vehicles = self._catalogue.place(ActorStates.empty(0), {})
            for sweep in [*self._sweeps(0, np.eye(4), no_vehicles, CarrierMotion())]:
                sweep()

    def observe(
        self,
        states: ActorStates,
        descriptions: Mapping[int, ActorDescription],
        signals: Iterable[SignalState],
        carrier_id: int,
    ) -> Observations:
        """Measure with the sensors that are due at the states' step; arguments as ``begin``."""
        return self.begin(states, descriptions, signals, carrier_id).finish()

    def begin(
        self,
        states: ActorStates,
        descriptions: Mapping[int, ActorDescription],
        signals: Iterable[SignalState],
        carrier_id: int,
    ) -> Sensing:
        """Begin to measure with the sensors that are due at the states' step; ``finish`` before the next call.

        The vehicle ``carrier_id`` has the sensors; while it is not among the actors it measures nothing. A suite at a
        station always measures. ``descriptions`` say by id what the actors are, ``signals`` are the traffic lights.
        """
        self.prepare()
        step, states = states.step, self._on_ground(states, descriptions)
        hidden = NO_ACTOR if self.station is not None else carrier_id
        rolled_m = self._odometers.advance(states)[states.actor_id != hidden] if self.suite.cameras else np.empty(0)
        motion = self._motion(states, carrier_id)
        if motion is None:
            truth = self._truth(ActorStates.empty(step), descriptions, hidden, np.eye(4), ())
            nothing = Observations(step, (), (), truth)
            return Sensing(under_way=False, finish=lambda: nothing)
        base, velocity = motion
        states, descriptions = self._with_parked(states, descriptions, base)
        rolled_m = np.append(rolled_m, np.zeros(len(states) - (hidden in states.actor_id) - len(rolled_m)))
        placement = self._catalogue.place(states, descriptions, hidden_id=hidden) if self._sees_bodies else self._nobody
        exposed = tuple(self._expose(step, base, placement, rolled_m, signals))
        swept = tuple(self._sweeps(step, base, placement, velocity))
        # These sensors measure at every step, since some of them differentiate the motion.
        row = states.row_of(carrier_id)
        view = CarrierView(states, base, -1 if row is None else row, partial(self._cast, states, placement))
        measured = [(spec, measure(view)) for spec, measure in self._others]
        others = tuple(item for item in measured if step % item[0].period_steps == 0)

        def finish() -> Observations:
            sweeps = tuple(sweep() for sweep in swept)
            frames = tuple(develop() for develop in exposed)
            if self._elsewhere is not None:
                away = states.select(states.actor_id != hidden)
                sweeps, frames = self._elsewhere(away, descriptions, base, frames)
            truth = self._truth(states, descriptions, hidden, base, sweeps)
            labels = self._labels(frames, base, placement, descriptions)
            return Observations(step, sweeps, frames, truth, labels, others)

        return Sensing(under_way=bool(exposed or swept), finish=finish)

    def _cast(self, states: ActorStates, placement: VehiclePlacement, rays: Floats32) -> tuple[Floats32, Rows]:
        """Implements ``CarrierView.cast``."""
        if self._world is None:
            raise SirenError(f"{self.suite.name}: a sensor casts rays whose SensorType does not say casts=True")
        distance, row = self._world.cast(rays, placement)
        rows = np.append(rows_of_ids(states.actor_id, placement.actor_id), -1)
        return distance, rows[row]

    def _on_ground(self, states: ActorStates, descriptions: Mapping[int, ActorDescription]) -> ActorStates:
        """The states with pedestrians lifted to the surface of raised sidewalks."""
        if self._static is None:
            return states
        kinds = (descriptions[number].actor_class for number in states.actor_id.tolist())
        walking = np.array([kind is ActorClass.PEDESTRIAN for kind in kinds], np.bool_)
        if not walking.any():
            return states
        return replace(states, z_m=np.where(walking, self._static.ground_m(states.x_m, states.y_m), states.z_m))

    def _with_parked(
        self, states: ActorStates, descriptions: Mapping[int, ActorDescription], base: Matrix
    ) -> tuple[ActorStates, Mapping[int, ActorDescription]]:
        """The actors together with the vehicles parked near the carrier, which sensors see like actors."""
        if self._static is None or not self._static.parked or self._elsewhere is not None:
            return states, descriptions
        near = [one for one in self._static.parked if np.hypot(one.x_m - base[0, 3], one.y_m - base[1, 3]) < _PARKED_M]
        poses = {name: np.array([getattr(one, name) for one in near]) for name in ("x_m", "y_m", "z_m", "yaw_rad")}
        poses["actor_id"] = np.array([one.actor.actor_id for one in near], np.uint32)
        columns = {
            name: np.concatenate((getattr(states, name), poses.get(name, np.zeros(len(near))).astype(dtype)))
            for name, dtype in ACTOR_STATE_DTYPES.items()
        }
        return ActorStates(states.step, **columns), {**descriptions, **{one.actor.actor_id: one.actor for one in near}}

    def _motion(self, states: ActorStates, carrier_id: int) -> tuple[Matrix, CarrierMotion] | None:
        """Pose and motion of the vehicle or station with the sensors; None where the vehicle has left the map."""
        if self.station is not None:
            return self.station.base_from_sensor, CarrierMotion()
        row = states.row_of(carrier_id)
        if row is None:
            return None
        x_m, y_m, z_m, yaw_rad = (float(values[row]) for values in (states.x_m, states.y_m, states.z_m, states.yaw_rad))
        vx_mps, vy_mps, turn = (float(values[row]) for values in (states.vx_mps, states.vy_mps, states.yaw_rate_radps))
        return map_from_base(x_m, y_m, z_m, yaw_rad), CarrierMotion(vx_mps, vy_mps, turn)

    def _labels(
        self,
        frames: tuple[CameraFrame, ...],
        base: Matrix,
        placement: VehiclePlacement,
        descriptions: Mapping[int, ActorDescription],
    ) -> dict[str, CameraTruth]:
        cameras = {spec.name: spec for spec in self.suite.cameras}
        is_emv = np.array([descriptions[int(actor_id)].is_emv for actor_id in placement.actor_id], dtype=np.bool_)
        labels = {}
        for frame in frames:
            camera, instance = cameras[frame.sensor], frame.image.instance
            if self._label_kinds(camera).boxes and instance is not None:
                pose = base @ camera.mount.base_from_sensor
                label = self._labeller.label(frame.step, frame.camera, pose, placement, instance, is_emv)
                labels[frame.sensor] = label
        return labels

    def _truth(
        self,
        states: ActorStates,
        descriptions: Mapping[int, ActorDescription],
        carrier_id: int,
        base: Matrix,
        sweeps: Sequence[LidarSweep],
    ) -> GroundTruth | None:
        if states.step % LABEL_PERIOD_STEPS:
            return None
        sweep = next((sweep for sweep in sweeps if sweep.sensor == self.truth_frame), None)
        truth = label_boxes(states, descriptions, carrier_id, base @ self.base_from_truth, sweep)
        return replace(truth, frame_id=self.truth_frame)

    def _sweeps(
        self, step: int, base: Matrix, placement: VehiclePlacement, motion: CarrierMotion
    ) -> Iterable[Callable[[], LidarSweep]]:
        for lidar in self._lidars:
            if step % lidar.spec.period_steps == 0:
                pose = base @ lidar.spec.mount.base_from_sensor
                if self._background is not None:
                    yield lidar.begin(step, pose, placement, motion, self._background)
                else:
                    yield partial(lidar.scan, step, pose, placement, motion)

    def _expose(
        self, step: int, base: Matrix, placement: VehiclePlacement, rolled_m: Floats, signals: Iterable[SignalState]
    ) -> Iterable[Callable[[], CameraFrame]]:
        states = {signal.signal_id: signal.state for signal in signals}
        for camera in self._cameras or ():
            if step % camera.spec.period_steps == 0:
                pose = base @ camera.spec.mount.base_from_sensor
                yield camera.expose(step, pose, placement, rolled_m, states, self._label_kinds(camera.spec))
