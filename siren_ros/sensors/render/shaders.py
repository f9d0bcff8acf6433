"""GLSL programs. Light is computed in linear RGB and leaves as sRGB-like 8-bit colour (gamma 2).

Every fragment writes colour with its semantic class as alpha, and where the framebuffer has them the actor id and the
depth along the optical axis, all from the same draw.
"""

from typing import Final

from siren_ros.sensors.scene.material import Material
from siren_ros.world.actors import Lights

_MATERIALS: Final = "\n".join(f"const float {material.name} = {int(material)}.0;" for material in Material)
_LIGHTS: Final = "\n".join(f"const uint LIGHT_{light.name} = {int(light)}u;" for light in Lights)

FRAME_BLOCK: Final = """
layout(std140) uniform Frame {
    mat4 clip_from_map;
    mat4 map_from_clip;
    mat4 static_shadow_from_map;
    mat4 vehicle_shadow_from_map;
    vec4 eye;            // w: seconds of simulated time
    vec4 forward;        // w: size of a pixel at distance 1
    vec4 towards_sun;    // w: exposure
    vec4 sun_colour;     // w: ambient strength
    vec4 zenith_colour;  // w: haze per metre
    vec4 horizon_colour; // w: cloud cover
};
"""

_HEAD: Final = "#version 330 core\n" + FRAME_BLOCK + _MATERIALS + "\n" + _LIGHTS

STATIC_VERTEX: Final = (
    _HEAD
    + """
in vec3 in_position;
in vec4 in_normal;   // w: material
in vec4 in_colour;   // a: semantic class
out vec3 v_position;
flat out vec3 v_normal;
flat out vec4 v_colour;
flat out vec4 v_surface;   // material, gloss, 0, 0
flat out vec3 v_emission;
flat out uint v_actor;
out vec3 v_static_shadow;
out vec3 v_vehicle_shadow;
void main() {
    gl_Position = clip_from_map * vec4(in_position, 1.0);
    v_position = in_position;
    v_normal = in_normal.xyz;
    v_static_shadow = (static_shadow_from_map * vec4(in_position, 1.0)).xyz;
    v_vehicle_shadow = (vehicle_shadow_from_map * vec4(in_position, 1.0)).xyz;
    v_colour = vec4(in_colour.rgb * in_colour.rgb, in_colour.a);
    float m = in_normal.w;
    float gloss = m == BUILDING_GLASS ? 0.55 : m == METAL_POLE ? 0.12 : 0.0;
    v_surface = vec4(m, gloss, 0.0, 0.0);
    v_emission = vec3(0.0);
    bool lens = m == SIGNAL_RED || m == SIGNAL_YELLOW || m == SIGNAL_GREEN;
#ifdef LIT
    v_emission = v_colour.rgb * 2.6 + 0.10;
#else
    if (lens) v_colour.rgb *= 0.10;
#endif
    v_actor = 0u;
}
"""
)

