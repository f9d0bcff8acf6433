"""Draws the scene from a camera and returns the pixels, through an OpenGL context without a window.

It draws to framebuffers of its own, while the caller does something else. Rain drops are streaks over the picture;
labels and depth do not show them.
"""

import ctypes
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import glcontext
import moderngl
import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Floats32, Matrix, Rows
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import SirenError
from siren_ros.sensing.camera import shaders as sky_shaders
from siren_ros.sensing.camera.culling import Horizon
from siren_ros.sensing.camera.ground_light import GroundLight, LampLight, LightMap
from siren_ros.sensing.camera.shaders import HEAD, LIGHT_PLACE, included
from siren_ros.sensing.camera.static_geometry import StaticGeometry
from siren_ros.sensing.camera.surface_light import defined, preamble
from siren_ros.sensing.camera.vehicle_geometry import VehicleGeometry
from siren_ros.sensing.look import Look
from siren_ros.sensing.meshes.mesh import SemanticClass, StaticScene, VehiclePlacement, VehicleShape
from siren_ros.sensing.specification import optical_from_map
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import CameraIntrinsics

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


_MESA: Final = {"mesa_glthread": "true", "MESA_DEBUG": "silent"}
"""Mesa options (docs.mesa3d.org/envvars.html). Its own thread for commands keeps software drawing from holding the
interpreter's lock; silent, because Mesa would report the changed option on stderr."""


@dataclass(frozen=True, eq=False)
class RenderedImage:
    """One picture and, where asked for, its labels, all from one draw; row 0 is the top."""

    rgba: npt.NDArray[np.uint8]
    """Colour; the fourth channel is the semantic class (CARLA's numbers). Shape ``(height, width, 4)``."""
    instance: npt.NDArray[np.uint32] | None
    """Actor id per pixel, 0 where no vehicle is; shape ``(height, width)``."""
    depth_m: Floats32 | None
    """Distance along the optical axis, 0 in the sky; shape ``(height, width)``."""

    @property
    def semantic(self) -> npt.NDArray[np.uint8]:
        """Semantic classes, shape ``(height, width)``."""
        return self.rgba[..., 3]


class RendererUnavailableError(SirenError):
    """Raised where the machine has no OpenGL 3.3 through EGL."""


class DrawingContext:
    """An OpenGL context without a window. Only the thread that makes it may use it."""

    def __init__(self) -> None:
        """Open the context; RendererUnavailableError says what to install where EGL or OpenGL is missing."""
        try:
            with _set_where_unset(_MESA):
                backend = glcontext.get_backend_by_name("egl")(mode="standalone", glversion=330)
            options: dict[str, Any] = {"require": 330, "context": backend}
            self.gl: moderngl.Context = moderngl.create_context(**options)
        except Exception as error:  # moderngl and glcontext raise a bare Exception where libEGL is absent
            message = f"cameras need OpenGL 3.3 through EGL (Debian: libegl1 and libgl1-mesa-dri): {error}"
            raise RendererUnavailableError(message) from error
        self._flush = ctypes.CFUNCTYPE(None)(backend.load("glFlush"))
        self._present = ctypes.CFUNCTYPE(ctypes.c_void_p)(backend.load("eglGetCurrentContext"))
        self._handle = self._present()

    def use(self) -> None:
        """Make this the thread's current context.

        It does nothing if it is current already: a switch waits for all drawing.
        """
        if self._present() != self._handle:
            self.gl.mglo.__enter__()

    def flush(self) -> None:
        """Start all pending drawing and do not wait for it."""
        self._flush()


@contextmanager
def _set_where_unset(variables: dict[str, str]) -> Iterator[None]:
    added = [name for name in variables if name not in os.environ]
    os.environ.update({name: variables[name] for name in added})
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


