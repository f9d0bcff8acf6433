"""The static scene on the graphics card, in square chunks so that only what is in view is drawn."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import moderngl
import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Rows
from siren_ros.base.numerics.units import NS_PER_S, time_ns_of_step
from siren_ros.sensing.camera import shaders
from siren_ros.sensing.camera.culling import (
    Horizon,
    IndexedMesh,
    bounding_circles,
    chunks_in_view,
    index_mesh,
    visible_triangles,
)
from siren_ros.sensing.camera.surface_light import (
    STATIC_FORMAT,
    STATIC_NAMES,
    STATIC_VERTEX,
    Shading,
    defined,
    shading_of,
    static_vertices,
)
from siren_ros.sensing.look import Look
from siren_ros.sensing.meshes.mesh import SEMANTIC_CLASS_OF_MATERIAL, SignalLamp, StaticScene

CHUNK_M: Final = 24.0
_SMALLEST_PX: Final = 0.4
"""Triangles smaller than this in the picture are left out: most of them cover no pixel's centre."""
_BLINK_PERIOD_NS: Final = NS_PER_S
"""Period of yellow blinking signals: 60 flashes a minute, half of the time on (MUTCD 4L.01 demands 50–60 a minute)."""


@dataclass(frozen=True)
class _Style:
    """How the triangles of one shading are drawn."""

    fragment: str
    defines: tuple[str, ...] = ()
    reach_m: float = 450.0
    """The triangles are drawn up to this distance; haze hides them beyond."""
    near_focals: float = 0.0
    """Details are drawn up to this many metres per pixel of focal length; 0 where there are none."""
    far_fragment: str | None = None
    """Fragment shader without details, for greater distances; None where it is the same."""
    far_defines: tuple[str, ...] = ()


_STYLE: Final = {
    Shading.GLASS: _Style(
        shaders.GLASS_FRAGMENT, ("NORMAL", "SHADOW"), 220.0, 0.06, shaders.FLAT_FRAGMENT, ("FLAT_MIRROR",)
    ),
    Shading.DETAIL: _Style(shaders.MATTE_FRAGMENT, ("SHADOW",), 220.0),
    Shading.PLAIN: _Style(shaders.MATTE_FRAGMENT, ("SHADOW",)),
    Shading.WALL_SUNNY: _Style(shaders.WALL_FRAGMENT, ("NORMAL", "SHADOW"), near_focals=0.075),
    Shading.WALL_SHADY: _Style(shaders.WALL_FRAGMENT, ("NORMAL",), near_focals=0.075),
    Shading.FOLIAGE: _Style(shaders.FOLIAGE_FRAGMENT, ("SHADOW",), 300.0),
    Shading.PAVING: _Style(shaders.GROUND_FRAGMENT, ("NORMAL", "LIGHT"), near_focals=0.25),
    Shading.GROUND: _Style(shaders.GROUND_FRAGMENT, ("NORMAL", "LIGHT")),
    Shading.BEDROCK: _Style(shaders.GROUND_FRAGMENT, ("NORMAL", "LIGHT")),
}
_DRAWN: Final = (
    (Shading.DETAIL, False),
    (Shading.FOLIAGE, False),
    (Shading.WALL_SUNNY, True),
    (Shading.WALL_SHADY, True),
    (Shading.GLASS, True),
    (Shading.WALL_SUNNY, False),
    (Shading.WALL_SHADY, False),
    (Shading.GLASS, False),
    (Shading.PAVING, True),
    (Shading.PAVING, False),
    (Shading.GROUND, False),
    (Shading.PLAIN, False),
    (Shading.BEDROCK, False),
)
"""Shadings in drawing order, and whether details are drawn. What hides most of the scene comes first."""


