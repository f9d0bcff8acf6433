"""The light on the ground as one texture: shadows of scene and vehicles by day, the light of lamps at night."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, Final

import moderngl
import numpy as np

from siren_ros.base.numerics.arrays import Floats, Matrix
from siren_ros.base.numerics.units import STEP_S
from siren_ros.sensing.camera.shaders import included
from siren_ros.sensing.camera.static_geometry import StaticGeometry
from siren_ros.sensing.camera.surface_light import LIGHT_GRID_M, LIGHT_HALF_M, LIGHT_TEXELS
from siren_ros.sensing.camera.vehicle_geometry import Casters, VehicleGeometry
from siren_ros.sensing.meshes.mesh import Material, Mesh, VehiclePlacement
from siren_ros.simulation.world.actors import Lights

UNIT_FROM_CLIP: Final = np.array(
    [[0.5, 0.0, 0.0, 0.5], [0.0, 0.5, 0.0, 0.5], [0.0, 0.0, 0.5, 0.5], [0.0, 0.0, 0.0, 1.0]]
)
"""Converts clip coordinates to texture coordinates and depth, each from 0 to 1."""


def sun_view(
    towards_sun: Floats, centre_m: tuple[float, float], half_m: float, heights_m: tuple[float, float]
) -> Matrix:
    """Matrix ``clip_from_map`` of the sun's view: it covers a square of the ground and everything that can shade it."""
    up = np.array([0.0, 0.0, 1.0]) if abs(towards_sun[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, towards_sun)
    right /= np.linalg.norm(right)
    rotation = np.stack((right, np.cross(towards_sun, right), -towards_sun))
    low, high = heights_m
    corners = np.array(
        [(centre_m[0] + sx * half_m, centre_m[1] + sy * half_m, low) for sx in (-1, 1) for sy in (-1, 1)]
    )
    seen = corners @ rotation.T
    centre = (seen.min(axis=0) + seen.max(axis=0)) / 2.0
    extent = (seen.max(axis=0) - seen.min(axis=0)) / 2.0
    depth = extent[2] + (high - low) / max(float(towards_sun[2]), 0.1) + 1.0
    clip = np.eye(4)
    for axis, reach in ((0, extent[0]), (1, extent[1]), (2, depth)):
        clip[axis, :3] = rotation[axis] / reach
        clip[axis, 3] = -centre[axis] / reach
    return clip


class ShadowMap:
    """A square depth texture, drawn from the sun; shaders compare against it to find shadows."""

    def __init__(self, context: moderngl.Context, size: int) -> None:
        """Allocate ``size`` × ``size`` texels."""
        self.texture = context.depth_texture((size, size))
        self.texture.compare_func = "<="
        self.texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.texture.repeat_x = self.texture.repeat_y = False
        self._framebuffer = context.framebuffer(depth_attachment=self.texture)
        self._context = context

    def begin(self, program: Any, clip_from_map: Matrix) -> None:
        """Clear the map and aim a shadow program (uniform ``clip_from_map``) at it."""
        self._framebuffer.use()
        self._framebuffer.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.polygon_offset = 1.5, 2.0
        program["clip_from_map"].write(np.ascontiguousarray(clip_from_map.T, dtype=np.float32).tobytes())

    def end(self) -> None:
        """End the shadow pass. The outermost texels are set to "lit", because lookups beyond the map return them."""
        size = self.texture.width
        for border in ((0, 0, size, 1), (0, size - 1, size, 1), (0, 0, 1, size), (size - 1, 0, 1, size)):
            self._framebuffer.clear(depth=1.0, viewport=border)
        self._context.polygon_offset = 0.0, 0.0


_KEPT: Final = 2
"""Number of squares kept: cameras of one carrier may lie on both sides of a border."""


@dataclass(frozen=True)
class LightMap:
    """Textures and transforms with which a picture looks up the light."""

    unit_from_map: Floats
    """Texture coordinates and depth in the sun's shadow map, shape ``(4, 4)``."""
    light_from_map: tuple[float, float, float]
    """Scale and offset that take map coordinates to coordinates of the ground's light."""
    shadow: Any
    """Depth texture of the static scene seen from the sun; None at night."""
    ground: Any
    """Texture of the light that falls on the ground."""


def cell_of(eye_m: Floats) -> tuple[int, int]:
    """Grid point at the centre of the light square that a picture from this place uses."""
    return round(float(eye_m[0]) / LIGHT_GRID_M), round(float(eye_m[1]) / LIGHT_GRID_M)


def light_from_map(centre_m: tuple[float, float]) -> tuple[float, float, float]:
    """Scale and offset that convert map coordinates to texture coordinates of the square around a point."""
    scale = 0.5 / LIGHT_HALF_M
    return scale, 0.5 - scale * centre_m[0], 0.5 - scale * centre_m[1]


@dataclass(eq=False)
class _Square:
    """Light around one grid point: once for static objects alone, once with the vehicles drawn last."""

    centre_m: tuple[float, float]
    baked: Any
    light: Any
    """Framebuffers that hold the light."""
    shadow: ShadowMap | None = None
    unit_from_map: Matrix = field(default_factory=lambda: np.eye(4))
    drawn: tuple[VehiclePlacement, int] | None = None
    """The vehicles drawn last, and the step at which they were drawn."""
    thrown: Casters = ()


class SquareLight(ABC):
    """Squares of ground light around the cameras.

    A square depends on its place and the vehicles, not on earlier pictures.
    """

    _texels: int
    _components: int

    def __init__(self, context: moderngl.Context) -> None:
        """Start without squares."""
        self._context = context
        self._squares: dict[tuple[int, int], _Square] = {}

    @abstractmethod
    def _bake(self, square: _Square) -> None:
        """Draw the light of everything static."""

    @abstractmethod
    def _draw(self, square: _Square, placement: VehiclePlacement, vehicles: VehicleGeometry, step: int) -> None:
        """Draw the light again with the vehicles."""

    def update(self, eye_m: Floats, placement: VehiclePlacement, vehicles: VehicleGeometry, step: int) -> LightMap:
        """Update the light for a picture from a place; pictures of the same vehicles share it."""
        cell = cell_of(eye_m)
        square = self._squares.pop(cell, None)
        if square is None:
            centre = (cell[0] * LIGHT_GRID_M, cell[1] * LIGHT_GRID_M)
            if len(self._squares) >= _KEPT:
                oldest = self._squares.pop(next(iter(self._squares)))
                square = _Square(centre, oldest.baked, oldest.light, oldest.shadow)
            else:
                square = _Square(centre, self._framebuffer(), self._framebuffer())
            self._bake(square)
        self._squares[cell] = square
        if square.drawn is None or square.drawn[0] is not placement or square.drawn[1] != step:
            self._draw(square, placement, vehicles, step)
            square.drawn = (placement, step)
        shadow = None if square.shadow is None else square.shadow.texture
        ground = square.light.color_attachments[0]
        return LightMap(square.unit_from_map, light_from_map(square.centre_m), shadow, ground)

    def _framebuffer(self) -> Any:
        texture = self._context.texture((self._texels, self._texels), self._components)
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return self._context.framebuffer([texture])


_RECEIVER_M: Final = 0.07
"""Height above the ground at which shadows are computed, between carriageway and sidewalk."""
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


class GroundLight(SquareLight):
    """Sunlight on the ground: one byte per texel."""

    _texels, _components = LIGHT_TEXELS, 1

    def __init__(self, context: moderngl.Context, static: StaticGeometry, towards_sun: Floats) -> None:
        """Compile the programs; the sun does not move during an episode."""
        super().__init__(context)
        self._static = static
        self._sun = towards_sun
        self._caster = static.shadow_array()
        self._program: Any = context.program(vertex_shader=_BAKE_VERTEX, fragment_shader=_BAKE_FRAGMENT)
        self._triangle = context.vertex_array(self._program, ())

    def _bake(self, square: _Square) -> None:
        """Draw the sun's view of the static scene and bake the ground's shade."""
        centre, baked, light = square.centre_m, square.baked, square.light
        shadow = square.shadow = square.shadow or ShadowMap(self._context, LIGHT_TEXELS)
        heights = self._static.heights_m
        clip_from_map = sun_view(self._sun, centre, LIGHT_HALF_M, heights)
        square.unit_from_map = UNIT_FROM_CLIP @ clip_from_map
        reach = LIGHT_HALF_M + (heights[1] - heights[0]) / max(float(self._sun[2]), 0.1)
        shadow.begin(self._static.shadow_program, clip_from_map)
        self._static.draw_shadow(self._caster, np.array(centre) - reach, np.array(centre) + reach)
        shadow.end()
        baked.use()
        baked.clear(1.0)
        baked.scissor = (1, 1, LIGHT_TEXELS - 2, LIGHT_TEXELS - 2)
        self._context.enable_only(moderngl.NOTHING)
        self._program["unit_from_map"].write(np.ascontiguousarray(square.unit_from_map.T, dtype=np.float32).tobytes())
        self._program["static_shadow"].value = 0
        self._program["centre"].value = (*centre, _RECEIVER_M)
        self._program["half_m"].value = LIGHT_HALF_M
        shadow.texture.use(0)
        self._triangle.render(moderngl.TRIANGLES, vertices=3)
        baked.scissor = None
        light.scissor = None
        self._context.copy_framebuffer(light, baked)

    def _draw(self, square: _Square, placement: VehiclePlacement, vehicles: VehicleGeometry, step: int) -> None:  # noqa: ARG002
        """Draw the vehicles' hulls onto the ground along the sun's rays.

        Hulls drawn before are drawn again with the baked shade: they cover the same texels, and nothing of them stays.
        """
        square.light.scissor = (1, 1, LIGHT_TEXELS - 2, LIGHT_TEXELS - 2)
        square.light.use()
        self._context.enable_only(moderngl.CULL_FACE)
        square.baked.color_attachments[0].use(0)
        x, y = square.centre_m
        program = vehicles.shadow_program
        program["baked"].value = 0
        program["light_from_map"].value = (1.0 / LIGHT_HALF_M, -x / LIGHT_HALF_M, -y / LIGHT_HALF_M, 0.0)
        sx, sy, sz = (float(value) for value in self._sun)
        program["per_metre_up"].value = (sx / max(sz, 0.05), sy / max(sz, 0.05))
        program["kept"].value = 1.0
        vehicles.draw_shadows(square.thrown)
        square.thrown = vehicles.casters(placement.distance_m(x, y) < 1.5 * LIGHT_HALF_M)
        program["kept"].value = 0.0
        vehicles.draw_shadows(square.thrown)


_TEXELS: Final = 512
"""Texels on each side of the square. Lamp light has no sharp edges, so texels of half a metre are enough."""
_LAMP_SIZE_M: Final = 1.5
"""Triangles that are closer than this belong to the same luminaire."""
_VEHICLE: Final = np.dtype([("pose", "<f4", 4), ("length_beacon", "<f4", 2)])
_ROOM: Final = 512

_LAMP_VERTEX: Final = included("""#include SQUARE
const float REACH = 24.0;  // metres
in vec3 in_lamp;
out vec2 v_beside;
flat out float v_height;
void main() {
    v_beside = (corner() * 2.0 - 1.0) * REACH;
    v_height = in_lamp.z;
    gl_Position = vec4((in_lamp.xy + v_beside) * light_from_map.x + light_from_map.yz, 0.0, 1.0);
}
""")
_LAMP_FRAGMENT: Final = """#version 330 core
in vec2 v_beside;
flat in float v_height;
out vec4 light;
void main() {  // evenly spread by its mirrors, as street lamps are: the share of the inverse square without the cosine
    float square = v_height * v_height;
    float share = square / (square + dot(v_beside, v_beside));
    light = vec4(vec3(0.90, 0.69, 0.41) * max(share - 0.1, 0.0), 0.0);
}
"""
_VEHICLE_VERTEX: Final = included("""#include SQUARE
in vec4 in_pose;  // x, y, cosine and sine of the heading
in vec2 in_length_beacon;
out vec2 v_place;
flat out vec2 v_length_beacon;
void main() {
    vec2 low = vec2(-0.5 * in_length_beacon.x - 10.0, -11.0), high = vec2(0.5 * in_length_beacon.x + 42.0, 11.0);
    v_place = mix(low, high, corner());
    v_length_beacon = in_length_beacon;
    vec2 p = in_pose.xy + v_place.x * in_pose.zw + v_place.y * vec2(-in_pose.w, in_pose.z);
    gl_Position = vec4(p * light_from_map.x + light_from_map.yz, 0.0, 1.0);
}
""")
_VEHICLE_FRAGMENT: Final = """#version 330 core
uniform vec3 beacon;
in vec2 v_place;
flat in vec2 v_length_beacon;
out vec4 light;
void main() {
    float half_length = 0.5 * v_length_beacon.x;
    float ahead = v_place.x - half_length;
    float spread = v_place.y / (0.26 * max(ahead, 0.0) + 1.1);
    float beam = ahead / (ahead + 1.5) * exp2(-1.6 * spread * spread) / (1.0 + ahead * ahead / 260.0);
    vec3 c = ahead > 0.0 ? vec3(1.1, 1.06, 0.95) * beam * clamp((42.0 - ahead) / 10.0, 0.0, 1.0) : vec3(0.0);
    float behind = -half_length - v_place.x;
    if (behind > 0.0) c += vec3(0.12, 0.008, 0.006) * exp2(-0.35 * (behind * behind + v_place.y * v_place.y));
    c += v_length_beacon.y * beacon * max(exp2(-0.03 * dot(v_place, v_place)) - 0.09, 0.0);
    light = vec4(c, 0.0);
}
"""


def luminaires(mesh: Mesh) -> Floats:
    """Middle of each street lamp's luminaire, shape ``(L, 3)``."""
    rows = np.flatnonzero(mesh.material == Material.STREET_LAMP)
    centre = mesh.vertices_m[mesh.triangles[rows]].astype(np.float64).mean(axis=1)
    if len(centre) == 0:
        return np.empty((0, 3))
    apart = np.linalg.norm(np.diff(centre, axis=0), axis=1) > _LAMP_SIZE_M
    starts = np.concatenate(([0], np.flatnonzero(apart) + 1))
    count = np.diff(np.append(starts, len(centre)))
    return np.asarray(np.add.reduceat(centre, starts, axis=0) / count[:, None])


def beacon_colour(step: int) -> tuple[float, float, float]:
    """Colour of the light that flashing beacons cast on the ground at a step; it flashes with the lamps of vehicles."""
    strobe = step * STEP_S * 2.0 % 1.0
    if strobe * 6.0 % 1.0 >= 0.62:
        return 0.0, 0.0, 0.0
    return (0.03, 0.12, 0.9) if strobe < 0.5 else (0.9, 0.04, 0.03)


class LampLight(SquareLight):
    """The light that lamps cast on the ground at night."""

    _texels, _components = _TEXELS, 4

    def __init__(self, context: moderngl.Context, mesh: Mesh) -> None:
        """Find the street lamps and compile the programs."""
        super().__init__(context)
        lamps = luminaires(mesh).astype("<f4")
        self._lamp_count = len(lamps)
        self._lamp_program: Any = context.program(vertex_shader=_LAMP_VERTEX, fragment_shader=_LAMP_FRAGMENT)
        buffer = context.buffer(lamps.tobytes() or bytes(12))
        self._lamps = context.vertex_array(self._lamp_program, ((buffer, "3f/i", "in_lamp"),))
        self._program: Any = context.program(vertex_shader=_VEHICLE_VERTEX, fragment_shader=_VEHICLE_FRAGMENT)
        self._buffer = context.buffer(reserve=_ROOM * _VEHICLE.itemsize, dynamic=True)
        content = (self._buffer, "4f 2f/i", "in_pose", "in_length_beacon")
        self._vehicles = context.vertex_array(self._program, (content,))

    def _bake(self, square: _Square) -> None:
        square.baked.use()
        square.baked.clear()
        if self._lamp_count:
            self._add_up(self._lamp_program, square.centre_m)
            self._lamps.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=self._lamp_count)

    def _draw(self, square: _Square, placement: VehiclePlacement, vehicles: VehicleGeometry, step: int) -> None:  # noqa: ARG002
        """Add the light of the vehicles' lamps, including those of the vehicle with the sensors."""
        self._context.copy_framebuffer(square.light, square.baked)
        near = placement.distance_m(*square.centre_m) < 1.5 * LIGHT_HALF_M
        lit = np.zeros(int(np.count_nonzero(near)) + 1, _VEHICLE)
        yaw = placement.yaw_rad[near]
        lit["pose"][:-1] = np.stack((placement.x_m[near], placement.y_m[near], np.cos(yaw), np.sin(yaw)), axis=1)
        lit["length_beacon"][:-1, 0] = placement.size_m[near, 0]
        lit["length_beacon"][:-1, 1] = (placement.lights[near] & int(Lights.BEACON)) != 0
        if ego := placement.ego:
            lit["pose"][-1] = (ego.x_m, ego.y_m, np.cos(ego.yaw_rad), np.sin(ego.yaw_rad))
            lit["length_beacon"][-1] = (ego.length_m, bool(ego.lights & int(Lights.BEACON)))
        lit = lit[: _ROOM if ego else min(len(lit) - 1, _ROOM)]
        if len(lit) == 0:
            return
        self._buffer.orphan()
        self._buffer.write(lit.tobytes())
        square.light.use()
        self._add_up(self._program, square.centre_m)
        self._program["beacon"].value = beacon_colour(step)
        self._vehicles.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(lit))
        self._context.enable_only(moderngl.NOTHING)

    def _add_up(self, program: Any, centre_m: tuple[float, float]) -> None:
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE
        x, y = centre_m
        program["light_from_map"].value = (1.0 / LIGHT_HALF_M, -x / LIGHT_HALF_M, -y / LIGHT_HALF_M, 0.0)
