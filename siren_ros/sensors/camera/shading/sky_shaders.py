"""GLSL of the sky: painted once as light, developed once per exposure, then looked up by direction."""

from typing import Final

from siren_ros.sensors.camera.shading.shaders import HEAD, OUTPUT

_SKY_SPREAD: Final = "const float SKY_SPREAD = 1.25;  // parabolic map down to 12 degrees below the horizon\n"

SKY_VERTEX: Final = (
    HEAD
    + """
out vec3 v_direction;
out vec2 v_clip;
void main() {
    v_clip = vec2((gl_VertexID & 1) * 4 - 1, (gl_VertexID >> 1) * 4 - 1);
    gl_Position = vec4(v_clip, 1.0, 1.0);
    vec4 far = map_from_clip * vec4(v_clip, 1.0, 1.0);
    v_direction = far.xyz / far.w - eye.xyz;
}
"""
)

SKY_PAINT_FRAGMENT: Final = (
    HEAD
    + OUTPUT
    + _SKY_SPREAD
    + """
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
"""
)

SKY_FRAGMENT: Final = (
    HEAD
    + _SKY_SPREAD
    + """
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
"""
)