class StaticGeometry:
    """The static triangles, sorted by program and chunk, and the lit lamps of signals."""

    def __init__(self, context: moderngl.Context, scene: StaticScene, look: Look, constants: str) -> None:
        """Upload the scene once; ``constants`` is the text that all shaders of a look begin with."""
        self._context = context
        mesh = scene.mesh
        shading = shading_of(mesh.material, mesh.normals, look)
        order, self._first, shadings = _chunked(mesh.vertices_m[mesh.triangles].mean(axis=1), shading)
        corners = mesh.vertices_m[mesh.triangles[order]].astype(np.float64)
        low, high = corners.min(axis=1), corners.max(axis=1)
        starts = self._first[:-1]
        self._low = np.minimum.reduceat(low, starts, axis=0) if len(starts) else np.empty((0, 3))
        self._high = np.maximum.reduceat(high, starts, axis=0) if len(starts) else np.empty((0, 3))
        self._circles = bounding_circles(low, high)
        self._chunk_circles = bounding_circles(self._low, self._high)
        self.horizon = Horizon(mesh)
        """What walls hide from the eye of the last ``select``."""
        kinds = [Shading(code) for code in shadings]
        self._reach = np.array([_STYLE[kind].reach_m for kind in kinds])
        self._distance = np.empty(len(starts))
        normals = mesh.normals[order]
        offset = np.einsum("ij,ij->i", normals.astype(np.float64), corners[:, 0])
        self._planes = np.column_stack((normals, offset)).astype(np.float32)
        sides = corners[:, 1:] - corners[:, :1]
        self._area = (0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)).astype(np.float32)
        indexed = index_mesh(mesh, SEMANTIC_CLASS_OF_MATERIAL)
        self._triangles = np.ascontiguousarray(indexed.triangles[order])
        self._chosen = np.empty_like(self._triangles)
        vertices = static_vertices(indexed.vertices, look)
        self._vertices = context.buffer(vertices.tobytes() or bytes(STATIC_VERTEX.itemsize))
        self._all = context.buffer(self._triangles.tobytes() or bytes(12))
        self._indices = context.buffer(reserve=max(12, self._triangles.nbytes), dynamic=True)
        self.shadow_program = context.program(
            vertex_shader=shaders.STATIC_SHADOW_VERTEX, fragment_shader=shaders.SHADOW_FRAGMENT
        )
        self._programs = [self._program_of(shading, near, constants) for shading, near in _DRAWN]
        self._arrays = [_vertex_array(context, program, self._vertices, self._indices) for program in self._programs]
        near, far = ({shading: row for row, (shading, close) in enumerate(_DRAWN) if close == n} for n in (True, False))
        self._near, self._far = np.array([near.get(kind, 0) for kind in kinds]), np.array([far[kind] for kind in kinds])
        self._near_focals = np.array([_STYLE[kind].near_focals for kind in kinds])
        self._counts = np.zeros(len(_DRAWN), np.int64)
        """Triangles that each program draws next."""
        self._lamps = _Lamps(context, scene.signal_lamps, indexed, look, constants)

    def _program_of(self, shading: Shading, near: bool, constants: str) -> Any:
        style = _STYLE[shading]
        if style.far_fragment is not None and not near:
            fragment, names = style.far_fragment, style.far_defines
        else:
            fragment, names = style.fragment, (*style.defines, *(("NEAR",) if near else ()))
        return _program(self._context, fragment, constants, names)

    @property
    def all_programs(self) -> list[Any]:
        """All programs that need the frame's uniforms."""
        return [*self._programs, self._lamps.program]

    @property
    def heights_m(self) -> tuple[float, float]:
        """Lowest and highest z of the scene."""
        if not len(self._low):
            return 0.0, 1.0
        return float(self._low[:, 2].min()), float(self._high[:, 2].max())

    def shadow_array(self) -> Any:
        """Vertex array of all static triangles with positions only, for the shadow program."""
        return self._context.vertex_array(self.shadow_program, ((self._vertices, "3f 24x", "in_position"),), self._all)

    def draw_shadow(self, array: Any, low_m: Floats, high_m: Floats) -> None:
        """Draw the chunks that overlap a rectangle on the ground, given by corners of shape ``(2,)``."""
        meets = np.all((self._high[:, :2] >= low_m) & (self._low[:, :2] <= high_m), axis=1)
        chunks = np.flatnonzero(meets)
        if len(chunks) == 0:
            return
        commands = np.zeros((len(chunks), 5), np.uint32)
        commands[:, 0] = 3 * (self._first[chunks + 1] - self._first[chunks])
        commands[:, 1] = 1
        commands[:, 2] = 3 * self._first[chunks]
        array.render_indirect(self._context.buffer(commands.tobytes()), moderngl.TRIANGLES, count=len(chunks))

    def select(self, clip_from_map: Floats, eye_m: Floats, focal_px: float) -> None:
        """Select the triangles of the next ``draw``.

        They face the camera and lie in chunks in view; the nearest chunk comes first.
        """
        w, x, y, z = clip_from_map[3], clip_from_map[0], clip_from_map[1], clip_from_map[2]
        planes = np.stack((w + x, w - x, w + y, w - y, w + z))
        eye = np.ascontiguousarray(eye_m)
        chunks_in_view(self._low, self._high, self._reach, planes, eye, self._distance)
        smallest = _SMALLEST_PX / focal_px**2
        self.horizon.look_from(eye, smallest, _STYLE[Shading.WALL_SUNNY].reach_m)
        seen = np.flatnonzero(np.isfinite(self._distance))
        seen = seen[np.argsort(self._distance[seen], kind="stable")]
        draws = np.where(self._distance[seen] < focal_px * self._near_focals[seen], self._near[seen], self._far[seen])
        filled = visible_triangles(
            seen,
            draws,
            self._first,
            self._distance,
            self._planes,
            self._area,
            self._triangles,
            self._circles,
            self._chunk_circles,
            self.horizon.slopes,
            eye,
            smallest,
            self._chosen,
            self._counts,
        )
        self._indices.orphan()
        if filled:
            self._indices.write(self._chosen[:filled].data)

    def draw(self) -> None:
        """Draw the selected triangles."""
        first = 0
        for array, count in zip(self._arrays, 3 * self._counts, strict=True):
            if count:
                array.render(moderngl.TRIANGLES, vertices=int(count), first=first)
            first += int(count)

    def draw_lamps(self, signals: Mapping[str, str], step: int) -> None:
        """Draw the lamps of signals that are lit, over their dark lenses."""
        self._lamps.draw(signals, step)


