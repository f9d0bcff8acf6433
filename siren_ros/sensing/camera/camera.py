"""A camera of a suite: noisy pictures as JPEG, and their labels.

Its pictures have smooth edges. Where two colours meet along a row or a column, the ends of the run tell where the true
edge lies, and the pixels beside it get their share of both (morphological anti-aliasing: Reshetov, HPG 2009). That
costs a fraction of several samples per pixel, and labels keep their single sample.

``RaycastRenderer`` draws on machines without EGL: one ray per pixel, with plain light and no shadows. It is slower by
an order of magnitude; geometry, labels and colours of surfaces are the same.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import simplejpeg

from siren_ros.base.numerics.arrays import Floats, Floats32, Matrix
from siren_ros.base.numerics.compiled import Array, compiled
from siren_ros.sensing.camera.renderer import RenderedImage, Renderer
from siren_ros.sensing.camera.surface_light import ambient_light
from siren_ros.sensing.lidar.embree import RaycastWorld, tiles
from siren_ros.sensing.look import Look
from siren_ros.sensing.meshes.mesh import (
    SEMANTIC_CLASS_OF_MATERIAL,
    Material,
    SemanticClass,
    StaticScene,
    VehiclePlacement,
    VehicleShape,
    semantic_class_of_actor,
)
from siren_ros.sensing.specification import CameraSpec, inverse, optical_from_map, rotation_from_rpy, sensor_generator
from siren_ros.sensing.suite import LabelKinds
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import CameraIntrinsics

_CONTRAST: Final = 20
"""Smallest difference in brightness (of 255) between two pixels that counts as an edge."""
_BELOW: Final = 1
_RIGHT: Final = 2


def smooth_edges(rgba: npt.NDArray[np.uint8]) -> None:
    """Smooth the colours in place; shape ``(height, width, 4)``. The fourth channel does not change."""
    height, width = rgba.shape[:2]
    edges = np.zeros((height, width), np.uint8)
    brightness = np.empty((height, width), np.int16)
    _find_edges(rgba, brightness, edges)
    drawn = rgba.copy()
    _smooth_along_rows(drawn, edges, rgba)
    _smooth_along_columns(drawn, edges, rgba)


_RED, _GREEN, _BLUE = range(3)


@compiled
def _find_edges(rgba: Array, brightness: Array, edges: Array) -> None:
    """Mark edges with two bits per pixel.

    One bit says that the pixel differs from the pixel below, the other that it differs from the one to its right.
    """
    height, width = edges.shape
    for y in range(height):
        for x in range(width):
            red, green, blue = np.int16(rgba[y, x, _RED]), np.int16(rgba[y, x, _GREEN]), np.int16(rgba[y, x, _BLUE])
            brightness[y, x] = (red * np.int16(2) + green * np.int16(5) + blue) >> np.int16(3)
    contrast = np.int16(_CONTRAST)
    for y in range(height):
        for x in range(width - 1):
            step = brightness[y, x + 1] - brightness[y, x]
            edges[y, x] = np.uint8(_RIGHT) * np.uint8((step > contrast) | (step < -contrast))
        if y + 1 < height:
            for x in range(width):
                step = brightness[y + 1, x] - brightness[y, x]
                edges[y, x] |= np.uint8(_BELOW) * np.uint8((step > contrast) | (step < -contrast))


@compiled
def _smooth_along_rows(drawn: Array, edges: Array, out: Array) -> None:
    height, width = edges.shape
    for y in range(height):
        start = -1
        for x in range(width + 1):
            if x < width and edges[y, x] & _BELOW:
                start = x if start < 0 else start
            elif start >= 0:
                _blend_run(drawn, edges, out, y, start, x, True)
                start = -1


@compiled
def _smooth_along_columns(drawn: Array, edges: Array, out: Array) -> None:
    """Smooth the horizontal edges. It reads memory row by row, so the runs of all columns are open at the same time."""
    height, width = edges.shape
    starts = np.full(width, -1, np.int32)
    for y in range(height + 1):
        for x in range(width):
            if y < height and edges[y, x] & _RIGHT:
                starts[x] = y if starts[x] < 0 else starts[x]
            elif starts[x] >= 0:
                _blend_run(drawn, edges, out, x, starts[x], y, False)
                starts[x] = -1


@compiled
def _turn(edges: Array, line: int, place: int, lies: bool, short: bool) -> int:
    """Find where an edge after ``line`` turns.

    It gives 1 where the edge turns towards the line between ``place`` and the next pixel, −1 where it turns away, 0
    otherwise.

    A straight edge has steps of one pixel along rows or columns. Where both sides are longer, there is a corner.
    """
    size = edges.shape[0] if lies else edges.shape[1]
    bit = _RIGHT if lies else _BELOW
    turn = 0
    for beside, beyond, side in ((line, line - 1, 1), (line + 1, line + 2, -1)):
        here = edges[beside, place] if lies else edges[place, beside]
        if here & bit:
            if not short and 0 <= beyond < size and (edges[beyond, place] if lies else edges[place, beyond]) & bit:
                return 0
            turn += side
    return turn


@compiled
def _blend_run(drawn: Array, edges: Array, out: Array, line: int, start: int, stop: int, lies: bool) -> None:
    """Blend the pixels along an edge between a line of pixels and the next; ``lies`` says that the lines are rows.

    The true edge leads from half a pixel beside the run's end, where it turns, to the run's middle.
    """
    size = edges.shape[1] if lies else edges.shape[0]
    short = stop - start == 1
    first = _turn(edges, line, start - 1, lies, short) if start > 0 else 0
    last = _turn(edges, line, stop - 1, lies, short) if stop < size else 0
    if (first == 0 and last == 0) or (first == last and _is_thin(edges, line, start, stop, first, lies)):
        return
    reach = 0.5 * (stop - start)
    for k in range(start, stop):
        if first != 0:
            _mix(drawn, out, line, k, first * _share(k - start, reach), lies)
        if last != 0:
            _mix(drawn, out, line, k, last * _share(stop - 1 - k, reach), lies)


@compiled
def _is_thin(edges: Array, line: int, start: int, stop: int, side: int, lies: bool) -> bool:
    """Whether a run borders a line that is one pixel thin; such lines are not smoothed."""
    other = line - side
    if stop - start == 1:
        return True
    if other < 0:
        return False
    if lies:
        return bool(edges[other, start] & edges[other, stop - 1] & _BELOW)
    return bool(edges[start, other] & edges[stop - 1, other] & _RIGHT)


@compiled
def _share(pixel: int, reach: float) -> float:
    """Share of a pixel below the true edge, which falls from ½ at the end of the run to 0 at ``reach`` pixels."""
    far = min(pixel + 1.0, reach)
    return 0.5 * (far - pixel) * (1.0 - 0.5 * (pixel + far) / reach) if far > pixel else 0.0


@compiled
def _mix(drawn: Array, out: Array, line: int, place: int, share: float, lies: bool) -> None:
    weight = int(256.0 * abs(share) + 0.5)
    if weight == 0:
        return
    near, far = (line, line + 1) if share > 0.0 else (line + 1, line)
    y, x, other_y, other_x = (near, place, far, place) if lies else (place, near, place, far)
    for c in range(3):
        own = int(drawn[y, x, c])
        value = int(out[y, x, c]) + ((weight * (int(drawn[other_y, other_x, c]) - own) + 128) >> 8)
        out[y, x, c] = min(max(value, 0), 255)


_REACH_M: Final = 450.0
_PAINTED: Final = (Material.CAR_PAINT, Material.CLOTHING)
"""Materials that are drawn in the actor's colour."""
_LENS_ALBEDO: Final = 0.1
_LENSES: Final = (Material.SIGNAL_RED, Material.SIGNAL_YELLOW, Material.SIGNAL_GREEN)


