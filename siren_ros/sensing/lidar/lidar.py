"""A rotating LiDAR: one sweep of the scene at one instant, with the reflectivity of the surfaces that it meets.

A whole sweep is one compiled loop: it takes the interpreter's lock once to begin and once to end. Surfaces reflect by
their material, and by their colour where a study asks for it.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from threading import Event
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats32, Matrix, Rows
from siren_ros.base.numerics.compiled import Array, compiled
from siren_ros.sensing.lidar import lidar_loops as loops
from siren_ros.sensing.lidar.embree import PacketTree, RaycastWorld, RayHits, cast_packets, tiles
from siren_ros.sensing.lidar.lidar_loops import select_candidates
from siren_ros.sensing.look import Look
from siren_ros.sensing.meshes.mesh import Material, VehiclePlacement
from siren_ros.sensing.specification import LidarSpec, inverse, sensor_generator

_DEFAULT: Final = 0.4
_REFLECTIVITY: Final[dict[Material, float]] = {
    Material.GROUND: 0.25,
    Material.GRASS: 0.45,
    Material.ASPHALT: 0.17,
    Material.SHOULDER_ASPHALT: 0.2,
    Material.MARKING_WHITE: 0.75,
    Material.MARKING_YELLOW: 0.6,
    Material.KERB: 0.4,
    Material.SIDEWALK: 0.35,
    Material.MEDIAN: 0.4,
    Material.BUILDING_WALL: 0.45,
    Material.BUILDING_ROOF: 0.3,
    Material.BUILDING_GLASS: 0.1,
    Material.TREE_TRUNK: 0.3,
    Material.FOLIAGE: 0.5,
    Material.METAL_POLE: 0.5,
    Material.SIGNAL_HOUSING: 0.15,
    Material.STOP_SIGN: 1.0,
    Material.CAR_PAINT: 0.6,
    Material.FLEET_PAINT: 0.6,
    Material.CAR_GLASS: 0.08,
    Material.TYRE: 0.07,
    Material.RIM: 0.6,
    Material.PLASTIC: 0.12,
    Material.CLOTHING: 0.4,
    Material.SKIN: 0.55,
    Material.LIVERY: 1.0,
    Material.PLATE: 1.0,
}

REFLECTIVITY: Final = np.array([_REFLECTIVITY.get(material, _DEFAULT) for material in Material], dtype=np.float32)
"""Reflectivity by material code at normal incidence, 0–1, in the near infrared (about 905 nm).

Orders of magnitude after the ASTER/ECOSTRESS spectral library: asphalt 0.1–0.2, vegetation 0.4–0.5, concrete 0.3–0.4,
rubber below 0.1; retro-reflective sheeting saturates a receiver and is 1; glass mostly lets light through or
mirrors it.
"""
REFLECTIVITY.setflags(write=False)


_COLOURED: Final = (Material.CAR_PAINT, Material.FLEET_PAINT, Material.BUILDING_WALL, Material.METAL_POLE)
_DARKEST: Final = 0.04
_BRIGHTEST: Final = 0.85


def reflectivity_of(
    material: npt.NDArray[np.uint8], colour_rgb: npt.NDArray[np.uint8], colour_share: float
) -> Floats32:
    """Reflectivity of triangles, shape ``(T,)``, from their materials, ``(T,)``, and colours, ``(T, 3)``.

    With ``colour_share`` 0 each material has one value. With 1, paint, walls and sheet metal have that of their colour:
    the linear red of the picture, the nearest that it has to near infrared, from 0.04 (carbon black) to 0.85 (titanium
    white). In between, values are mixed.
    """
    own = REFLECTIVITY[material]
    if colour_share == 0.0:
        return own
    coloured = np.isin(material, _COLOURED)
    of_colour = _DARKEST + (_BRIGHTEST - _DARKEST) * (colour_rgb[:, 0] / 255.0) ** 2
    return np.where(coloured, (1.0 - colour_share) * own + colour_share * of_colour, own).astype(np.float32)


LIDAR_POINT_DTYPE: Final = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("intensity", "<f4"),
        ("time", "<f4"),
        ("ring", "<u2"),
        ("instance", "<u2"),
    ]
)
"""One LiDAR return, 24 bytes: metres in the sensor frame, intensity 0–1, seconds since the stamp, beam, actor id."""


_aim, _merge, _pack = loops.aim, loops.merge_vehicles, loops.pack_points


class Optics(NamedTuple):
    """Inputs that do not change between the sweeps of a sensor."""

    pattern: loops.Pattern
    order: Array
    """Order of the rays for ``TriangleTree.cast``, int32 (R,)."""
    trees: tuple[PacketTree, PacketTree]
    """Trees of the static scene and of the vehicles' shapes."""
    surfaces: loops.Surfaces