VEHICLE_VERTEX: Final = (
    _HEAD
    + """
in vec3 in_position;
in vec4 in_normal;   // w: material
in vec4 in_colour;
in vec4 in_hub;      // centre of the wheel, w: 0 body, 1 wheel, 2 steered wheel
in vec4 in_row_x;    // map_from_base, rows
in vec4 in_row_y;
in vec4 in_row_z;
in vec4 in_paint;    // rgb, a: semantic class
in vec2 in_motion;   // steering angle, distance rolled
in uvec2 in_actor;   // id, lights
out vec3 v_position;
flat out vec3 v_normal;
flat out vec4 v_colour;
flat out vec4 v_surface;
flat out vec3 v_emission;
flat out uint v_actor;
out vec3 v_static_shadow;
vec3 lamp(float m, uint lights, float t) {
    bool blink = fract(t * 1.5) < 0.5;
    float strobe = fract(t * 2.0);
    bool flash = fract(strobe * 6.0) < 0.62;
    if (m == BRAKE_LAMP) return (lights & LIGHT_BRAKE) != 0u ? vec3(3.0, 0.10, 0.06) : vec3(0.10, 0.0, 0.0);
    bool left = m == INDICATOR_LEFT_LAMP && (lights & LIGHT_INDICATOR_LEFT) != 0u;
    bool right = m == INDICATOR_RIGHT_LAMP && (lights & LIGHT_INDICATOR_RIGHT) != 0u;
    if (blink && (left || right)) return vec3(3.2, 1.1, 0.0);
    bool beacon = (lights & LIGHT_BEACON) != 0u;
    if (m == BEACON_BLUE) return beacon && strobe < 0.5 && flash ? vec3(0.05, 0.35, 3.2) : vec3(0.0, 0.01, 0.06);
    if (m == BEACON_RED) return beacon && strobe >= 0.5 && flash ? vec3(3.2, 0.10, 0.06) : vec3(0.06, 0.0, 0.0);
    if (m == HEAD_LAMP) return vec3(0.55, 0.55, 0.5);
    return vec3(0.0);
}
void main() {
    vec3 p = in_position;
    vec3 n = in_normal.xyz;
    if (in_hub.w > 0.5) {
        float roll = in_motion.y / in_hub.z;
        float c = cos(roll), s = sin(roll);
        vec3 q = p - in_hub.xyz;
        q = vec3(c * q.x + s * q.z, q.y, c * q.z - s * q.x);
        n = vec3(c * n.x + s * n.z, n.y, c * n.z - s * n.x);
        if (in_hub.w > 1.5) {
            c = cos(in_motion.x); s = sin(in_motion.x);
            q = vec3(c * q.x - s * q.y, s * q.x + c * q.y, q.z);
            n = vec3(c * n.x - s * n.y, s * n.x + c * n.y, n.z);
        }
        p = q + in_hub.xyz;
    }
    vec4 h = vec4(p, 1.0);
    v_position = vec3(dot(in_row_x, h), dot(in_row_y, h), dot(in_row_z, h));
    gl_Position = clip_from_map * vec4(v_position, 1.0);
    v_normal = normalize(vec3(dot(in_row_x.xyz, n), dot(in_row_y.xyz, n), dot(in_row_z.xyz, n)));
    v_static_shadow = (static_shadow_from_map * vec4(v_position, 1.0)).xyz;
    float m = in_normal.w;
    vec3 colour = in_colour.rgb * in_colour.rgb;
    if (m == CAR_PAINT) colour *= in_paint.rgb * in_paint.rgb;
    v_colour = vec4(colour, in_paint.a);
    bool paint = m == CAR_PAINT || m == FLEET_PAINT;
    float gloss = paint ? 0.20 : m == CAR_GLASS ? 0.55 : m == RIM ? 0.25 : m == LIVERY ? 0.15
        : m == HEAD_LAMP ? 0.4 : 0.03;
    v_surface = vec4(m, gloss, 0.0, 0.0);
    v_emission = lamp(m, in_actor.y, eye.w);
    v_actor = in_actor.x;
}
"""
)

_LIGHTING: Final = """
uniform sampler2DShadow static_shadow;
uniform sampler2DShadow vehicle_shadow;
uniform sampler2D noise;
in vec3 v_position;
flat in vec3 v_normal;
flat in vec4 v_colour;
flat in vec4 v_surface;
flat in vec3 v_emission;
flat in uint v_actor;
in vec3 v_static_shadow;
layout(location = 0) out vec4 out_colour;
layout(location = 1) out uint out_actor;
layout(location = 2) out float out_depth;
vec3 sky_of(vec3 d) {
    float up = max(d.z, 0.0);
    float h = 1.0 - up;
    h = h * h; h = h * h;
    return mix(zenith_colour.rgb, horizon_colour.rgb, h);
}
vec3 ambient_of(vec3 n) {
    vec3 below = vec3(0.20, 0.19, 0.17);
    return sun_colour.w * mix(below, mix(zenith_colour.rgb, horizon_colour.rgb, 0.5) * 1.05, n.z * 0.5 + 0.5);
}
void finish(vec3 light, float depth, float distance) {
    float clear = exp2(-1.442695 * zenith_colour.w * distance);
    vec3 c = mix(horizon_colour.rgb * 0.96, light, clear) * towards_sun.w;
    c = (c * (2.51 * c + 0.03)) / (c * (2.43 * c + 0.59) + 0.14);
    out_colour = vec4(sqrt(clamp(c, 0.0, 1.0)), v_colour.a);
    out_actor = v_actor;
    out_depth = depth;
}
"""