class RaycastRenderer:
    """Draws one scene for any number of cameras, with the interface of ``Renderer``."""

    device: Final = "ray casting (no OpenGL through EGL on this machine)"

    def __init__(
        self, static: StaticScene, shapes: Mapping[ActorClass, VehicleShape], look: Look | None = None
    ) -> None:
        """Build the ray-casting trees."""
        self.look = look or Look()
        self._static = static
        self._world = RaycastWorld(static, shapes)
        dark = np.isin(static.mesh.material, [int(kind) for kind in _LENSES])
        self._static_albedo = (static.mesh.colour_rgb / 255.0) ** 2 * np.where(dark, _LENS_ALBEDO, 1.0)[:, None]

    def render(
        self,
        camera: CameraIntrinsics,
        map_from_camera: Matrix,
        placement: VehiclePlacement,
        rolled_m: Floats,  # noqa: ARG002 - the interface of all renderers has it; wheels do not turn here
        signals: Mapping[str, str],
        step: int,  # noqa: ARG002 - the interface has it; nothing blinks here
        exposure: float = 1.0,
        labels: bool = False,
        instances: bool = False,
    ) -> RenderedImage:
        """Draw one picture; the arguments are those of ``Renderer.render``."""
        map_from_optical = inverse(optical_from_map(map_from_camera))
        rays = np.empty((camera.height * camera.width, 6), np.float32)
        rays[:, :3] = map_from_optical[:3, 3]
        rays[:, 3:] = camera.pixel_rays().reshape(-1, 3) @ map_from_optical[:3, :3].T.astype(np.float32)
        hits = self._world.cast_static(rays, order=tiles(camera.height, camera.width))
        depth = np.array(hits.distance)
        hit = np.isfinite(depth)
        triangle = np.where(hit, hits.triangle, 0)
        albedo = self._static_albedo[triangle]
        glow = np.zeros_like(albedo)
        for lamp in self._static.signal_lamps:
            if lamp.is_lit(signals.get(lamp.signal_id, "")):
                lens = hit & (triangle >= lamp.start) & (triangle < lamp.stop)
                glow[lens] = albedo[lens] / _LENS_ALBEDO * 2.6 + 0.1
        normal = np.array(hits.normal, dtype=np.float64)
        normal[hit] /= np.linalg.norm(normal[hit], axis=1, keepdims=True)
        semantic = np.where(hit, SEMANTIC_CLASS_OF_MATERIAL[self._static.mesh.material[triangle]], 0).astype(np.uint8)
        semantic[~hit] = int(SemanticClass.SKY)
        actor = np.zeros(len(rays), np.uint32)
        near = np.flatnonzero(placement.distance_m(*map_from_camera[:2, 3]) < _REACH_M)
        for row in near:
            self._vehicle(int(row), placement, rays, depth, (albedo, glow, normal), (semantic, actor))
        seen = self._light(rays, depth, albedo, glow, normal)
        shape = (camera.height, camera.width)
        rgba = np.empty((*shape, 4), np.uint8)
        seen *= exposure  # the same tone curve and gamma as in the renderer's shaders
        film = (seen * (2.51 * seen + 0.03)) / (seen * (2.43 * seen + 0.59) + 0.14)
        rgba[..., :3] = np.rint(255.0 * np.sqrt(np.clip(film, 0.0, 1.0))).astype(np.uint8).reshape(*shape, 3)
        rgba[..., 3] = semantic.reshape(shape)
        far = np.where(np.isfinite(depth), depth, 0.0).astype(np.float32).reshape(shape)
        return RenderedImage(rgba, actor.reshape(shape) if labels or instances else None, far if labels else None)

    def begin(self, *arguments: Any, **options: Any) -> Callable[[], RenderedImage]:
        """Prepare a picture; the returned function casts its rays. The arguments are those of ``Renderer.begin``."""
        return partial(self.render, *arguments, **options)

    def _vehicle(
        self,
        row: int,
        placement: VehiclePlacement,
        rays: Floats32,
        depth: Floats32,
        surface: tuple[Floats, Floats, Floats],
        names: tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint32]],
    ) -> None:
        """Replace hits behind one vehicle with the vehicle's albedo, glow and normal, and its class and actor id."""
        kind = ActorClass(int(placement.actor_class[row]))
        chosen, hits_on_shapes = self._world.cast_at_vehicle(rays, placement, row)
        nearer = hits_on_shapes.distance < depth[chosen]
        pixels = chosen[nearer]
        shape = int(self._world.shape_rows(placement.actor_class[row : row + 1])[0])
        triangle = hits_on_shapes.triangle[nearer].astype(np.int64) + self._world.shape_start[shape]
        albedo, glow, normal = surface
        semantic, actor = names
        depth[pixels] = hits_on_shapes.distance[nearer]
        paint = np.isin(self._world.shape_material[triangle], _PAINTED)[:, None]
        colour = (self._world.shape_colour_rgb[triangle] / 255.0) ** 2
        albedo[pixels] = np.where(paint, colour * (placement.colour_rgb[row] / 255.0) ** 2, colour)
        glow[pixels] = 0.0
        tilted = hits_on_shapes.normal[nearer] / placement.scale[row]
        map_from_vehicle = rotation_from_rpy(0.0, 0.0, float(placement.yaw_rad[row]))
        normal[pixels] = (tilted / np.linalg.norm(tilted, axis=1, keepdims=True)) @ map_from_vehicle.T
        semantic[pixels] = int(semantic_class_of_actor(kind))
        actor[pixels] = placement.actor_id[row]

    def _light(self, rays: Floats32, depth: Floats32, albedo: Floats, glow: Floats, normal: Floats) -> Floats:
        """Linear light that each ray returns."""
        look = self.look
        direction = rays[:, 3:].astype(np.float64)
        length = np.linalg.norm(direction, axis=1)
        facing = np.einsum("ij,ij->i", normal, direction) > 0.0
        outward = np.where(facing[:, None], -normal, normal)
        sun = np.maximum(outward @ look.towards_sun, 0.0)[:, None] * np.array(look.sun_colour)
        light = albedo * (sun + ambient_light(outward, look)) + glow
        horizon, zenith = np.array(look.horizon_colour), np.array(look.zenith_colour)
        hit = np.isfinite(depth)
        distance = np.where(hit, depth, 0.0) * length
        clear = np.exp(-look.haze_per_m * distance)[:, None]
        low = ((1.0 - np.maximum(direction[:, 2] / length, 0.0)) ** 4)[:, None]
        sky = zenith + (horizon - zenith) * low
        return np.where(hit[:, None], horizon * 0.96 * (1.0 - clear) + light * clear, sky)


