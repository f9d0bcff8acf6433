"""Draws falling rain drops as streaks over the picture. Labels and depth do not show them."""

from typing import Any, Final

import moderngl
import numpy as np

from siren_ros.base.numerics.units import STEP_S
from siren_ros.sensing.camera.shaders import HEAD, LIGHT_PLACE, included
from siren_ros.sensing.camera.surface_light import defined, preamble
from siren_ros.sensing.look import Look

_SIDE_M: Final = (11.0, 11.0, 7.0)
"""Size of the box of drops around the camera; the pattern repeats with this period."""
_VELOCITY_MPS: Final = (1.1, 0.6, -7.0)
"""Velocity of the drops: a drop of 2 mm falls at 6.5 m/s (Gunn and Kinzer 1949, table 2); a light breeze moves it
sideways."""
_EXPOSURE_S: Final = 1.0 / 50.0
_DROPS_AT_1_MM_PER_H: Final = 600.0
_GROWTH: Final = 0.63
"""Exponent of the number of visible drops over the rain rate: N = N₀ / Λ, Λ ∝ R^−0.21, and larger drops are easier to
see (Marshall and Palmer 1948, with their liquid water R^0.84)."""
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
_FRAGMENT: Final = included("""#include HEAD LIT
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
""")


class Rain:
    """Draws the drops of a look."""

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
        """Draw the drops into a framebuffer that holds a finished picture and its depth; alpha does not change."""
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
