"""A renderer without OpenGL: it casts one ray per pixel, with plain light and no shadows.

For machines without EGL. Slower by an order of magnitude; geometry, labels and colours of surfaces are the same.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Floats32, Matrix
from siren_ros.sensing.camera.renderer import RenderedImage
from siren_ros.sensing.camera.surface_light import ambient_light
from siren_ros.sensing.lidar.embree import RaycastWorld, tiles
from siren_ros.sensing.look import Look
from siren_ros.sensing.meshes.mesh import (
    SEMANTIC_CLASS_OF_MATERIAL,
    Material,
    SemanticClass,
    StaticScene,
    VehicleShape,
    semantic_class_of_actor,
)
from siren_ros.sensing.meshes.placement import VehiclePlacement
from siren_ros.sensing.specification import inverse, map_from_base, optical_from_map
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.measurements import CameraIntrinsics

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
        centre = np.array([placement.x_m[row], placement.y_m[row], placement.z_m[row] + placement.size_m[row, 2] / 2])
        direction = rays[:, 3:].astype(np.float64)
        square = np.einsum("ij,ij->i", direction, direction)
        towards = centre - rays[0, :3]
        along = direction @ towards / square
        gap = np.einsum("i,i->", towards, towards) - along**2 * square
        radius = float(np.linalg.norm(placement.size_m[row])) / 2.0
        chosen = np.flatnonzero((gap < radius**2) & (along * np.sqrt(square) > -radius))
        if len(chosen) == 0:
            return
        pose = map_from_base(placement.x_m[row], placement.y_m[row], placement.z_m[row], float(placement.yaw_rad[row]))
        base_from_map = inverse(pose)
        shape = int(self._world.shape_rows(placement.actor_class[row : row + 1])[0])
        scale = placement.scale[row]
        local = np.empty((len(chosen), 6), np.float32)
        origin = base_from_map[:3, :3] @ rays[0, :3] + base_from_map[:3, 3]
        local[:, :3] = origin / scale + self._world.shape_offset_m[shape]
        local[:, 3:] = (direction[chosen] @ base_from_map[:3, :3].T) / scale
        hits_on_shapes = self._world.cast_shapes(local)
        nearer = hits_on_shapes.distance < depth[chosen]
        pixels = chosen[nearer]
        triangle = hits_on_shapes.triangle[nearer].astype(np.int64) + self._world.shape_start[shape]
        albedo, glow, normal = surface
        semantic, actor = names
        depth[pixels] = hits_on_shapes.distance[nearer]
        paint = np.isin(self._world.shape_material[triangle], _PAINTED)[:, None]
        colour = (self._world.shape_colour_rgb[triangle] / 255.0) ** 2
        albedo[pixels] = np.where(paint, colour * (placement.colour_rgb[row] / 255.0) ** 2, colour)
        glow[pixels] = 0.0
        tilted = hits_on_shapes.normal[nearer] / scale
        normal[pixels] = (tilted / np.linalg.norm(tilted, axis=1, keepdims=True)) @ pose[:3, :3].T
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
