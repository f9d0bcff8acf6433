"""Light on the ground at night as one texture (street lamps, head lamps, tail lamps and beacons), and falling drops.

Drops are streaks around the camera, drawn over the picture. Labels and depth ignore them.
"""

from dataclasses import dataclass
from typing import Any, Final

import moderngl
import numpy as np
import numpy.typing as npt

from siren_ros.numerics.units import STEP_S
from siren_ros.sensors.camera.ground_light import LightMap, cell_of, light_from_map
from siren_ros.sensors.camera.shaders import HEAD, LIGHT_PLACE, LIT
from siren_ros.sensors.camera.surface_light import LIGHT_GRID_M, LIGHT_HALF_M, defined, preamble
from siren_ros.sensors.camera.vehicle_geometry import VehicleGeometry
from siren_ros.sensors.look import Look
from siren_ros.sensors.meshes.mesh import Material, Mesh
from siren_ros.sensors.meshes.placement import Placement
from siren_ros.world.actors import Lights

_TEXELS: Final = 512
"""Light of lamps has no edges, so that texels of half a metre do."""
_KEPT: Final = 2
_LAMP_REACH_M: Final = 24.0
_LAMP_SIZE_M: Final = 1.5
"""Triangles of one luminaire lie closer together than this."""
_VEHICLE: Final = np.dtype([("pose", "<f4", 4), ("length_beacon", "<f4", 2)])
_ROOM: Final = 512

_HEAD: Final = """#version 330 core
uniform vec4 light_from_map;  // scale, offset x, offset y, in clip coordinates of the light map
vec2 corner() { return vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1)); }
"""
_LAMP_VERTEX: Final = (
    _HEAD
    + f"const float REACH = {_LAMP_REACH_M};\n"
    + """
in vec3 in_lamp;
out vec2 v_beside;
flat out float v_height;
void main() {
    v_beside = (corner() * 2.0 - 1.0) * REACH;
    v_height = in_lamp.z;
    gl_Position = vec4((in_lamp.xy + v_beside) * light_from_map.x + light_from_map.yz, 0.0, 1.0);
}
"""
)
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
_VEHICLE_VERTEX: Final = (
    _HEAD
    + """
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
"""
)
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


@dataclass(eq=False)
class _Square:
    """Light around one grid point: of the street lamps, and with that of the vehicles last placed."""

    centre_m: tuple[float, float]
    baked: Any
    light: Any
    drawn: tuple[Placement, int] | None = None


def luminaires(mesh: Mesh) -> npt.NDArray[np.float64]:
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
    """Light that flashing beacons throw at a step, in time with the lamps themselves (``vehicle_geometry``)."""
    strobe = step * STEP_S * 2.0 % 1.0
    if strobe * 6.0 % 1.0 >= 0.62:
        return 0.0, 0.0, 0.0
    return (0.03, 0.12, 0.9) if strobe < 0.5 else (0.9, 0.04, 0.03)


class LampLight:
    """Light on the ground around the cameras at night; the interface of ``GroundLight``."""

    def __init__(self, context: moderngl.Context, mesh: Mesh) -> None:
        """Find the street lamps and compile the programs."""
        self._context = context
        lamps = luminaires(mesh).astype("<f4")
        self._lamp_count = len(lamps)
        self._lamp_program: Any = context.program(vertex_shader=_LAMP_VERTEX, fragment_shader=_LAMP_FRAGMENT)
        buffer = context.buffer(lamps.tobytes() or bytes(12))
        self._lamps = context.vertex_array(self._lamp_program, ((buffer, "3f/i", "in_lamp"),))
        self._program: Any = context.program(vertex_shader=_VEHICLE_VERTEX, fragment_shader=_VEHICLE_FRAGMENT)
        self._buffer = context.buffer(reserve=_ROOM * _VEHICLE.itemsize, dynamic=True)
        self._vehicles = context.vertex_array(
            self._program, ((self._buffer, "4f 2f/i", "in_pose", "in_length_beacon"),)
        )
        self._squares: dict[tuple[int, int], _Square] = {}

    def update(
        self,
        eye_m: npt.NDArray[np.float64],
        placement: Placement,
        vehicles: VehicleGeometry,  # noqa: ARG002 - the interface of all lights; lamps throw no shadows here
        step: int,
    ) -> LightMap:
        """Set the light for a picture from a place; pictures of the same vehicles share it."""
        cell = cell_of(eye_m)
        square = self._squares.pop(cell, None) or self._square(cell)
        self._squares[cell] = square
        if square.drawn is None or square.drawn[0] is not placement or square.drawn[1] != step:
            self._context.copy_framebuffer(square.light, square.baked)
            self._shine(square, placement, step)
            square.drawn = (placement, step)
        return LightMap(np.eye(4), light_from_map(square.centre_m), None, square.light.color_attachments[0])

    def _square(self, cell: tuple[int, int]) -> _Square:
        if len(self._squares) >= _KEPT:
            oldest = self._squares.pop(next(iter(self._squares)))
            baked, light = oldest.baked, oldest.light
        else:
            baked, light = self._framebuffer(), self._framebuffer()
        centre = (cell[0] * LIGHT_GRID_M, cell[1] * LIGHT_GRID_M)
        baked.use()
        baked.clear()
        if self._lamp_count:
            self._add_up(self._lamp_program, centre)
            self._lamps.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=self._lamp_count)
        return _Square(centre, baked, light)

    def _shine(self, square: _Square, placement: Placement, step: int) -> None:
        """Add the light of the vehicles, including the vehicle with the sensors."""
        near = placement.distance_m(*square.centre_m) < 1.5 * LIGHT_HALF_M
        lit = np.zeros(int(np.count_nonzero(near)) + 1, _VEHICLE)
        yaw = placement.yaw_rad[near]
        lit["pose"][:-1] = np.stack((placement.x_m[near], placement.y_m[near], np.cos(yaw), np.sin(yaw)), axis=1)
        lit["length_beacon"][:-1, 0] = placement.size_m[near, 0]
        lit["length_beacon"][:-1, 1] = (placement.lights[near] & int(Lights.BEACON)) != 0
        carrier = placement.ego
        if carrier is None:
            lit = lit[:-1]
        else:
            lit["pose"][-1] = (carrier.x_m, carrier.y_m, np.cos(carrier.yaw_rad), np.sin(carrier.yaw_rad))
            lit["length_beacon"][-1] = (carrier.length_m, bool(carrier.lights & int(Lights.BEACON)))
        lit = lit[:_ROOM]
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

    def _framebuffer(self) -> Any:
        texture = self._context.texture((_TEXELS, _TEXELS), 4)
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return self._context.framebuffer([texture])


