"""GLSL of the static scene and of the sky, and what all programs share.

Light is computed in linear RGB and leaves as sRGB-like 8-bit colour (gamma 2). Every fragment writes colour with its
semantic class as alpha, and where the framebuffer has them the actor id and the depth along the optical
axis, all from the same draw. The sky is painted once as light, developed once per exposure, then looked up by
direction.

A software rasteriser's time goes by vertices, by values that run across triangles, and by instructions per pixel.
So what is constant on a triangle comes ready from its vertices (``surface_light``), and what only shows up
close is drawn by programs of its own (``NEAR``).
"""

import re
from typing import Final

from siren_ros.sensing.meshes.mesh import Material, Swing
from siren_ros.simulation.world.actors import Lights


def included(source: str) -> str:
    """Expand the ``#include`` line of a GLSL source, which names texts of this module."""
    return re.sub(r"^#include (.*)\n", lambda line: "".join(globals()[name] for name in line[1].split()), source)


HEAD: Final = """#version 330 core
layout(std140) uniform Frame {
    mat4 clip_from_map;
    mat4 map_from_clip;
    mat4 static_shadow_from_map;
    vec4 eye;            // w: seconds of simulated time
    vec4 forward;        // w: focal length in pixels
    vec4 ground_light_from_map; // scale, offset x, offset y
    vec4 picture;        // centre in pixels, z: exposure
};
"""
SQUARE: Final = """#version 330 core
uniform vec4 light_from_map;  // scale, offset x, offset y, in clip coordinates of the light map
vec2 corner() { return vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1)); }
"""
"""Uniform block: the square of light on the ground."""

CODES: Final = "".join(
    [f"const float {material.name} = {int(material)}.0;\n" for material in Material]
    + [f"const uint LIGHT_{light.name} = {int(light)}u;\n" for light in Lights]
    + [f"const float {swing.name} = {int(swing)}.0;\n" for swing in Swing]
)
"""GLSL constants: codes of materials, lamps and limbs."""

CLEAR: Final = """
float clearness(vec3 position) { return exp2(-1.442695 * HAZE_PER_M * distance(position, eye.xyz)); }
"""

LIGHT_PLACE: Final = """
vec2 light_place(vec2 position) { return position * ground_light_from_map.x + ground_light_from_map.yz; }
vec3 lit_place(vec3 position, vec2 away) {
#ifdef NIGHT
    return vec3(light_place(position.xy + away), position.z);
#else
    return (static_shadow_from_map * vec4(position, 1.0)).xyz;
#endif
}
"""
"""GLSL functions: where a vertex looks up how much light reaches it, in the sun's shadow map or the lamps' texture."""

LIT: Final = """
uniform sampler2D ground_light;
#ifdef NIGHT
vec3 lit_at(vec3 place) { return texture(ground_light, place.xy).rgb * (8.0 / (8.0 + place.z * place.z)); }
#else
uniform sampler2DShadow static_shadow;
vec3 lit_at(vec3 place) { return vec3(texture(static_shadow, place)); }
#endif
"""

MIRROR: Final = """
vec3 sky_of(float up) {
    float h = 1.0 - max(up, 0.0);
    h = h * h; h = h * h;
    return mix(zenith_colour, horizon_colour, h);
}
vec3 mirrored_light(vec3 light, vec3 place, vec3 n, float gloss, vec3 lit) {
    vec3 view = normalize(place - eye.xyz);
    float along = dot(view, n);
    vec3 mirrored = view - 2.0 * along * n;
    float facing = 1.0 - max(-along, 0.0);
    float fresnel = facing * facing; fresnel = fresnel * fresnel * facing;
    vec3 seen = mix(MIRRORED_GROUND, sky_of(mirrored.z), clamp(mirrored.z * 4.5 + 0.54, 0.0, 1.0));
    float glint = max(dot(mirrored, towards_sun), 0.0);
    glint *= glint; glint *= glint; glint *= glint; glint *= glint; glint *= glint; glint *= glint;
    return mix(light, seen, min(gloss * (0.35 + 1.65 * fresnel), 1.0)) + sun_colour * lit * (glint * gloss * 1.5);
}
"""