class Scratch(NamedTuple):
    """Working memory of one sensor; every sweep overwrites it."""

    poses: Array
    """Pose of the sensor at each column, float32 (C, 3, 4); the caller fills it."""
    rays: Array
    """Origin and direction of each ray, float32 (R, 6)."""
    hits: loops.Hits
    candidates: loops.Candidates
    """Memory for the rays that may hit a vehicle."""


class Rotation(NamedTuple):
    """Inputs of one sweep, and memory for its results."""

    lidar_from_map: Array
    """Transform from the map to the sensor at the stamp, float64 (4, 4)."""
    vehicles: loops.Vehicles
    receiver: loops.Receiver
    step: int
    out: loops.Records
    count_on: Array
    """Points on each vehicle, int64 (N,); zero at first."""


@compiled
def measure_sweep(optics: Optics, scratch: Scratch, rotation: Rotation) -> int:
    """Compute a whole sweep: aim the rays, cast them at the static scene, go on as ``complete_sweep``."""
    _aim(optics.pattern.directions, scratch.poses, scratch.rays)
    hits = scratch.hits
    cast_packets(optics.trees[0], scratch.rays, optics.order, (hits.distance, hits.static_triangle, hits.normal))
    return complete_sweep(optics, scratch, rotation)


@compiled
def complete_sweep(optics: Optics, scratch: Scratch, rotation: Rotation) -> int:
    """Complete a sweep whose hits on the static scene are known: cast at vehicles, then write the points.

    Returns the number of points written. Where ``scratch.candidates`` is too short: minus the length that is needed,
    and nothing is written.
    """
    pattern, hits, memory, vehicles = optics.pattern, scratch.hits, scratch.candidates, rotation.vehicles
    hits.vehicle[:] = 0
    count = select_candidates(scratch.rays, pattern, hits.distance, rotation.lidar_from_map, vehicles, memory)
    if count > memory.ray.shape[0]:
        return -count
    candidates = loops.Candidates(memory.rays[:count], memory.ray[:count], memory.vehicle[:count])
    distance, triangle = np.empty(count, np.float32), np.empty(count, np.uint32)
    normal = np.empty((count, 3), np.float32)
    cast_packets(optics.trees[1], candidates.rays, np.arange(count).astype(np.int32), (distance, triangle, normal))
    _merge(candidates, distance, normal, triangle, vehicles, hits)
    receiver, out, count_on = rotation.receiver, rotation.out, rotation.count_on
    return _pack(scratch.poses, pattern, hits, vehicles, optics.surfaces, receiver, out, count_on)


_ATTENUATION_STEPS_PER_M: Final = 16.0
_SEEN_AT_RANGE: Final = 0.1
"""Reflectivity of the target on which data sheets state a LiDAR's range in clear air."""
_GRID_OF_UNIT: Final = 1.5 * 2.0**23
"""Adding and subtracting this number rounds a float32 to a whole number, since its significand has 24 bits."""