@dataclass(frozen=True, eq=False)
class CameraFrame:
    """One exposure. All its images show the same instant."""

    sensor: str
    step: int
    camera: CameraIntrinsics
    image: RenderedImage
    encoded: Future[bytes]
    """Gives the JPEG; the encoder may still be working on it."""

    @property
    def jpeg(self) -> bytes:
        """Colour image as JPEG."""
        return self.encoded.result()

    @property
    def rgb(self) -> npt.NDArray[np.uint8]:
        """Colour image as ``rgb8``, contiguous, shape ``(height, width, 3)``."""
        return np.ascontiguousarray(self.image.rgba[..., :3])


class Camera:
    """One camera on one carrier; the renderer may serve several."""

    def __init__(self, spec: CameraSpec, renderer: Renderer | RaycastRenderer, seed: int, encoder: Executor) -> None:
        """Prepare the intrinsics; ``seed`` is the episode's. The encoder runs while the next picture is drawn."""
        self._encoder = encoder
        self.spec = spec
        self.intrinsics = spec.intrinsics
        self._renderer = renderer
        self._seed = seed

    def expose(
        self,
        step: int,
        map_from_camera: Matrix,
        placement: VehiclePlacement,
        rolled_m: Floats,
        signals: Mapping[str, str],
        labels: LabelKinds,
    ) -> Callable[[], CameraFrame]:
        """Begin a picture from a pose of the camera's body frame; the returned function waits for it. Call it once."""
        drawn: dict[str, Any] = {"labels": labels.depth, "instances": labels.instance or labels.boxes}
        scene = (map_from_camera, placement, rolled_m, signals, step)
        picture = self._renderer.begin(self.intrinsics, *scene, exposure=self.spec.exposure, **drawn)
        return partial(self._develop, step, picture)

    def _develop(self, step: int, picture: Callable[[], RenderedImage]) -> CameraFrame:
        return developed(self.spec, self._seed, step, picture(), self._encoder)