STATIC_VERTEX: Final = included("""#include HEAD CLEAR LIGHT_PLACE LIT MIRROR
in vec3 in_position;
in vec4 in_sun;
in vec4 in_shade;
flat out vec4 v_sun;
flat out vec4 v_shade;
in vec4 in_normal;
#ifdef NORMAL
flat out vec4 v_normal;
#endif
#ifdef SHADOW
out vec3 v_shadow;
#endif
#ifdef LIGHT
out vec2 v_light;
#endif
out vec4 v_place;    // w: share of the light that the haze lets through
#ifdef NORMAL
#define AWAY in_normal.xy  // what stands on the ground is lit by the light before it
#else
#define AWAY vec2(0.0)
#endif
void main() {
    gl_Position = clip_from_map * vec4(in_position, 1.0);
    v_place = vec4(in_position, clearness(in_position));
    v_sun = in_sun;
    v_shade = in_shade;
#ifdef FLAT_MIRROR
    vec3 lit = lit_at(lit_place(in_position, in_normal.xy));
    v_shade.rgb = mirrored_light(in_shade.rgb + in_sun.rgb * lit, in_position, in_normal.xyz, in_normal.w, lit);
#endif
#ifdef NORMAL
    v_normal = in_normal;
#endif
#ifdef SHADOW
    v_shadow = lit_place(in_position, AWAY);
#endif
#ifdef LIGHT
    v_light = light_place(in_position.xy);
#endif
}
""")

OUTPUT: Final = """
layout(location = 0) out vec4 out_colour;
layout(location = 1) out uint out_actor;
layout(location = 2) out float out_depth;
vec3 film(vec3 c) { return sqrt(clamp((c * (2.51 * c + 0.03)) / (c * (2.43 * c + 0.59) + 0.14), 0.0, 1.0)); }
float haze_between(float interpolated) {
#ifdef FOG
    vec3 ray = vec3((gl_FragCoord.xy - picture.xy) / forward.w, 1.0);
    return exp2(-1.442695 * HAZE_PER_M * length(ray) / gl_FragCoord.w);
#else
    return interpolated;
#endif
}
void finish(vec3 light, float clear, float semantic, uint actor) {
    vec3 c = mix(horizon_colour * 0.96, light, haze_between(clear));
    out_colour = vec4(film(c * picture.z), semantic);
    out_actor = actor;
    out_depth = 1.0 / gl_FragCoord.w;
}
"""

STATIC_FRAGMENT: Final = included("""#include HEAD OUTPUT LIT
uniform sampler2D noise;
in vec4 v_place;
flat in vec4 v_sun;
flat in vec4 v_shade;
#ifdef NORMAL
flat in vec4 v_normal;
#endif
#ifdef SHADOW
in vec3 v_shadow;
#endif
#ifdef LIGHT
in vec2 v_light;
#endif
""")

MATTE_FRAGMENT: Final = included("""#include STATIC_FRAGMENT
void main() {
    vec3 lit = lit_at(v_shadow);
    finish(v_shade.rgb + v_sun.rgb * lit, v_place.w, v_shade.w, 0u);
}
""")

FLAT_FRAGMENT: Final = included("""#include STATIC_FRAGMENT
void main() { finish(v_shade.rgb, v_place.w, v_shade.w, 0u); }
""")

GLASS_FRAGMENT: Final = included("""#include STATIC_FRAGMENT MIRROR
void main() {
    vec3 lit = lit_at(v_shadow);
    vec3 light = mirrored_light(v_shade.rgb + v_sun.rgb * lit, v_place.xyz, v_normal.xyz, v_normal.w, lit);
    finish(light, v_place.w, v_shade.w, 0u);
}
""")