@dataclass(frozen=True, eq=False)
class LidarSweep:
    """The returns of one rotation."""

    sensor: str
    step: int
    points: npt.NDArray[np.void]
    """Records of dtype ``LIDAR_POINT_DTYPE`` in firing order, shape ``(P,)``: metres in the sensor's frame, intensity
    0–1, seconds relative to the stamp (≤ 0), ring (0 lowest), actor hit (0: static scene)."""
    actor_id: npt.NDArray[np.uint32]
    """Ids of the vehicles within range, sorted, shape ``(N,)``."""
    points_on_actor: npt.NDArray[np.int64]
    """Number of returns on each of these vehicles, shape ``(N,)``."""

    @property
    def payload(self) -> memoryview:
        """The points as bytes, without a copy."""
        return self.points.view(np.uint8).data


@dataclass(frozen=True)
class CarrierMotion:
    """Motion of the carrier during a rotation; used where the suite asks for motion distortion."""

    vx_mps: float = 0.0
    vy_mps: float = 0.0
    yaw_rate_radps: float = 0.0


def beam_pattern(spec: LidarSpec) -> loops.Pattern:
    """Directions, times and rings of the beams of one rotation.

    The beams are equally spaced in elevation from the lower to the upper limit, both included. Columns turn
    clockwise seen from above, as rotating LiDARs do, from straight back over the left side and the front; the last
    one fires at the sweep's stamp.
    """
    columns = spec.columns
    elevation = np.linspace(spec.lower_fov_rad, spec.upper_fov_rad, spec.channels)
    azimuth = np.pi - 2.0 * np.pi * np.arange(columns) / columns
    az, el = np.meshgrid(azimuth, elevation, indexing="ij")
    directions = np.stack((np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)), axis=-1)
    time_s = (np.arange(columns) - (columns - 1)) / (columns * spec.rate_hz)
    return loops.Pattern(
        directions=np.ascontiguousarray(directions.reshape(-1, 3), dtype=np.float32),
        column_time_s=time_s.astype(np.float32),
        elevation=elevation,
        slope=np.tan(elevation),
        world_time_s=time_s.astype(np.float32) if spec.motion_distortion else np.zeros(columns, np.float32),
    )


