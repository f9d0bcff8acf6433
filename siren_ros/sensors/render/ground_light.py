"""Where the ground lies in the sun, as one texture: baked shade of the static scene, with the vehicles' shadows."""

from dataclasses import dataclass
from typing import Any, Final

import moderngl
import numpy as np
import numpy.typing as npt

from siren_ros.sensors.placement import Placement
from siren_ros.sensors.render import vehicle_shaders
from siren_ros.sensors.render.shadows import ShadowMap, ShadowView, sun_view
from siren_ros.sensors.render.static_geometry import StaticGeometry
from siren_ros.sensors.render.vehicle_geometry import VehicleGeometry

TEXELS: Final = 2048
HALF_M: Final = 120.0
"""Half the side of the square that has shadows; beyond, everything lies in the sun."""
_GRID_M: Final = 40.0
_RECEIVER_M: Final = 0.07
"""Height at which the ground's shade is taken, between carriageway and sidewalk."""
_KEPT: Final = 2
"""Squares kept: cameras of one carrier may stand on both sides of a border."""

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


@dataclass(frozen=True, eq=False)
class _Square:
    """Shade of the static scene around one grid point."""

    centre_m: tuple[float, float]
    view: ShadowView
    shadow: ShadowMap
    baked: Any
    """Framebuffer over the baked shade, one byte per texel."""


class GroundLight:
    """Light on the ground around the cameras. A function of place and vehicles, whatever was drawn before."""

    def __init__(self, context: moderngl.Context, static: StaticGeometry, towards_sun: npt.NDArray[np.float64]) -> None:
        """Allocate the textures; the sun stays where it is."""
        self._context = context
        self._static = static
        self._sun = towards_sun
        self._caster = static.shadow_array()
        self._bake: Any = context.program(vertex_shader=_BAKE_VERTEX, fragment_shader=_BAKE_FRAGMENT)
        _set(self._bake, "static_shadow", 0)
        self._triangle = context.vertex_array(self._bake, ())
        self._program: Any = context.program(
            vertex_shader=vehicle_shaders.GROUND_SHADOW_VERTEX, fragment_shader=vehicle_shaders.GROUND_SHADOW_FRAGMENT
        )
        self._squares: dict[tuple[int, int], _Square] = {}
        self.texture = self._texture()
        self._framebuffer = context.framebuffer([self.texture])
        self._framebuffer.scissor = (1, 1, TEXELS - 2, TEXELS - 2)
        self._drawn: tuple[Placement, tuple[int, int]] | None = None

    @property
    def vehicle_program(self) -> Any:
        """Program that draws vehicles' hulls as shadows."""
        return self._program

    def update(self, eye_m: npt.NDArray[np.float64], placement: Placement, vehicles: VehicleGeometry) -> _Square:
        """Set the light for a picture from a place; pictures of the same vehicles share it."""
        cell = (round(eye_m[0] / _GRID_M), round(eye_m[1] / _GRID_M))
        square = self._squares.pop(cell, None) or self._square(cell)
        self._squares[cell] = square
        if self._drawn is None or self._drawn[0] is not placement or self._drawn[1] != cell:
            self._context.copy_framebuffer(self._framebuffer, square.baked)
            self._throw_shadows(square, placement, vehicles)
            self._drawn = (placement, cell)
        return square

    def light_from_map(self, square: _Square) -> tuple[float, float, float]:
        """Scale and offset that take map coordinates to texture coordinates."""
        scale = 0.5 / HALF_M
        return scale, 0.5 - scale * square.centre_m[0], 0.5 - scale * square.centre_m[1]

    def _texture(self) -> Any:
        texture = self._context.texture((TEXELS, TEXELS), 1)
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return texture

    def _square(self, cell: tuple[int, int]) -> _Square:
        """Draw the sun's view of the static scene and bake the ground's shade."""
        if len(self._squares) >= _KEPT:
            oldest = self._squares.pop(next(iter(self._squares)))
            shadow, baked = oldest.shadow, oldest.baked
        else:
            shadow = ShadowMap(self._context, TEXELS)
            baked = self._context.framebuffer([self._texture()])
        centre = (cell[0] * _GRID_M, cell[1] * _GRID_M)
        heights = self._static.heights_m
        view = sun_view(self._sun, centre, HALF_M, heights)
        reach = HALF_M + (heights[1] - heights[0]) / max(float(self._sun[2]), 0.1)
        shadow.begin(self._static.shadow_program, view)
        self._static.draw_shadow(self._caster, np.array(centre) - reach, np.array(centre) + reach)
        shadow.end()
        baked.use()
        baked.clear(1.0)
        baked.scissor = (1, 1, TEXELS - 2, TEXELS - 2)
        self._context.enable_only(moderngl.NOTHING)
        self._bake["unit_from_map"].write(np.ascontiguousarray(view.unit_from_map.T, dtype=np.float32).tobytes())
        _set(self._bake, "centre", (*centre, _RECEIVER_M))
        _set(self._bake, "half_m", HALF_M)
        shadow.texture.use(0)
        self._triangle.render(moderngl.TRIANGLES, vertices=3)
        baked.scissor = None
        return _Square(centre, view, shadow, baked)

    def _throw_shadows(self, square: _Square, placement: Placement, vehicles: VehicleGeometry) -> None:
        """Draw the vehicles' hulls onto the ground along the sun's rays."""
        near = placement.distance_m(*square.centre_m) < 1.5 * HALF_M
        if not np.any(near):
            return
        self._framebuffer.use()
        self._context.enable_only(moderngl.NOTHING)
        x, y = square.centre_m
        _set(self._program, "light_from_map", (1.0 / HALF_M, -x / HALF_M, -y / HALF_M, 0.0))
        sx, sy, sz = (float(value) for value in self._sun)
        _set(self._program, "per_metre_up", (sx / max(sz, 0.05), sy / max(sz, 0.05)))
        vehicles.draw_shadows(near)


def _set(program: Any, name: str, value: float | tuple[float, ...]) -> None:
    program[name].value = value