class Target:
    """Framebuffers for one picture size; label images are attached only when requested."""

    def __init__(self, context: moderngl.Context, width: int, height: int) -> None:
        """Allocate memory for a picture and its labels."""
        size = (width, height)
        self._colour = context.texture(size, 4)
        self._actor = context.texture(size, 1, dtype="u4")
        self._depth = context.texture(size, 1, dtype="f4")
        buffer = context.depth_renderbuffer(size)
        self.plain = context.framebuffer([self._colour], buffer)
        self.instances = context.framebuffer([self._colour, self._actor], buffer)
        self.labelled = context.framebuffer([self._colour, self._actor, self._depth], buffer)
        self._shape = (height, width)

    def read(self, *, instances: bool, depth: bool) -> RenderedImage:
        """Wait for the drawing; return its pixels, with the labels that were drawn."""
        rgba = np.empty((*self._shape, 4), np.uint8)
        self.plain.read_into(rgba, components=4, alignment=1)
        actor = depth_m = None
        if instances:
            actor = np.empty(self._shape, np.uint32)
            self.instances.read_into(actor, components=1, attachment=1, dtype="u4", alignment=1)
        if depth:
            depth_m = np.empty(self._shape, np.float32)
            self.labelled.read_into(depth_m, components=1, attachment=2, dtype="f4", alignment=1)
        return RenderedImage(rgba, actor, depth_m)


NEAR_M: Final = 0.1
FAR_M: Final = 700.0
_REACH_M: Final = 450.0
"""Vehicles farther away than this are not drawn, because haze hides them."""
_NOISE_TEXELS: Final = 512
_SMOOTH: Final = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)
_COARSE: Final = (moderngl.NEAREST_MIPMAP_NEAREST, moderngl.NEAREST)
"""Cheap texture filters for the noise; the nearest texel looks as good as a mean of four."""
_SKY_TEXELS: Final = 1024
_FRAME_FLOATS: Final = 3 * 16 + 4 * 4
_SIDES: Final = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
"""Planes of the view frustum in clip coordinates: left, right, bottom, top, near."""