class Lidar:
    """Simulates one LiDAR on one carrier. It holds working memory, so only one sweep can run at a time."""

    def __init__(
        self, spec: LidarSpec, world: RaycastWorld, seed: int, look: Look | None = None, colour_share: float = 0.0
    ) -> None:
        """Prepare the beam pattern; ``seed`` is the episode's. Rain and fog of the look weaken the returns.

        Returns that become too weak are lost. In clear air every return is kept, as in CARLA. ``colour_share`` is that
        of ``reflectivity_of``.

        """
        self.spec = spec
        self._colour_share = colour_share
        self._world = world
        self._seed = seed
        self.pattern = beam_pattern(spec)
        rays = len(self.pattern.directions)
        self._optics = Optics(
            pattern=self.pattern,
            order=tiles(spec.columns, spec.channels),
            trees=world.packets(),
            surfaces=loops.Surfaces(
                reflectivity_of(world.static_material, world.static_colour_rgb, colour_share),
                np.where(
                    world.shape_material == Material.CAR_PAINT,
                    np.float32(0.0),
                    reflectivity_of(world.shape_material, world.shape_colour_rgb, colour_share),
                ),
            ),
        )
        self._static_hits = static = RayHits.for_rays(rays)
        self._scratch = Scratch(
            poses=np.empty((spec.columns, 3, 4), np.float32),
            rays=np.empty((rays, 6), np.float32),
            hits=loops.Hits(
                static.distance,
                static.normal,
                static.triangle,
                np.empty(rays, np.int32),
                np.empty(rays, np.uint32),
                np.empty(rays, np.float32),
            ),
            candidates=_candidates(rays // 4),
        )
        distances = np.arange(int(spec.range_m * _ATTENUATION_STEPS_PER_M) + 2) / _ATTENUATION_STEPS_PER_M
        extinction_per_m = look.lidar_extinction_per_m if look is not None else 0.0
        per_m = spec.atmosphere_attenuation_per_m + 2.0 * extinction_per_m
        self._attenuation = np.exp(-per_m * distances).astype(np.float32)
        # The power of a return falls with the square of the distance, the intensity does not.
        just_seen = _SEEN_AT_RANGE * np.exp(-spec.atmosphere_attenuation_per_m * spec.range_m)
        least = just_seen * (distances / spec.range_m) ** 2 if extinction_per_m > 0.0 else np.zeros_like(distances)
        self._least = least.astype(np.float32)

    def rays(self, map_from_lidar: Matrix, motion: CarrierMotion | None = None) -> Floats32:
        """Origin and direction of every beam in the ``map`` frame, shape ``(R, 6)``; overwritten by the next call."""
        scratch = self._scratch
        scratch.poses[:] = self._column_poses(map_from_lidar, motion)
        loops.aim(self.pattern.directions, scratch.poses, scratch.rays)
        return scratch.rays

    def scan(
        self, step: int, map_from_lidar: Matrix, placement: VehiclePlacement, motion: CarrierMotion | None = None
    ) -> LidarSweep:
        """Simulate one rotation that ends at ``step``, from a pose of the sensor, ``(4, 4)``.

        Without motion distortion nothing moves during the rotation, as in CARLA's synchronous mode. The points' times
        still say when the beam would have fired.
        """
        rotation = self._rotation(step, map_from_lidar, placement)
        self._world.cast_static(self.rays(map_from_lidar, motion), self._static_hits, self._optics.order)
        return self._swept(rotation, self._complete(rotation))

    def begin(
        self,
        step: int,
        map_from_lidar: Matrix,
        placement: VehiclePlacement,
        motion: CarrierMotion | None,
        background: Executor,
    ) -> Callable[[], LidarSweep]:
        """Begin ``scan`` in a background thread; the returned function waits for the sweep. One rotation at a time."""
        rotation = self._rotation(step, map_from_lidar, placement)
        self._scratch.poses[:] = self._column_poses(map_from_lidar, motion)
        started = Event()

        def measure() -> int:
            started.set()
            return measure_sweep(self._optics, self._scratch, rotation)

        measured = background.submit(measure)
        # Without this the background thread waits for the interpreter's lock: 5 ms if the caller is busy.
        started.wait()

        def finish() -> LidarSweep:
            written = measured.result()
            return self._swept(rotation, written if written >= 0 else self._complete(rotation))

        return finish

    def _rotation(self, step: int, map_from_lidar: Matrix, placement: VehiclePlacement) -> Rotation:
        """Inputs and output memory of one sweep."""
        reach = self.spec.range_m + placement.size_m.sum(axis=1) / 2.0
        near = np.flatnonzero(placement.distance_m(map_from_lidar[0, 3], map_from_lidar[1, 3]) < reach)
        points = np.empty(len(self._scratch.rays), LIDAR_POINT_DTYPE).view(np.uint8)
        rows = len(self._scratch.rays)
        return Rotation(
            lidar_from_map=inverse(map_from_lidar),
            vehicles=self._vehicles(placement, near),
            receiver=self._receiver(step),
            step=step,
            out=loops.Records(points.view(np.float32).reshape(rows, -1), points.view(np.uint16).reshape(rows, -1)),
            count_on=np.zeros(len(near), np.int64),
        )

    def _complete(self, rotation: Rotation) -> int:
        """Complete the sweep of rays already cast; repeats it with more memory if the first attempt had too little."""
        written = complete_sweep(self._optics, self._scratch, rotation)
        if written < 0:
            self._scratch = self._scratch._replace(candidates=_candidates(-2 * written))
            written = complete_sweep(self._optics, self._scratch, rotation)
        return written

    def _swept(self, rotation: Rotation, written: int) -> LidarSweep:
        points = rotation.out.f4.view(LIDAR_POINT_DTYPE).reshape(-1)[:written]
        return LidarSweep(self.spec.name, rotation.step, points, rotation.vehicles.actor_id, rotation.count_on)

    def _column_poses(self, map_from_lidar: Matrix, motion: CarrierMotion | None) -> Floats32:
        """Pose of the sensor at each column, shape ``(C, 3, 4)``; ``(3, 4)`` without motion distortion."""
        columns = self.spec.columns
        if not self.spec.motion_distortion or motion is None:
            return map_from_lidar[:3].astype(np.float32)
        time_s = self.pattern.column_time_s.astype(np.float64)
        turn = motion.yaw_rate_radps * time_s
        base = map_from_lidar @ inverse(self.spec.mount.base_from_sensor)
        cos, sin, zeros, ones = np.cos(turn), np.sin(turn), np.zeros(columns), np.ones(columns)
        rotation = np.stack((cos, -sin, zeros, sin, cos, zeros, zeros, zeros, ones), axis=-1).reshape(-1, 3, 3)
        arm = map_from_lidar[:3, 3] - base[:3, 3]
        poses = np.empty((columns, 3, 4), np.float32)
        poses[:, :, :3] = rotation @ map_from_lidar[:3, :3]
        shift = np.stack((motion.vx_mps * time_s, motion.vy_mps * time_s, zeros), axis=-1)
        poses[:, :, 3] = base[:3, 3] + shift + rotation @ arm
        return poses

    def _vehicles(self, placement: VehiclePlacement, near: Rows) -> loops.Vehicles:
        world = self._world
        shape = world.shape_rows(placement.actor_class[near])
        pose = np.stack((placement.x_m, placement.y_m, placement.z_m, placement.yaw_rad), axis=1)
        motion = np.stack((placement.vx_mps, placement.vy_mps, placement.yaw_rate_radps), axis=1)
        return loops.Vehicles(
            pose=pose[near],
            motion=motion[near],
            size=placement.size_m[near],
            scale=placement.scale[near].astype(np.float32),
            bounds=world.shape_bounds_m[shape],
            offset=world.shape_offset_m[shape],
            first_triangle=world.shape_start[shape],
            paint=reflectivity_of(
                np.full(len(near), Material.CAR_PAINT, np.uint8), placement.colour_rgb[near], self._colour_share
            ),
            actor_id=placement.actor_id[near],
        )

    def _receiver(self, step: int) -> loops.Receiver:
        """Noise of one step. It depends on (seed, sensor, step) alone, not on earlier steps."""
        spec = self.spec
        none = np.empty(0, np.float32)
        noise = draw = none
        dropping = spec.dropoff_general_rate > 0.0 or spec.dropoff_zero_intensity > 0.0
        if spec.noise_stddev_m > 0.0 or dropping:
            rng = sensor_generator(self._seed, spec.name, step)
            count = len(self.pattern.directions)
            noise = rng.standard_normal(count, np.float32) * np.float32(spec.noise_stddev_m)
            draw = rng.random(count, np.float32) if dropping else none
        limits = (spec.dropoff_general_rate, spec.dropoff_intensity_limit, spec.dropoff_zero_intensity)
        resolution = 2.0 ** round(np.log2(spec.resolution_m)) if spec.resolution_m > 0.0 else 0.0
        return loops.Receiver(
            range_m=np.float32(spec.range_m),
            attenuation=self._attenuation,
            least=self._least,
            steps_per_m=np.float32(_ATTENUATION_STEPS_PER_M),
            grid=_GRID_OF_UNIT * resolution,
            range_noise_m=noise,
            draw=draw,
            dropoff=np.array(limits, np.float32),
        )


def _candidates(count: int) -> loops.Candidates:
    return loops.Candidates(
        rays=np.empty((count, 6), np.float32), ray=np.empty(count, np.int32), vehicle=np.empty(count, np.int32)
    )
