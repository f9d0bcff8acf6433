"""GLSL of the vehicles: posed, lit and lamps switched per vertex, mirroring per pixel."""

from typing import Final

from siren_ros.sensors.camera.shading.shaders import CLEAR, HEAD, LIGHT_PLACE, LIT, MIRROR, OUTPUT
from siren_ros.sensors.camera.shading.surface_light import GROUND_AMBIENT
from siren_ros.sensors.meshes.material import Material
from siren_ros.world.actors import Lights

_MATERIALS: Final = "\n".join(f"const float {material.name} = {int(material)}.0;" for material in Material)
_LIGHTS: Final = "\n".join(f"const uint LIGHT_{light.name} = {int(light)}u;" for light in Lights)
_GROUND_AMBIENT: Final = f"const vec3 GROUND_AMBIENT = vec3({', '.join(map(str, GROUND_AMBIENT))});"

VEHICLE_VERTEX: Final = (
    f"{HEAD}\n{_MATERIALS}\n{_LIGHTS}\n{_GROUND_AMBIENT}"
    + CLEAR
    + LIGHT_PLACE
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
out vec4 v_place;
out vec3 v_shadow;
flat out vec4 v_sun;      // w: gloss
flat out vec4 v_shade;    // w: semantic class
flat out vec3 v_normal;
flat out uint v_actor;
#ifdef NIGHT
const vec3 TAIL = vec3(0.75, 0.02, 0.01);
const vec3 HEAD_LIGHT = vec3(5.0, 4.8, 4.2);
#else
const vec3 TAIL = vec3(0.10, 0.0, 0.0);
const vec3 HEAD_LIGHT = vec3(0.55, 0.55, 0.5);
#endif
vec3 lamp(float m, uint lights, float t) {
    bool blink = fract(t * 1.5) < 0.5;
    float strobe = fract(t * 2.0);
    bool flash = fract(strobe * 6.0) < 0.62;
    if (m == BRAKE_LAMP) return (lights & LIGHT_BRAKE) != 0u ? vec3(3.0, 0.10, 0.06) : TAIL;
    bool left = m == INDICATOR_LEFT_LAMP && (lights & LIGHT_INDICATOR_LEFT) != 0u;
    bool right = m == INDICATOR_RIGHT_LAMP && (lights & LIGHT_INDICATOR_RIGHT) != 0u;
    if (blink && (left || right)) return vec3(3.2, 1.1, 0.0);
    bool beacon = (lights & LIGHT_BEACON) != 0u;
    if (m == BEACON_BLUE) return beacon && strobe < 0.5 && flash ? vec3(0.05, 0.35, 3.2) : vec3(0.0, 0.01, 0.06);
    if (m == BEACON_RED) return beacon && strobe >= 0.5 && flash ? vec3(3.2, 0.10, 0.06) : vec3(0.06, 0.0, 0.0);
    if (m == HEAD_LAMP) return HEAD_LIGHT;
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
    vec3 position = vec3(dot(in_row_x, h), dot(in_row_y, h), dot(in_row_z, h));
    gl_Position = clip_from_map * vec4(position, 1.0);
    v_place = vec4(position, clearness(position));
    v_shadow = lit_place(position, vec2(0.0));
    n = normalize(vec3(dot(in_row_x.xyz, n), dot(in_row_y.xyz, n), dot(in_row_z.xyz, n)));
    float m = in_normal.w;
    vec3 colour = in_colour.rgb * in_colour.rgb;
    if (m == CAR_PAINT) colour *= in_paint.rgb * in_paint.rgb;
    bool paint = m == CAR_PAINT || m == FLEET_PAINT;
    float gloss = paint ? 0.20 : m == CAR_GLASS ? 0.55 : m == RIM ? 0.25 : m == LIVERY ? 0.15
        : m == HEAD_LAMP ? 0.4 : 0.03;
    vec3 sky = (zenith_colour + horizon_colour) * 0.525;
    vec3 ambient = AMBIENT * mix(GROUND_AMBIENT, sky, n.z * 0.5 + 0.5);
#ifdef NIGHT
    v_sun = vec4(colour * (0.6 + 0.4 * n.z), gloss);
#else
    v_sun = vec4(colour * sun_colour * max(dot(n, towards_sun), 0.0), gloss);
#endif
    v_shade = vec4(colour * ambient + lamp(m, in_actor.y, eye.w), in_paint.a);
    v_normal = n;
    v_actor = in_actor.x;
}
"""
)

VEHICLE_FRAGMENT: Final = (
    HEAD
    + OUTPUT
    + LIT
    + MIRROR
    + """
in vec4 v_place;
in vec3 v_shadow;
flat in vec4 v_sun;
flat in vec4 v_shade;
flat in vec3 v_normal;
flat in uint v_actor;
void main() {
    vec3 lit = lit_at(v_shadow);
#ifdef NIGHT
    vec3 sunny = lit;
#else
    vec3 sunny = dot(v_normal, towards_sun) > 0.0 ? lit : vec3(0.0);
#endif
    vec3 light = mirrored_light(v_shade.rgb + v_sun.rgb * lit, v_place.xyz, v_normal, v_sun.w, sunny);
    finish(light, v_place.w, v_shade.w, v_actor);
}
"""
)

GROUND_SHADOW_VERTEX: Final = """#version 330 core
uniform vec4 light_from_map;  // scale, offset x, offset y, in clip coordinates of the light map
uniform vec2 per_metre_up;    // how far a point's shadow moves along the ground per metre of height
in vec3 in_position;
in vec4 in_row_x;
in vec4 in_row_y;
in vec4 in_row_z;
void main() {
    vec4 h = vec4(in_position, 1.0);
    vec3 p = vec3(dot(in_row_x, h), dot(in_row_y, h), dot(in_row_z, h));
    gl_Position = vec4((p.xy - per_metre_up * p.z) * light_from_map.x + light_from_map.yz, 0.0, 1.0);
}
"""
GROUND_SHADOW_FRAGMENT: Final = """#version 330 core
uniform sampler2D baked;
uniform float kept;  // 1 takes a shadow off again
out vec4 lit;
void main() { lit = kept * texelFetch(baked, ivec2(gl_FragCoord.xy), 0); }
"""