FOLIAGE_FRAGMENT: Final = included("""#include STATIC_FRAGMENT
#ifdef NIGHT
const float LEAVES = 0.0;
#else
const float LEAVES = 0.35;  // share of the sunlight that comes through
#endif
void main() {
    vec3 q = v_place.xyz * 0.21;
    float grain = texture(noise, q.xy + q.z * vec2(0.37, 0.61)).r + texture(noise, q.yz * 2.3 + q.x).r - 1.0;
    vec3 sun = clamp(v_sun.w + 0.8 * grain, 0.0, 1.0) * (LEAVES + (1.0 - LEAVES) * lit_at(v_shadow));
    finish((v_shade.rgb + v_sun.rgb * sun) * clamp(1.0 + 1.3 * grain, 0.25, 1.9), v_place.w, v_shade.w, 0u);
}
""")

GROUND_FRAGMENT: Final = included("""#include STATIC_FRAGMENT
void main() {
    float fine = texture(noise, v_light * NOISE_PER_LIGHT).r - 0.5;
#ifdef NIGHT
    vec3 lit = texture(ground_light, v_light).rgb;
#else
    float lit = texture(ground_light, v_light).r;
#endif
    vec3 light = (v_shade.rgb + v_sun.rgb * lit) * (1.0 + v_sun.w * fine);
#ifdef NEAR
    vec2 joint = abs(fract(v_place.xy / 1.5) - 0.5) * 1.5;
    float width = 0.012 + 1.0 / (forward.w * gl_FragCoord.w);
    float line = clamp(1.0 - (0.75 - max(joint.x, joint.y)) / width, 0.0, 1.0);
    light *= 1.0 - 0.35 * line * clamp(0.034 / width - 0.13, 0.0, 1.0);
#else
    light *= 1.0 - v_normal.w * clamp(fine * 5.5 - 0.66, 0.0, 1.0);
#endif
#ifdef WET
    vec3 view = normalize(v_place.xyz - eye.xyz);
    float facing = 1.0 + view.z;
    float fresnel = facing * facing; fresnel = fresnel * fresnel * facing;
    float film_of_water = WETNESS * clamp(0.65 - 2.6 * fine, 0.12, 1.0) * step(v_sun.w, 1.0);
    float h = facing * facing; h = h * h;
    light = mix(light, mix(zenith_colour, horizon_colour, h), (0.04 + 0.7 * fresnel) * film_of_water);
#endif
    finish(light, v_place.w, v_shade.w, 0u);
}
""")

WALL_FRAGMENT: Final = included("""#include STATIC_FRAGMENT
void main() {
    float u = v_place.y * v_normal.x - v_place.x * v_normal.y;
    float tone = 0.82 + 0.36 * texture(noise, vec2(u, v_place.z) * 0.35).r;
#ifdef NEAR
    vec2 brick = vec2(u / 0.24, v_place.z / 0.075);
    brick.x += 0.5 * mod(floor(brick.y), 2.0);
    vec2 mortar = abs(fract(brick) - 0.5);
    float sharp = clamp(0.03 * forward.w * gl_FragCoord.w - 0.4, 0.0, 1.0);
    tone -= 0.16 * v_sun.w * max(step(0.46, mortar.x), step(0.38, mortar.y)) * sharp;
#endif
    tone *= clamp(0.78 + 0.14 * v_place.z, 0.0, 1.0);
#ifdef SHADOW
    vec3 light = v_shade.rgb + v_sun.rgb * lit_at(v_shadow);
#else
    vec3 light = v_shade.rgb;
#endif
    finish(light * tone, v_place.w, v_shade.w, 0u);
}
""")

STATIC_SHADOW_VERTEX: Final = """#version 330 core
uniform mat4 clip_from_map;
in vec3 in_position;
void main() { gl_Position = clip_from_map * vec4(in_position, 1.0); }
"""
SHADOW_FRAGMENT: Final = "#version 330 core\nvoid main() {}\n"


