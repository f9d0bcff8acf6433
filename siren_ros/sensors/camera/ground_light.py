"""Sunlight on the ground as one texture: the baked shade of the static scene, and the vehicles' shadows."""

from dataclasses import dataclass, field
from typing import Any, Final

import moderngl
import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Matrix
from siren_ros.sensors.camera.static_geometry import StaticGeometry
from siren_ros.sensors.camera.surface_light import LIGHT_GRID_M, LIGHT_HALF_M, LIGHT_TEXELS
from siren_ros.sensors.camera.vehicle_geometry import Casters, VehicleGeometry
from siren_ros.sensors.meshes.placement import Placement

_UNIT_FROM_CLIP: Final = np.array(
    [[0.5, 0.0, 0.0, 0.5], [0.0, 0.5, 0.0, 0.5], [0.0, 0.0, 0.5, 0.5], [0.0, 0.0, 0.0, 1.0]]
)


@dataclass(frozen=True)
class ShadowView:
    """The space that a shadow map covers."""

    clip_from_map: Matrix
    """Shape ``(4, 4)``."""

    @property
    def unit_from_map(self) -> Matrix:
        """Texture coordinates and depth, each 0–1, of points in the ``map`` frame, shape ``(4, 4)``."""
        return _UNIT_FROM_CLIP @ self.clip_from_map


