"""Vehicles on the graphics card: one mesh per class, drawn once per vehicle with its own pose, paint and lights.

Their GLSL poses and lights vehicles and switches lamps per vertex; mirroring is computed per pixel.
"""

import itertools
from collections.abc import Mapping
from typing import Any, Final

import moderngl
import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Flags, Floats, Floats32, Rows
from siren_ros.sensing.camera.culling import VERTEX, IndexedMesh, index_mesh
from siren_ros.sensing.camera.shaders import included
from siren_ros.sensing.camera.surface_light import defined
from siren_ros.sensing.meshes.mesh import (
    SEMANTIC_CLASS_OF_MATERIAL,
    VehiclePlacement,
    VehicleShape,
    semantic_class_of_actor,
)
from siren_ros.simulation.world.actors import ActorClass

_VERTEX: Final = np.dtype([("base", VERTEX), ("hub", "<f2", 4)])
_VERTEX_FORMAT: Final = "3f 4f2 4f1 4f2"
INSTANCE: Final = np.dtype([("rows", "<f4", (3, 4)), ("paint", "<f4", 4), ("motion", "<f4", 2), ("actor", "<u4", 2)])
_INSTANCE_FORMAT: Final = "4f 4f 4f 4f 2f 2u4/i"
_INSTANCE_NAMES: Final = ("in_row_x", "in_row_y", "in_row_z", "in_paint", "in_motion", "in_actor")
_ROOM: Final = 64
"""Initial size of the buffers: vehicles of one class."""
Casters = tuple[tuple[int, npt.NDArray[np.void]], ...]
"""Vehicles that cast shadows, by class, with their poses (dtype ``INSTANCE``)."""
_SEMANTIC: Final = np.array([int(semantic_class_of_actor(kind)) for kind in ActorClass], np.float32)


def model_rows(placement: VehiclePlacement) -> Floats32:
    """Poses ``map_from_base`` combined with each shape's scale, as the upper three rows, shape ``(N, 3, 4)``."""
    cos, sin = np.cos(placement.yaw_rad), np.sin(placement.yaw_rad)
    zero = np.zeros(len(placement))
    sx, sy, sz = placement.scale.T if len(placement) else (zero, zero, zero)
    rows = (
        (cos * sx, -sin * sy, zero, placement.x_m),
        (sin * sx, cos * sy, zero, placement.y_m),
        (zero, zero, sz, placement.z_m),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=1).astype(np.float32)


def _indexed(shape: VehicleShape) -> IndexedMesh:
    """The shape at rest as one indexed mesh.

    Each vertex, dtype ``_VERTEX``, holds the hub or the joint that it turns about.
    """
    blocks, triangles, first = [], [], 0
    for mesh, hub in shape.parts:
        indexed = index_mesh(mesh, SEMANTIC_CLASS_OF_MATERIAL)
        block = np.zeros(len(indexed.vertices), _VERTEX)
        block["base"] = indexed.vertices
        block["hub"] = hub
        blocks.append(block)
        triangles.append(indexed.triangles + np.uint32(first))
        first += len(block)
    return IndexedMesh(np.concatenate(blocks), np.concatenate(triangles))