def developed(spec: CameraSpec, seed: int, step: int, image: RenderedImage, encoder: Executor) -> CameraFrame:
    """A picture that was drawn, with what the specification asks for; it begins to be encoded.

    Edges are smoothed, colours blurred and noisy. ``seed`` is that of the carrier's noise.
    """
    if spec.anti_aliasing:
        smooth_edges(image.rgba)
    colours = image.rgba[..., :3]  # noise and blur change the colours only, not the labels
    if spec.blur_px > 0.0:
        from scipy.ndimage import gaussian_filter  # noqa: PLC0415 - loads slowly, and few suites need it

        blurred = gaussian_filter(colours.astype(np.float32), spec.blur_px, axes=(0, 1), truncate=3.0)
        colours[:] = np.rint(blurred).astype(np.uint8)
    if spec.noise_stddev > 0.0:
        rng = sensor_generator(seed, spec.name, step)
        noise = rng.standard_normal(colours.shape, np.float32) * np.float32(spec.noise_stddev)
        colours[:] = np.clip(np.rint(colours + noise), 0, 255).astype(np.uint8)
    encode = partial(simplejpeg.encode_jpeg, colorspace="RGBX", colorsubsampling="420", fastdct=True)
    encoded = encoder.submit(encode, image.rgba, spec.jpeg_quality)
    return CameraFrame(spec.name, step, spec.intrinsics, image, encoded)