_SIDE_M: Final = (11.0, 11.0, 7.0)
"""Drops repeat with this period; the box around the camera shows each once."""
_VELOCITY_MPS: Final = (1.1, 0.6, -7.0)
"""A drop of 2 mm falls at 6.5 m/s (Gunn and Kinzer 1949, table 2), in a light breeze."""
_EXPOSURE_S: Final = 1.0 / 50.0
_DROPS_AT_1_MM_PER_H: Final = 600.0
_GROWTH: Final = 0.63
"""Drops per volume grow with about this power of the rain rate: N = N₀ / Λ, Λ ∝ R^−0.21, and larger ones are seen more
easily (Marshall and Palmer 1948, with their liquid water R^0.84)."""
_MOST: Final = 6000

_VERTEX: Final = (
    HEAD
    + LIGHT_PLACE
    + f"const vec3 SIDE = vec3{_SIDE_M};\nconst vec3 STREAK = vec3{tuple(_EXPOSURE_S * v for v in _VELOCITY_MPS)};\n"
    + """
uniform vec3 fallen;
out vec3 v_lit;
out float v_alpha;
float random(uint n) {
    n = (n ^ 61u) ^ (n >> 16u); n *= 9u; n ^= n >> 4u; n *= 0x27d4eb2du; n ^= n >> 15u;
    return float(n >> 8u) / 16777216.0;
}
void main() {
    uint drop = uint(gl_VertexID) >> 1u;
    vec3 home = vec3(random(3u * drop), random(3u * drop + 1u), random(3u * drop + 2u)) * SIDE;
    vec3 place = eye.xyz + mod(home + fallen - eye.xyz, SIDE) - 0.5 * SIDE;
    float away = distance(place, eye.xyz);
    place -= STREAK * float(gl_VertexID & 1);
    gl_Position = clip_from_map * vec4(place, 1.0);
    v_lit = vec3(light_place(place.xy), place.z);
    v_alpha = clamp(0.75 / away, 0.0, 0.45) * clamp(away - 0.6, 0.0, 1.0) * (1.0 - 0.6 * float(gl_VertexID & 1));
}
"""
)
_FRAGMENT: Final = (
    HEAD
    + LIT
    + """
in vec3 v_lit;
in float v_alpha;
layout(location = 0) out vec4 out_colour;
void main() {
#ifdef NIGHT
    vec3 light = horizon_colour + 0.9 * lit_at(v_lit);
#else
    vec3 light = horizon_colour * 1.15;
#endif
    out_colour = vec4(sqrt(clamp(light * picture.z, 0.0, 1.0)), v_alpha);
}
"""
)


class Rain:
    """The drops of a look."""

    def __init__(self, context: moderngl.Context, look: Look) -> None:
        """Compile the program."""
        self._context = context
        constants = preamble(look)
        self.program: Any = context.program(
            vertex_shader=defined(_VERTEX, constants), fragment_shader=defined(_FRAGMENT, constants)
        )
        self._array = context.vertex_array(self.program, ())
        self._drops = min(_MOST, round(_DROPS_AT_1_MM_PER_H * look.rain_mm_per_h**_GROWTH))

    def draw(self, picture: Any, step: int) -> None:
        """Draw the drops into a framebuffer that holds a finished picture and its depth; alpha stays as it is."""
        context = self._context
        fallen = np.mod(step * STEP_S * np.array(_VELOCITY_MPS), _SIDE_M)
        self.program["fallen"].value = tuple(float(value) for value in fallen)
        picture.depth_mask = False
        picture.color_mask = True, True, True, False
        picture.use()
        context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._array.render(moderngl.LINES, vertices=2 * self._drops)
        picture.depth_mask = True
        picture.color_mask = True, True, True, True
        picture.use()