class Renderer:
    """Draws one scene for any number of cameras. Only the thread that makes it may use it."""

    def __init__(
        self, static: StaticScene, shapes: Mapping[ActorClass, VehicleShape], look: Look | None = None
    ) -> None:
        """Open a context and upload the scene; RendererUnavailableError on machines without OpenGL through EGL."""
        self._drawing = DrawingContext()
        self._context = context = self._drawing.gl
        self.look = look or Look()
        constants = preamble(self.look)
        self._static = StaticGeometry(context, static, self.look, constants)
        self._ground: GroundLight | LampLight
        if self.look.lamps_lit:
            self._ground = LampLight(context, static.mesh)
        else:
            self._ground = GroundLight(context, self._static, self.look.towards_sun)
        self._vehicles = VehicleGeometry(context, shapes, constants)
        self._last: Callable[[Any], None] = lambda _plain: None
        self._placed: tuple[VehiclePlacement, Floats] | None = None
        self._sky_program = context.program(
            vertex_shader=defined(sky_shaders.SKY_VERTEX, constants),
            fragment_shader=defined(sky_shaders.SKY_FRAGMENT, constants),
        )
        self._sky = context.vertex_array(self._sky_program, ())
        self._skies: dict[float, moderngl.Texture] = {}
        self._noise = _noise_texture(context)
        self._frame = context.buffer(reserve=4 * _FRAME_FLOATS)
        self._targets: dict[tuple[int, int], list[Target]] = {}
        """Targets of each size that no picture is being drawn to."""
        self._rain = Rain(context, self.look) if self.look.rain_mm_per_h > 0.0 else None
        rain = (self._rain.program,) if self._rain is not None else ()
        for program in [*rain, *self._static.all_programs, self._vehicles.program, self._sky_program]:
            _bind(program)
        context.front_face = "cw"

    @property
    def device(self) -> str:
        """Name of the graphics device, as OpenGL reports it."""
        return str(self._context.info["GL_RENDERER"])

    def render(self, *arguments: Any, **options: Any) -> RenderedImage:
        """Draw one picture and wait for it; the arguments are those of ``begin``."""
        return self.begin(*arguments, **options)()

    def begin(
        self,
        camera: CameraIntrinsics,
        map_from_camera: Matrix,
        placement: VehiclePlacement,
        rolled_m: Floats,
        signals: Mapping[str, str],
        step: int,
        exposure: float = 1.0,
        labels: bool = False,
        instances: bool = False,
    ) -> Callable[[], RenderedImage]:
        """Begin one picture from a pose of the camera's body frame (x forward), shape ``(4, 4)``.

        The drawing goes on while the caller does something else. The returned function waits for it and returns the
        picture. Call it once. ``rolled_m`` is how far each vehicle's wheels have rolled, shape ``(N,)``; ``signals``
        the state string of each signal; the simulated time of ``step`` drives blinking lights; ``exposure`` is a factor
        on all light. ``labels`` asks for instances and depth with the picture, ``instances`` for instances alone.
        """
        self._drawing.use()  # other renderers of this thread have contexts of their own
        clip = camera.clip_from_optical(NEAR_M, FAR_M) @ optical_from_map(map_from_camera)
        textures = self._prepare(camera, clip, map_from_camera, placement, rolled_m, step, exposure)
        rows = _nearest_in_view(clip, map_from_camera[:3, 3], placement, self._static.horizon)
        target = self._take_target(camera)
        (target.labelled if labels else target.instances if instances else target.plain).use()
        self._last = partial(self._draw, rows, textures, signals, step)
        self._last(target.plain)
        self._drawing.flush()
        return partial(self._finish, camera, target, instances=labels or instances, depth=labels)

    def _finish(self, camera: CameraIntrinsics, target: Target, *, instances: bool, depth: bool) -> RenderedImage:
        self._drawing.use()
        image = target.read(instances=instances, depth=depth)
        self._targets[camera.width, camera.height].append(target)
        return image

    def draw_again(self, camera: CameraIntrinsics) -> RenderedImage:
        """Draw the last picture of this camera once more and read it back: a reference for the time of ``render``."""
        self._drawing.use()
        target = self._take_target(camera)
        target.plain.use()
        self._last(target.plain)
        return self._finish(camera, target, instances=False, depth=False)

    def _prepare(
        self,
        camera: CameraIntrinsics,
        clip: Matrix,
        map_from_camera: Matrix,
        placement: VehiclePlacement,
        rolled_m: Floats,
        step: int,
        exposure: float,
    ) -> tuple[Any, ...]:
        """Prepare vehicles, light and uniforms for a frame; returns the textures by slot."""
        eye = map_from_camera[:3, 3]
        if self._placed is None or self._placed[0] is not placement or self._placed[1] is not rolled_m:
            self._vehicles.place(placement, rolled_m)
            self._placed = (placement, rolled_m)
        light = self._ground.update(eye, placement, self._vehicles, step)
        self._drawing.flush()  # The graphics card draws shadows while the processor chooses what is in view.
        self._write_frame(clip, map_from_camera, camera, light, step, exposure)
        sky = self._skies.get(exposure) or self._paint_sky(exposure)
        self._static.select(clip, eye, camera.focal_x_px)
        return light.shadow, light.ground, self._noise, sky

    def _draw(self, rows: Rows, textures: tuple[Any, ...], signals: Mapping[str, str], step: int, plain: Any) -> None:
        """Draw the selected scene and the vehicles of these rows; rain only into framebuffers without labels."""
        context = self._context
        context.fbo.clear(depth=1.0)
        context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        context.depth_func = "<="
        self._frame.bind_to_uniform_block(0)
        for slot, texture in enumerate(textures):
            if texture is not None:
                texture.use(slot)
        self._vehicles.draw(rows)
        self._static.draw()
        self._static.draw_lamps(signals, step)
        context.enable_only(moderngl.DEPTH_TEST)
        self._sky.render(moderngl.TRIANGLES, vertices=3)
        if self._rain is not None:
            self._rain.draw(plain, step)

    def _paint_sky(self, exposure: float) -> moderngl.Texture:
        """Paint the sky for an exposure, once; pictures look it up by direction.

        The frame's uniforms must be set before.
        """
        context = self._context
        constants = preamble(self.look)
        program = context.program(
            vertex_shader=defined(sky_shaders.SKY_VERTEX, constants),
            fragment_shader=defined(sky_shaders.SKY_PAINT_FRAGMENT, constants),
        )
        _bind(program)
        sky = context.texture((_SKY_TEXELS, _SKY_TEXELS), 4)
        sky.filter = (moderngl.LINEAR, moderngl.LINEAR)
        context.framebuffer([sky]).use()
        context.enable_only(moderngl.NOTHING)
        self._frame.bind_to_uniform_block(0)
        self._noise.use(2)
        self._noise.filter = _SMOOTH
        context.vertex_array(program, ()).render(moderngl.TRIANGLES, vertices=3)
        self._noise.filter = _COARSE
        self._skies[exposure] = sky
        return sky

    def _take_target(self, camera: CameraIntrinsics) -> Target:
        """Take a target that no picture uses at the moment; ``_finish`` gives it back."""
        free = self._targets.setdefault((camera.width, camera.height), [])
        return free.pop() if free else Target(self._context, camera.width, camera.height)

    def _write_frame(
        self,
        clip: Matrix,
        map_from_camera: Matrix,
        camera: CameraIntrinsics,
        light: LightMap,
        step: int,
        exposure: float,
    ) -> None:
        matrices = (clip, np.linalg.inv(clip), light.unit_from_map)
        vectors = (
            (*map_from_camera[:3, 3], step * STEP_S),
            (*map_from_camera[:3, 0], camera.focal_x_px),
            (*light.light_from_map, 0.0),
            (camera.width / 2.0, camera.height / 2.0, exposure, 0.0),
        )
        columns = [matrix.T.ravel() for matrix in matrices]
        self._frame.write(np.concatenate([*columns, np.ravel(vectors)]).astype(np.float32).tobytes())


