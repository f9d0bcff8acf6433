"""Draws the scene from a camera and hands the pixels back."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import moderngl
import numpy as np
import numpy.typing as npt

from siren_ros.sensors.camera_model import Pinhole, optical_from_map
from siren_ros.sensors.mount import Matrix
from siren_ros.sensors.placement import Placement
from siren_ros.sensors.render import shaders
from siren_ros.sensors.render.context import open_context
from siren_ros.sensors.render.look import Look
from siren_ros.sensors.render.shadows import ShadowMap, ShadowView, sun_view
from siren_ros.sensors.render.static_geometry import Shading, StaticGeometry
from siren_ros.sensors.render.vehicle_geometry import VehicleGeometry
from siren_ros.sensors.scene.material import SemanticClass
from siren_ros.sensors.scene.mesh import StaticScene, VehicleShape
from siren_ros.world.actors import ActorClass
from siren_ros.world.units import STEP_S

NEAR_M: Final = 0.1
FAR_M: Final = 700.0
_REACH_M: Final = 450.0
"""Vehicles further away than this are left to the haze."""
_STATIC_SHADOW_TEXELS: Final = 2048
_STATIC_SHADOW_HALF_M: Final = 120.0
_STATIC_SHADOW_GRID_M: Final = 40.0
_VEHICLE_SHADOW_TEXELS: Final = 1024
_VEHICLE_SHADOW_HALF_M: Final = 50.0
_VEHICLE_SHADOW_AHEAD_M: Final = 25.0
_TALLEST_VEHICLE_M: Final = 5.0
_NOISE_TEXELS: Final = 256
_SKY_TEXELS: Final = 1024
_FRAME_FLOATS: Final = 4 * 16 + 6 * 4


@dataclass(frozen=True, eq=False)
class RenderedImage:
    """One picture and, where asked for, its labels, all from one draw; row 0 is the top."""

    rgba: npt.NDArray[np.uint8]
    """Colour, and the semantic class (CARLA's numbers) in the fourth channel, shape ``(height, width, 4)``."""
    instance: npt.NDArray[np.uint32] | None
    """Actor id, 0 off vehicles, shape ``(height, width)``."""
    depth_m: npt.NDArray[np.float32] | None
    """Along the optical axis, 0 where there is sky, shape ``(height, width)``."""

    @property
    def semantic(self) -> npt.NDArray[np.uint8]:
        """Semantic classes, shape ``(height, width)``."""
        return self.rgba[..., 3]


class _Target:
    """Framebuffers of one picture size; labels are attached only where they are asked for."""

    def __init__(self, context: moderngl.Context, width: int, height: int) -> None:
        size = (width, height)
        self._colour = context.texture(size, 4)
        self._actor = context.texture(size, 1, dtype="u4")
        self._depth = context.texture(size, 1, dtype="f4")
        buffer = context.depth_renderbuffer(size)
        self.plain = context.framebuffer([self._colour], buffer)
        self.labelled = context.framebuffer([self._colour, self._actor, self._depth], buffer)
        self._shape = (height, width)

    def read(self, labels: bool) -> RenderedImage:
        rgba = np.empty((*self._shape, 4), np.uint8)
        self.plain.read_into(rgba, components=4, alignment=1)
        if not labels:
            return RenderedImage(rgba, None, None)
        actor = np.empty(self._shape, np.uint32)
        depth = np.empty(self._shape, np.float32)
        self.labelled.read_into(actor, components=1, attachment=1, dtype="u4", alignment=1)
        self.labelled.read_into(depth, components=1, attachment=2, dtype="f4", alignment=1)
        return RenderedImage(rgba, actor, depth)


class Renderer:
    """One scene, any number of cameras. Belongs to the thread that makes it."""

    def __init__(
        self, static: StaticScene, shapes: Mapping[ActorClass, VehicleShape], look: Look | None = None
    ) -> None:
        """Open a context and upload the scene.

        Raises:
            RendererUnavailableError: no OpenGL through EGL on this machine.
        """
        self._context = context = open_context()
        self.look = look or Look()
        self._static = StaticGeometry(context, static)
        self._vehicles = VehicleGeometry(context, shapes)
        self._sky_program = context.program(vertex_shader=shaders.SKY_VERTEX, fragment_shader=shaders.SKY_FRAGMENT)
        _set(self._sky_program, "semantic", int(SemanticClass.SKY) / 255.0)
        self._sky = context.vertex_array(self._sky_program, ())
        self._sky_texture: moderngl.Texture | None = None
        self._shadow_program = context.program(
            vertex_shader=shaders.STATIC_SHADOW_VERTEX, fragment_shader=shaders.SHADOW_FRAGMENT
        )
        self._shadow_array = self._static.shadow_array(self._shadow_program)
        self._static_shadow = ShadowMap(context, _STATIC_SHADOW_TEXELS)
        self._vehicle_shadow = ShadowMap(context, _VEHICLE_SHADOW_TEXELS)
        self._static_view: ShadowView | None = None
        self._static_cell: tuple[int, int] | None = None
        self._noise = _noise_texture(context)
        self._frame = context.buffer(reserve=4 * _FRAME_FLOATS)
        self._targets: dict[tuple[int, int], _Target] = {}
        for program in [*self._static.all_programs, self._vehicles.program, self._sky_program]:
            _bind(program)
        context.front_face = "cw"

    @property
    def device(self) -> str:
        """What draws: the name that OpenGL gives its renderer."""
        return str(self._context.info["GL_RENDERER"])

    def render(
        self,
        camera: Pinhole,
        map_from_camera: Matrix,
        placement: Placement,
        rolled_m: npt.NDArray[np.float64],
        signals: Mapping[str, str],
        step: int,
        exposure: float = 1.0,
        labels: bool = False,
    ) -> RenderedImage:
        """One picture from a pose of the camera's body frame (x forward), shape ``(4, 4)``.

        Args:
            camera: Intrinsics.
            map_from_camera: Pose.
            placement: Vehicles.
            rolled_m: Distance that each vehicle's wheels have rolled, shape ``(N,)``.
            signals: State string of each signal.
            step: Step whose simulated time drives blinking lights.
            exposure: Factor on all light.
            labels: Whether to hand back instances and depth too.
        """
        eye = map_from_camera[:3, 3]
        forward = map_from_camera[:3, 0]
        clip = camera.clip_from_optical(NEAR_M, FAR_M) @ optical_from_map(map_from_camera)
        distance = placement.distance_m(eye[0], eye[1])
        seen = (distance < _REACH_M) & _in_view(clip, placement)
        shading = distance < _VEHICLE_SHADOW_AHEAD_M + 1.5 * _VEHICLE_SHADOW_HALF_M
        self._vehicles.place(placement, rolled_m, seen, shading)
        self._update_static_shadow(eye)
        vehicle_view = self._draw_vehicle_shadow(eye, forward)
        self._write_frame(clip, eye, forward, camera, vehicle_view, step, exposure)
        target = self._target(camera)
        sky = self._sky_texture or self._paint_sky()
        sky.use(3)
        (target.labelled if labels else target.plain).use()
        self._draw(self._static.visible(clip, eye), signals, step)
        return target.read(labels)

    def _paint_sky(self) -> moderngl.Texture:
        """Paint the sky once; pictures look it up by direction."""
        context = self._context
        program = context.program(vertex_shader=shaders.SKY_VERTEX, fragment_shader=shaders.SKY_PAINT_FRAGMENT)
        _bind(program)
        self._sky_texture = context.texture((_SKY_TEXELS, _SKY_TEXELS), 4, dtype="f2")
        self._sky_texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        context.framebuffer([self._sky_texture]).use()
        context.enable_only(moderngl.NOTHING)
        self._frame.bind_to_uniform_block(0)
        self._noise.use(2)
        context.vertex_array(program, ()).render(moderngl.TRIANGLES, vertices=3)
        return self._sky_texture

    def _target(self, camera: Pinhole) -> _Target:
        size = (camera.width, camera.height)
        if size not in self._targets:
            self._targets[size] = _Target(self._context, *size)
        return self._targets[size]

    def _draw(self, chunks: npt.NDArray[np.intp], signals: Mapping[str, str], step: int) -> None:
        context = self._context
        context.fbo.clear(depth=1.0)
        context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        context.depth_func = "<="
        self._frame.bind_to_uniform_block(0)
        self._static_shadow.texture.use(0)
        self._vehicle_shadow.texture.use(1)
        self._noise.use(2)
        self._vehicles.draw()
        for shading in Shading:
            self._static.draw(chunks, shading)
        self._static.draw_lamps(signals, step)
        context.enable_only(moderngl.DEPTH_TEST)
        self._sky.render(moderngl.TRIANGLES, vertices=3)

    def _update_static_shadow(self, eye: npt.NDArray[np.float64]) -> None:
        """Redraw the static shadow map when the camera enters another cell: a pure function of its position."""
        cell = (round(eye[0] / _STATIC_SHADOW_GRID_M), round(eye[1] / _STATIC_SHADOW_GRID_M))
        if cell == self._static_cell:
            return
        centre = (cell[0] * _STATIC_SHADOW_GRID_M, cell[1] * _STATIC_SHADOW_GRID_M)
        heights = self._static.heights_m
        view = sun_view(self.look.towards_sun, centre, _STATIC_SHADOW_HALF_M, heights)
        reach = _STATIC_SHADOW_HALF_M + (heights[1] - heights[0]) / max(float(self.look.towards_sun[2]), 0.1)
        chunks = self._static.chunks_near(np.array(centre) - reach, np.array(centre) + reach)
        self._static_shadow.begin(self._shadow_program, view)
        self._static.draw_array(self._shadow_array, chunks)
        self._static_shadow.end()
        self._static_view, self._static_cell = view, cell

    def _draw_vehicle_shadow(self, eye: npt.NDArray[np.float64], forward: npt.NDArray[np.float64]) -> ShadowView:
        centre = (
            float(eye[0] + _VEHICLE_SHADOW_AHEAD_M * forward[0]),
            float(eye[1] + _VEHICLE_SHADOW_AHEAD_M * forward[1]),
        )
        view = sun_view(self.look.towards_sun, centre, _VEHICLE_SHADOW_HALF_M, (-1.0, _TALLEST_VEHICLE_M))
        self._vehicle_shadow.begin(self._vehicles.shadow_program, view)
        self._vehicles.draw_shadows()
        self._vehicle_shadow.end()
        return view

    def _write_frame(
        self,
        clip: Matrix,
        eye: npt.NDArray[np.float64],
        forward: npt.NDArray[np.float64],
        camera: Pinhole,
        vehicle_view: ShadowView,
        step: int,
        exposure: float,
    ) -> None:
        look = self.look
        static_view = self._static_view or vehicle_view
        matrices = (clip, np.linalg.inv(clip), static_view.unit_from_map, vehicle_view.unit_from_map)
        vectors = (
            (*eye, step * STEP_S),
            (*forward, 1.0 / camera.focal_px),
            (*look.towards_sun, exposure),
            (*look.sun_colour, look.ambient),
            (*look.zenith_colour, look.haze_per_m),
            (*look.horizon_colour, look.cloud_cover),
        )
        columns = [matrix.T.ravel() for matrix in matrices]
        self._frame.write(np.concatenate([*columns, np.ravel(vectors)]).astype(np.float32).tobytes())


def _in_view(clip_from_map: Matrix, placement: Placement) -> npt.NDArray[np.bool_]:
    """Whether each vehicle's bounding sphere reaches into the view frustum, shape ``(N,)``."""
    middle = placement.z_m + placement.size_m[:, 2] / 2.0
    centre = np.stack((placement.x_m, placement.y_m, middle, np.ones(len(placement))), axis=1)
    radius = np.linalg.norm(placement.size_m, axis=1) / 2.0
    inside = np.ones(len(placement), dtype=np.bool_)
    for row, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0)):
        plane = clip_from_map[3] + sign * clip_from_map[row]
        inside &= centre @ plane > -radius * np.linalg.norm(plane[:3])
    return inside


def _bind(program: Any) -> None:
    """Connect a program's blocks and samplers to the slots that every picture uses."""
    program["Frame"].binding = 0
    for name, slot in (("static_shadow", 0), ("vehicle_shadow", 1), ("noise", 2), ("sky", 3)):
        if name in program:
            _set(program, name, slot)


def _set(program: Any, name: str, value: float) -> None:
    program[name].value = value


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
    texture = context.texture((_NOISE_TEXELS, _NOISE_TEXELS), 1, (255 * values).astype(np.uint8).tobytes())
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = True
    return texture