def sun_view(
    towards_sun: npt.NDArray[np.float64], centre_m: tuple[float, float], half_m: float, heights_m: tuple[float, float]
) -> ShadowView:
    """Parallel projection along the sun's rays that covers a square of the ground and everything that shades it."""
    up = np.array([0.0, 0.0, 1.0]) if abs(towards_sun[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, towards_sun)
    right /= np.linalg.norm(right)
    rotation = np.stack((right, np.cross(towards_sun, right), -towards_sun))
    low, high = heights_m
    corners = np.array(
        [(centre_m[0] + sx * half_m, centre_m[1] + sy * half_m, z) for sx in (-1, 1) for sy in (-1, 1) for z in (low,)]
    )
    seen = corners @ rotation.T
    centre = (seen.min(axis=0) + seen.max(axis=0)) / 2.0
    extent = (seen.max(axis=0) - seen.min(axis=0)) / 2.0
    margin = (high - low) / max(float(towards_sun[2]), 0.1)
    depth = extent[2] + margin + 1.0
    clip = np.eye(4)
    for axis, reach in ((0, extent[0]), (1, extent[1]), (2, depth)):
        clip[axis, :3] = rotation[axis] / reach
        clip[axis, 3] = -centre[axis] / reach
    return ShadowView(clip)


class ShadowMap:
    """A square depth texture that shaders compare against."""

    def __init__(self, context: moderngl.Context, size: int) -> None:
        """Allocate ``size`` × ``size`` texels."""
        self.texture = context.depth_texture((size, size))
        self.texture.compare_func = "<="
        self.texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.texture.repeat_x = self.texture.repeat_y = False
        self._framebuffer = context.framebuffer(depth_attachment=self.texture)
        self._context = context

    def begin(self, program: Any, view: ShadowView) -> None:
        """Clear the map and aim a shadow program (uniform ``clip_from_map``) at it."""
        self._framebuffer.use()
        self._framebuffer.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.polygon_offset = 1.5, 2.0
        program["clip_from_map"].write(np.ascontiguousarray(view.clip_from_map.T, dtype=np.float32).tobytes())

    def end(self) -> None:
        """Leave the shadow pass. The outermost texels say "lit"; lookups beyond the map return them."""
        size = self.texture.width
        for border in ((0, 0, size, 1), (0, size - 1, size, 1), (0, 0, 1, size), (size - 1, 0, 1, size)):
            self._framebuffer.clear(depth=1.0, viewport=border)
        self._context.polygon_offset = 0.0, 0.0


_RECEIVER_M: Final = 0.07
"""Height at which the ground's shade is taken, between carriageway and sidewalk."""
_KEPT: Final = 2
"""Number of squares kept: cameras of one carrier may lie on both sides of a border."""

_BAKE_VERTEX: Final = """#version 330 core
uniform mat4 unit_from_map;
uniform vec3 centre;  // z: height
uniform float half_m;
out vec3 v_shadow;
void main() {
    vec2 clip = vec2((gl_VertexID & 1) * 4 - 1, (gl_VertexID >> 1) * 4 - 1);
    gl_Position = vec4(clip, 0.0, 1.0);
    v_shadow = (unit_from_map * vec4(centre.xy + clip * half_m, centre.z, 1.0)).xyz;
}
"""
_BAKE_FRAGMENT: Final = """#version 330 core
uniform sampler2DShadow static_shadow;
in vec3 v_shadow;
out vec4 lit;
void main() { lit = vec4(texture(static_shadow, v_shadow)); }
"""


@dataclass(frozen=True)
class LightMap:
    """Textures and transforms with which a picture looks up the light."""

    unit_from_map: npt.NDArray[np.float64]
    """Texture coordinates and depth in the sun's shadow map, shape ``(4, 4)``."""
    light_from_map: tuple[float, float, float]
    """Scale and offset that take map coordinates to coordinates of the ground's light."""
    shadow: Any
    """Depth texture of the static scene seen from the sun; None at night."""
    ground: Any
    """Texture of the light that falls on the ground."""


def cell_of(eye_m: npt.NDArray[np.float64]) -> tuple[int, int]:
    """Grid point of the square that gives the light of a picture from a place."""
    return round(float(eye_m[0]) / LIGHT_GRID_M), round(float(eye_m[1]) / LIGHT_GRID_M)


def light_from_map(centre_m: tuple[float, float]) -> tuple[float, float, float]:
    """Scale and offset that take map coordinates to texture coordinates of the square around a point."""
    scale = 0.5 / LIGHT_HALF_M
    return scale, 0.5 - scale * centre_m[0], 0.5 - scale * centre_m[1]


@dataclass(eq=False)
class _Square:
    """Shade around one grid point: of the static scene, and with the shadows of the vehicles last placed."""

    centre_m: tuple[float, float]
    view: ShadowView
    shadow: ShadowMap
    baked: Any
    light: Any
    """Framebuffers, one byte per texel."""
    placement: Placement | None = None
    thrown: Casters = field(default_factory=tuple)


class GroundLight:
    """Light on the ground around the cameras by day. It depends on place and vehicles, not on earlier pictures."""

    def __init__(self, context: moderngl.Context, static: StaticGeometry, towards_sun: npt.NDArray[np.float64]) -> None:
        """Compile the programs; the sun stays where it is."""
        self._context = context
        self._static = static
        self._sun = towards_sun
        self._caster = static.shadow_array()
        self._bake: Any = context.program(vertex_shader=_BAKE_VERTEX, fragment_shader=_BAKE_FRAGMENT)
        _set(self._bake, "static_shadow", 0)
        self._triangle = context.vertex_array(self._bake, ())
        self._squares: dict[tuple[int, int], _Square] = {}

    def update(
        self,
        eye_m: npt.NDArray[np.float64],
        placement: Placement,
        vehicles: VehicleGeometry,
        step: int,  # noqa: ARG002 - the interface of all lights; the sun does not flash
    ) -> LightMap:
        """Set the light for a picture from a place; pictures of the same vehicles share it."""
        cell = cell_of(eye_m)
        square = self._squares.pop(cell, None) or self._square(cell)
        self._squares[cell] = square
        if square.placement is not placement:
            self._throw_shadows(square, placement, vehicles)
        return LightMap(
            square.view.unit_from_map,
            light_from_map(square.centre_m),
            square.shadow.texture,
            square.light.color_attachments[0],
        )

    def _framebuffer(self) -> Any:
        texture = self._context.texture((LIGHT_TEXELS, LIGHT_TEXELS), 1)
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return self._context.framebuffer([texture])

    def _square(self, cell: tuple[int, int]) -> _Square:
        """Draw the sun's view of the static scene and bake the ground's shade."""
        if len(self._squares) >= _KEPT:
            oldest = self._squares.pop(next(iter(self._squares)))
            shadow, baked, light = oldest.shadow, oldest.baked, oldest.light
        else:
            shadow = ShadowMap(self._context, LIGHT_TEXELS)
            baked, light = self._framebuffer(), self._framebuffer()
        centre = (cell[0] * LIGHT_GRID_M, cell[1] * LIGHT_GRID_M)
        heights = self._static.heights_m
        view = sun_view(self._sun, centre, LIGHT_HALF_M, heights)
        reach = LIGHT_HALF_M + (heights[1] - heights[0]) / max(float(self._sun[2]), 0.1)
        shadow.begin(self._static.shadow_program, view)
        self._static.draw_shadow(self._caster, np.array(centre) - reach, np.array(centre) + reach)
        shadow.end()
        baked.use()
        baked.clear(1.0)
        baked.scissor = (1, 1, LIGHT_TEXELS - 2, LIGHT_TEXELS - 2)
        self._context.enable_only(moderngl.NOTHING)
        self._bake["unit_from_map"].write(np.ascontiguousarray(view.unit_from_map.T, dtype=np.float32).tobytes())
        _set(self._bake, "centre", (*centre, _RECEIVER_M))
        _set(self._bake, "half_m", LIGHT_HALF_M)
        shadow.texture.use(0)
        self._triangle.render(moderngl.TRIANGLES, vertices=3)
        baked.scissor = None
        light.scissor = None
        self._context.copy_framebuffer(light, baked)
        return _Square(centre, view, shadow, baked, light)

    def _throw_shadows(self, square: _Square, placement: Placement, vehicles: VehicleGeometry) -> None:
        """Draw the vehicles' hulls onto the ground along the sun's rays, after removing the hulls drawn before.

        The same hull covers the same texels, so that drawing it with the baked shade leaves nothing of its shadow.
        """
        square.light.scissor = (1, 1, LIGHT_TEXELS - 2, LIGHT_TEXELS - 2)
        square.light.use()
        self._context.enable_only(moderngl.CULL_FACE)
        square.baked.color_attachments[0].use(0)
        x, y = square.centre_m
        program = vehicles.shadow_program
        _set(program, "baked", 0)
        _set(program, "light_from_map", (1.0 / LIGHT_HALF_M, -x / LIGHT_HALF_M, -y / LIGHT_HALF_M, 0.0))
        sx, sy, sz = (float(value) for value in self._sun)
        _set(program, "per_metre_up", (sx / max(sz, 0.05), sy / max(sz, 0.05)))
        _set(program, "kept", 1.0)
        vehicles.draw_shadows(square.thrown)
        square.thrown = vehicles.casters(placement.distance_m(x, y) < 1.5 * LIGHT_HALF_M)
        _set(program, "kept", 0.0)
        vehicles.draw_shadows(square.thrown)
        square.placement = placement


def _set(program: Any, name: str, value: float | tuple[float, ...]) -> None:
    program[name].value = value