def _nearest_in_view(clip_from_map: Matrix, eye_m: Floats, placement: VehiclePlacement, horizon: Horizon) -> Rows:
    """Rows of the vehicles in view, nearest first.

    Their bounding sphere meets the view frustum and is not hidden by walls.
    """
    middle = placement.z_m + placement.size_m[:, 2] / 2.0
    centre = np.stack((placement.x_m, placement.y_m, middle, np.ones(len(placement))), axis=1)
    radius = np.linalg.norm(placement.size_m, axis=1) / 2.0
    distance = placement.distance_m(eye_m[0], eye_m[1])
    inside = distance < _REACH_M
    planes = clip_from_map[3] + _SIDES @ clip_from_map[:3]
    inside &= (centre @ planes.T > -radius[:, None] * np.linalg.norm(planes[:, :3], axis=1)).all(axis=1)
    rows = np.flatnonzero(inside)
    top = placement.z_m + placement.size_m[:, 2]
    circles = np.column_stack((centre[:, :2], radius, placement.z_m, top)).astype(np.float32)
    rows = rows[horizon.visible(eye_m, circles[rows])]
    return rows[np.argsort(distance[rows], kind="stable")]


def _bind(program: Any) -> None:
    """Connect a program's uniform blocks and samplers to the slots that all pictures share; set the sky's class."""
    if "Frame" in program:
        program["Frame"].binding = 0
    slots = {"static_shadow": 0, "ground_light": 1, "noise": 2, "sky": 3, "semantic": int(SemanticClass.SKY) / 255.0}
    for name in slots.keys() & set(program):
        program[name].value = slots[name]


def _noise_texture(context: moderngl.Context) -> moderngl.Texture:
    """Tileable noise of several octaves, mean 0.5, with mipmaps; the same on every run."""
    rng = np.random.Generator(np.random.PCG64(7))
    frequency = np.fft.fftfreq(_NOISE_TEXELS)
    radius = np.hypot(*np.meshgrid(frequency, frequency))
    radius[0, 0] = 1.0
    spectrum = np.fft.fft2(rng.standard_normal((_NOISE_TEXELS, _NOISE_TEXELS))) / radius**0.9
    spectrum[0, 0] = 0.0
    values = np.fft.ifft2(spectrum).real
    values = np.clip(0.5 + 0.18 * values / values.std(), 0.0, 1.0)
    texels = np.repeat((255 * values).astype(np.uint8)[..., None], 4, axis=2)  # software drivers sample RGBA8 fastest
    texture = context.texture((_NOISE_TEXELS, _NOISE_TEXELS), 4, texels.tobytes())
    texture.build_mipmaps()
    texture.filter = _COARSE
    texture.repeat_x = texture.repeat_y = True
    return texture