SKY_SPREAD: Final = "const float SKY_SPREAD = 1.25;  // parabolic map down to 12 degrees below the horizon\n"

SKY_VERTEX: Final = included("""#include HEAD
out vec3 v_direction;
out vec2 v_clip;
void main() {
    v_clip = vec2((gl_VertexID & 1) * 4 - 1, (gl_VertexID >> 1) * 4 - 1);
    gl_Position = vec4(v_clip, 1.0, 1.0);
    vec4 far = map_from_clip * vec4(v_clip, 1.0, 1.0);
    v_direction = far.xyz / far.w - eye.xyz;
}
""")

SKY_PAINT_FRAGMENT: Final = included("""#include HEAD OUTPUT SKY_SPREAD
uniform sampler2D noise;
in vec2 v_clip;
#ifdef NIGHT
const vec3 CLOUD_GLOW = vec3(0.012, 0.011, 0.010);  // the town's light from below
#else
const vec3 CLOUD_GLOW = vec3(0.12);
#endif
void main() {
    vec2 p = v_clip * SKY_SPREAD;
    vec3 d = vec3(2.0 * p, 1.0 - dot(p, p)) / (1.0 + dot(p, p));
    float up = max(d.z, 0.0);
    float h = 1.0 - up;
    h = h * h; h = h * h;
    vec3 c = mix(zenith_colour, horizon_colour, h);
    vec2 q = d.xy / (up + 0.12) * 0.045;
    float cloud = textureLod(noise, q, 0.0).r * 0.55 + textureLod(noise, q * 2.7 + 0.3, 0.0).r * 0.3
        + textureLod(noise, q * 7.1, 0.0).r * 0.15;
    float cover = 0.66 - 0.32 * CLOUD_COVER;
    cloud = smoothstep(cover, cover + 0.16, cloud) * smoothstep(0.02, 0.22, up);
    vec3 white = horizon_colour * 0.35 + sun_colour * 0.2 + CLOUD_GLOW;
    c = mix(c, white, cloud * 0.85);
#ifdef NIGHT
    vec2 cell = floor(v_clip * 320.0);
    float star = fract(sin(dot(cell, vec2(12.9898, 78.233))) * 43758.5453);
    c += (1.0 - cloud) * smoothstep(0.05, 0.3, d.z) * 0.5 * smoothstep(0.9982, 1.0, star);
#endif
    float s = max(dot(d, towards_sun), 0.0);
    float s8 = s * s; s8 = s8 * s8; s8 = s8 * s8;
    float s64 = s8 * s8; s64 = s64 * s64; s64 = s64 * s64;
    float disc = smoothstep(0.99985, 0.99995, s);
    c += sun_colour * (0.03 * s8 + 0.12 * s64 + 4.0 * disc * (1.0 - 0.8 * cloud));
#ifdef FOG
    c = mix(c, horizon_colour * 0.96, clamp(0.5 + 60.0 * HAZE_PER_M, 0.0, 1.0));
#endif
    out_colour = vec4(film(c * picture.z), 1.0);
    out_actor = 0u;
    out_depth = 0.0;
}
""")

SKY_FRAGMENT: Final = included("""#include HEAD SKY_SPREAD
uniform sampler2D sky;
uniform float semantic;
in vec3 v_direction;
layout(location = 0) out vec4 out_colour;
layout(location = 1) out uint out_actor;
layout(location = 2) out float out_depth;
void main() {
    vec3 d = v_direction * inversesqrt(dot(v_direction, v_direction));
    vec2 p = d.xy / (1.0 + max(d.z, -0.2));
    out_colour = vec4(texture(sky, p * (0.5 / SKY_SPREAD) + 0.5).rgb, semantic);
    out_actor = 0u;
    out_depth = 0.0;
}
""")