def _hull(shape: VehicleShape) -> Floats32:
    """Corners of the triangles of a simple convex body that casts the vehicle's shadow, shape ``(K, 3)``.

    It spans the shape's extreme points in the 26 directions to a cube's corners, edges and faces. Its triangles turn
    counter-clockwise seen from outside: of both sides that cover the shadow one is drawn.
    """
    from scipy.spatial import ConvexHull  # noqa: PLC0415 - loads slowly, and only cameras need it

    points = shape.at_rest.vertices_m.astype(np.float64)
    directions = np.array([d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
    extreme = points[np.unique(np.argmax(directions @ points.T, axis=1))]
    hull = ConvexHull(extreme)
    corners = extreme[hull.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0.0
    corners[inward] = corners[inward][:, ::-1]
    return corners.reshape(-1, 3).astype(np.float32)


class _Class:
    """Buffers of one vehicle class: one for vehicles in view, one for all that may cast a shadow into the view."""

    def __init__(self, context: moderngl.Context, shape: VehicleShape, program: Any, shadow_program: Any) -> None:
        self._instances = context.buffer(reserve=_ROOM * INSTANCE.itemsize, dynamic=True)
        self._casters = context.buffer(reserve=_ROOM * INSTANCE.itemsize, dynamic=True)
        indexed = _indexed(shape)
        body = context.buffer(indexed.vertices.tobytes())
        indices = context.buffer(indexed.triangles.tobytes())
        hull = context.buffer(_hull(shape).tobytes())
        names = ("in_position", "in_normal", "in_colour", "in_hub")
        self._array = context.vertex_array(
            program, ((body, _VERTEX_FORMAT, *names), (self._instances, _INSTANCE_FORMAT, *_INSTANCE_NAMES)), indices
        )
        self._shadow_array = context.vertex_array(
            shadow_program, ((hull, "3f", "in_position"), (self._casters, "4f 4f 4f 32x/i", *_INSTANCE_NAMES[:3]))
        )
        self._room = {id(self._instances): _ROOM, id(self._casters): _ROOM}

    def _write(self, buffer: Any, instances: npt.NDArray[np.void]) -> None:
        if len(instances) > self._room[id(buffer)]:
            self._room[id(buffer)] = 2 * len(instances)
        buffer.orphan(self._room[id(buffer)] * INSTANCE.itemsize)
        buffer.write(instances.tobytes())

    def draw(self, instances: npt.NDArray[np.void]) -> None:
        """Draw these vehicles."""
        if len(instances):
            self._write(self._instances, instances)
            self._array.render(moderngl.TRIANGLES, instances=len(instances))

    def draw_shadows(self, instances: npt.NDArray[np.void]) -> None:
        """Draw the hulls of these vehicles with the shadow program."""
        if len(instances):
            self._write(self._casters, instances)
            self._shadow_array.render(moderngl.TRIANGLES, instances=len(instances))


class VehicleGeometry:
    """Meshes of all classes. Call ``place`` once per set of vehicles, then draw."""

    def __init__(self, context: moderngl.Context, shapes: Mapping[ActorClass, VehicleShape], constants: str) -> None:
        """Upload the shapes once; ``constants`` is the text that the program begins with."""
        self.program = context.program(
            vertex_shader=defined(VEHICLE_VERTEX, constants), fragment_shader=defined(VEHICLE_FRAGMENT, constants)
        )
        self.shadow_program: Any = context.program(
            vertex_shader=GROUND_SHADOW_VERTEX, fragment_shader=GROUND_SHADOW_FRAGMENT
        )
        self._classes = {
            int(actor_class): _Class(context, shapes[actor_class], self.program, self.shadow_program)
            for actor_class in sorted(shapes)
        }
        self._actor_class = np.empty(0, np.uint8)
        self._instances = np.empty(0, INSTANCE)

    def place(self, placement: VehiclePlacement, rolled_m: Floats) -> None:
        """Set the vehicles for the next pictures."""
        instances = np.zeros(len(placement), INSTANCE)
        instances["rows"] = model_rows(placement)
        instances["paint"][:, :3] = placement.colour_rgb / 255.0
        instances["paint"][:, 3] = _SEMANTIC[placement.actor_class] / 255.0
        instances["motion"] = np.stack((placement.steer_rad, rolled_m), axis=1)
        instances["actor"] = np.stack((placement.actor_id, placement.lights), axis=1)
        self._instances, self._actor_class = instances, placement.actor_class

    def draw(self, nearest_first: Rows) -> None:
        """Draw some of the placed vehicles, given by their rows."""
        kinds = self._actor_class[nearest_first]
        for kind in dict.fromkeys(kinds.tolist()):
            self._classes[kind].draw(self._instances[nearest_first[kinds == kind]])

    def casters(self, near: Flags) -> Casters:
        """The placed vehicles that are near, grouped by class."""
        by_class = ((kind, self._instances[near & (self._actor_class == kind)]) for kind in self._classes)
        return tuple((kind, instances) for kind, instances in by_class if len(instances))

    def draw_shadows(self, casters: Casters) -> None:
        """Draw the hulls of vehicles with the shadow program."""
        for kind, instances in casters:
            self._classes[kind].draw_shadows(instances)


VEHICLE_VERTEX: Final = included("""#include HEAD CODES CLEAR LIGHT_PLACE
in vec3 in_position;
in vec4 in_normal;   // w: material
in vec4 in_colour;
in vec4 in_hub;      // centre of wheel or joint, w: 0 body, 1 wheel, 2 steered wheel, above: a limb's Swing
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
        if (in_hub.w > 2.5) {  // amplitude in rad, and radians of the swing's phase per metre
            vec2 swing = in_hub.w == PEDALLING_LEG ? vec2(0.24, 1.26) : vec2(in_hub.w == ARM ? -0.3 : 0.42, 4.2);
            roll = sign(in_hub.y) * swing.x * sin(in_motion.y * swing.y);
        }
        float c = cos(roll), s = sin(roll);
        vec3 q = p - in_hub.xyz;
        q = vec3(c * q.x + s * q.z, q.y, c * q.z - s * q.x);
        n = vec3(c * n.x + s * n.z, n.y, c * n.z - s * n.x);
        if (in_hub.w == 2.0) {
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
    if (m == CAR_PAINT || m == CLOTHING) colour *= in_paint.rgb * in_paint.rgb;
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
""")

VEHICLE_FRAGMENT: Final = included("""#include HEAD OUTPUT LIT MIRROR
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
""")

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