PLAIN_FRAGMENT: Final = (
    _HEAD
    + _LIGHTING
    + """
void main() {
    vec3 toward = v_position - eye.xyz;
    float distance = length(toward);
    vec3 view = toward / distance;
    vec3 n = dot(v_normal, view) > 0.0 ? -v_normal : v_normal;
    float sun = max(dot(n, towards_sun.xyz), 0.0);
    sun *= texture(static_shadow, v_static_shadow);
    vec3 light = v_colour.rgb * (sun * sun_colour.rgb + ambient_of(n)) + v_emission;
    vec3 mirrored = reflect(view, n);
    float facing = 1.0 - max(-dot(view, n), 0.0);
    float fresnel = facing * facing; fresnel = fresnel * fresnel * facing;
    float gloss = v_surface.y * (0.35 + 1.65 * fresnel);
    vec3 ground = vec3(0.16, 0.155, 0.15);
    vec3 seen = mix(ground, sky_of(mirrored), smoothstep(-0.12, 0.10, mirrored.z));
    float glint = max(dot(mirrored, towards_sun.xyz), 0.0);
    glint *= glint; glint *= glint; glint *= glint; glint *= glint; glint *= glint; glint *= glint;
    light = mix(light, seen, min(gloss, 1.0)) + sun_colour.rgb * (glint * v_surface.y * 1.5 * step(0.01, sun));
    finish(light, dot(toward, forward.xyz), distance);
}
"""
)

FOLIAGE_FRAGMENT: Final = (
    _HEAD
    + _LIGHTING
    + """
void main() {
    vec3 toward = v_position - eye.xyz;
    float distance = length(toward);
    vec3 q = v_position * 0.21;
    float grain = texture(noise, q.xy + q.z * vec2(0.37, 0.61)).r + texture(noise, q.yz * 2.3 + q.x).r - 1.0;
    vec3 n = normalize(v_normal + 0.9 * grain);
    float sun = max(dot(n, towards_sun.xyz) * 0.75 + 0.25, 0.0);
    sun *= mix(0.35, 1.0, texture(static_shadow, v_static_shadow));
    vec3 colour = v_colour.rgb * clamp(1.0 + 1.3 * grain, 0.25, 1.9);
    finish(colour * (sun * sun_colour.rgb + ambient_of(n)), dot(toward, forward.xyz), distance);
}
"""
)

GROUND_FRAGMENT: Final = (
    _HEAD
    + _LIGHTING
    + """
in vec3 v_vehicle_shadow;
void main() {
    vec3 toward = v_position - eye.xyz;
    float distance = length(toward);
    vec3 n = v_normal.z < 0.0 ? -v_normal : v_normal;
    float m = v_surface.x;
    float fine = texture(noise, v_position.xy * 0.31).r - 0.5;
    bool road = m == ASPHALT || m == SHOULDER_ASPHALT;
    bool green = m == GRASS || m == MEDIAN || m == GROUND;
    bool slab = m == SIDEWALK;
    bool marking = m == MARKING_WHITE || m == MARKING_YELLOW;
    float strength = road ? 0.42 : green ? 1.1 : marking ? 0.35 : 0.3;
    vec3 colour = v_colour.rgb * ((green ? 0.72 : 1.0) + strength * fine);
    vec2 joint = abs(fract(v_position.xy / 1.5) - 0.5) * 1.5;
    float width = 0.012 + distance * forward.w;
    float line = 1.0 - smoothstep(0.0, width, 0.75 - max(joint.x, joint.y));
    colour *= slab ? 1.0 - 0.35 * line * clamp(0.03 / width, 0.0, 1.0) : 1.0;
    colour *= marking ? 1.0 - 0.5 * smoothstep(0.12, 0.30, fine) : 1.0;
    float lit = texture(static_shadow, v_static_shadow);
    lit *= texture(vehicle_shadow, v_vehicle_shadow);
    float sun = max(dot(n, towards_sun.xyz), 0.0) * lit;
    vec3 light = colour * (sun * sun_colour.rgb + ambient_of(n) * (0.72 + 0.28 * lit));
    finish(light, dot(toward, forward.xyz), distance);
}
"""
)