def _chunked(
    centre: npt.NDArray[np.floating[Any]], shading: npt.NDArray[np.int64]
) -> tuple[Rows, npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Sort triangles by shading and cell.

    It gives their order, the first triangle of each chunk with the end, and the shading of each chunk.
    """
    cell = np.floor(centre[:, :2] / CHUNK_M).astype(np.int64)
    order = np.lexsort((cell[:, 1], cell[:, 0], shading))
    key = np.stack((shading, cell[:, 0], cell[:, 1]), axis=1)[order]
    starts = np.flatnonzero(np.concatenate(([len(key) > 0], np.any(key[1:] != key[:-1], axis=1))))
    return order, np.append(starts, len(key)).astype(np.int64), key[starts, 0]


def _program(context: moderngl.Context, fragment: str, constants: str, names: tuple[str, ...] = ()) -> Any:
    return context.program(
        vertex_shader=defined(shaders.STATIC_VERTEX, constants, *names),
        fragment_shader=defined(fragment, constants, *names),
    )


def _vertex_array(context: moderngl.Context, program: Any, vertices: Any, indices: Any) -> Any:
    """Vertex array with only those attributes that the program uses; compilers remove unused ones."""
    formats = [
        part if name in program else f"{int(part[0]) * int(part[-1] if part[-1].isdigit() else 4)}x"
        for part, name in zip(STATIC_FORMAT.split(), STATIC_NAMES, strict=True)
    ]
    names = [name for name in STATIC_NAMES if name in program]
    return context.vertex_array(program, ((vertices, " ".join(formats), *names),), indices)


class _Lamps:
    """The lit lenses of signals; their buffer changes only when a signal does."""

    def __init__(
        self, context: moderngl.Context, lamps: tuple[SignalLamp, ...], scene: IndexedMesh, look: Look, constants: str
    ) -> None:
        self._lamps = lamps
        parts = [scene.triangles[lamp.start : lamp.stop] for lamp in lamps]
        used, local = np.unique(np.concatenate([np.empty((0, 3), np.uint32), *parts]), return_inverse=True)
        local = local.reshape(-1, 3).astype(np.uint32)
        ends = np.cumsum([0, *(len(part) for part in parts)])
        self._parts = [local[start:end] for start, end in itertools.pairwise(ends)]
        vertices = static_vertices(scene.vertices[used], look, lit=True)
        buffer = context.buffer(vertices.tobytes() or bytes(STATIC_VERTEX.itemsize))
        self._indices = context.buffer(reserve=max(12, local.nbytes))
        self.program = _program(context, shaders.FLAT_FRAGMENT, constants)
        self._array = _vertex_array(context, self.program, buffer, self._indices)
        self._shown: tuple[bool, dict[str, str]] | None = None
        self._count = 0

    def draw(self, signals: Mapping[str, str], step: int) -> None:
        dark = time_ns_of_step(step) % _BLINK_PERIOD_NS >= _BLINK_PERIOD_NS // 2
        if self._shown != (dark, signals):
            states = [(lamp, signals.get(lamp.signal_id, "")) for lamp in self._lamps]
            shown = (lamp.is_lit(state) and not (dark and state[lamp.link] == "o") for lamp, state in states)
            lit = [part for part, shines in zip(self._parts, shown, strict=True) if shines]
            if lit:
                self._indices.write(np.concatenate(lit).tobytes())
            self._shown, self._count = (dark, dict(signals)), 3 * sum(len(part) for part in lit)
        if self._count:
            self._array.render(moderngl.TRIANGLES, vertices=self._count)