FACADE_FRAGMENT: Final = (
    _HEAD
    + _LIGHTING
    + """
void main() {
    vec3 toward = v_position - eye.xyz;
    float distance = length(toward);
    vec3 view = toward / distance;
    vec3 n = dot(v_normal, view) > 0.0 ? -v_normal : v_normal;
    vec2 along = normalize(vec2(-n.y, n.x) + 1e-6);
    float u = dot(v_position.xy, along);
    float soft = distance * forward.w;
    float grain = texture(noise, vec2(u, v_position.z) * 0.35).r - 0.5;
    vec2 brick = vec2(u / 0.24, v_position.z / 0.075);
    brick.x += 0.5 * mod(floor(brick.y), 2.0);
    vec2 mortar = abs(fract(brick) - 0.5);
    float course = max(step(0.46, mortar.x), step(0.38, mortar.y)) * clamp(0.03 / soft - 0.4, 0.0, 1.0);
    float bricks = step(v_colour.b * 1.3, v_colour.r);
    vec3 wall = v_colour.rgb * (1.0 + 0.36 * grain - 0.16 * course * bricks);
    wall *= mix(0.78, 1.0, smoothstep(0.0, 1.6, v_position.z));
    float lit = texture(static_shadow, v_static_shadow);
    float sun = max(dot(n, towards_sun.xyz), 0.0) * lit;
    finish(wall * (sun * sun_colour.rgb + ambient_of(n)), dot(toward, forward.xyz), distance);
}
"""
)

SKY_VERTEX: Final = (
    _HEAD
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

_SKY_SPREAD: Final = "const float SKY_SPREAD = 1.25;  // parabolic map down to 12 degrees below the horizon\n"

SKY_PAINT_FRAGMENT: Final = (
    _HEAD
    + _SKY_SPREAD
    + """
uniform sampler2D noise;
in vec2 v_clip;
layout(location = 0) out vec4 out_colour;
void main() {
    vec2 p = v_clip * SKY_SPREAD;
    vec3 d = vec3(2.0 * p, 1.0 - dot(p, p)) / (1.0 + dot(p, p));
    float up = max(d.z, 0.0);
    float h = 1.0 - up;
    h = h * h; h = h * h;
    vec3 c = mix(zenith_colour.rgb, horizon_colour.rgb, h);
    vec2 q = d.xy / (up + 0.12) * 0.045;
    float cloud = textureLod(noise, q, 0.0).r * 0.55 + textureLod(noise, q * 2.7 + 0.3, 0.0).r * 0.3
        + textureLod(noise, q * 7.1, 0.0).r * 0.15;
    float cover = 0.66 - 0.32 * horizon_colour.w;
    cloud = smoothstep(cover, cover + 0.16, cloud) * smoothstep(0.02, 0.22, up);
    c = mix(c, vec3(0.93, 0.94, 0.96), cloud * 0.85);
    float s = max(dot(d, towards_sun.xyz), 0.0);
    float s8 = s * s; s8 = s8 * s8; s8 = s8 * s8;
    float s64 = s8 * s8; s64 = s64 * s64; s64 = s64 * s64;
    float disc = smoothstep(0.99985, 0.99995, s);
    c += sun_colour.rgb * (0.03 * s8 + 0.12 * s64 + 4.0 * disc * (1.0 - 0.8 * cloud));
    out_colour = vec4(c, 1.0);
}
"""
)

SKY_FRAGMENT: Final = (
    _HEAD
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
    vec3 c = texture(sky, p * (0.5 / SKY_SPREAD) + 0.5).rgb * towards_sun.w;
    c = (c * (2.51 * c + 0.03)) / (c * (2.43 * c + 0.59) + 0.14);
    out_colour = vec4(sqrt(clamp(c, 0.0, 1.0)), semantic);
    out_actor = 0u;
    out_depth = 0.0;
}
"""
)

STATIC_SHADOW_VERTEX: Final = """#version 330 core
uniform mat4 clip_from_map;
in vec3 in_position;
void main() { gl_Position = clip_from_map * vec4(in_position, 1.0); }
"""

VEHICLE_SHADOW_VERTEX: Final = """#version 330 core
uniform mat4 clip_from_map;
in vec3 in_position;
in vec4 in_row_x;
in vec4 in_row_y;
in vec4 in_row_z;
void main() {
    vec4 h = vec4(in_position, 1.0);
    gl_Position = clip_from_map * vec4(dot(in_row_x, h), dot(in_row_y, h), dot(in_row_z, h), 1.0);
}
"""

SHADOW_FRAGMENT: Final = "#version 330 core\nvoid main() {}\n"
