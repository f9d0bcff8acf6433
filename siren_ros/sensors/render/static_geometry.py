"""The static scene on the graphics card, in square chunks so that only what is in view is drawn."""

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Final

import moderngl
import numpy as np
import numpy.typing as npt

from siren_ros.sensors.render import shaders
from siren_ros.sensors.render.vertices import VERTEX, VERTEX_FORMAT, VERTEX_NAMES, IndexedMesh, index_mesh
from siren_ros.sensors.scene.material import SEMANTIC_CLASS_OF_MATERIAL
from siren_ros.sensors.scene.mesh import Material, SignalLamp, StaticScene
from siren_ros.world.units import NS_PER_S, time_ns_of_step

CHUNK_M: Final = 24.0
_BLINK_PERIOD_NS: Final = NS_PER_S
"""Yellow blinking signals: 60 flashes a minute, half on and half off (MUTCD 4L.01 demands 50–60 a minute)."""

Floats = npt.NDArray[np.float64]


class Shading(IntEnum):
    """Programs of the static scene, in drawing order: what hides most comes first, what is widest last."""

    DETAIL = 0
    """Windows, poles, lamps: not drawn where they are smaller than a pixel or two."""
    PLAIN = 1
    FACADE = 2
    FOLIAGE = 3
    GROUND = 4


_FRAGMENT: Final = {
    Shading.DETAIL: shaders.PLAIN_FRAGMENT,
    Shading.PLAIN: shaders.PLAIN_FRAGMENT,
    Shading.FACADE: shaders.FACADE_FRAGMENT,
    Shading.FOLIAGE: shaders.FOLIAGE_FRAGMENT,
    Shading.GROUND: shaders.GROUND_FRAGMENT,
}
_REACH_M: Final = np.array([220.0, 450.0, 450.0, 300.0, 450.0])
"""Distance up to which each program's triangles are drawn; beyond lies haze."""
_DETAIL: Final = (
    Material.BUILDING_GLASS,
    Material.METAL_POLE,
    Material.SIGNAL_HOUSING,
    Material.SIGNAL_RED,
    Material.SIGNAL_YELLOW,
    Material.SIGNAL_GREEN,
    Material.STOP_SIGN,
    Material.STREET_LAMP,
    Material.TREE_TRUNK,
    Material.FENCE,
)
_GROUND: Final = (
    Material.GROUND,
    Material.GRASS,
    Material.ASPHALT,
    Material.SHOULDER_ASPHALT,
    Material.MARKING_WHITE,
    Material.MARKING_YELLOW,
    Material.KERB,
    Material.SIDEWALK,
    Material.MEDIAN,
)


def _shading_of_material() -> npt.NDArray[np.uint8]:
    table = np.full(len(Material), int(Shading.PLAIN), np.uint8)
    table[[int(material) for material in _DETAIL]] = int(Shading.DETAIL)
    table[[int(material) for material in _GROUND]] = int(Shading.GROUND)
    table[int(Material.BUILDING_WALL)] = int(Shading.FACADE)
    table[int(Material.FOLIAGE)] = int(Shading.FOLIAGE)
    return table


class StaticGeometry:
    """Static triangles sorted by program and chunk, and the signals' lamps that shine."""

    def __init__(self, context: moderngl.Context, scene: StaticScene) -> None:
        """Upload the scene once."""
        self._context = context
        mesh = scene.mesh
        centre = mesh.vertices_m[mesh.triangles].mean(axis=1)
        cell = np.floor(centre[:, :2] / CHUNK_M).astype(np.int64)
        shading = _shading_of_material()[mesh.material].astype(np.int64)
        key = np.stack((shading, cell[:, 0], cell[:, 1]), axis=1)
        order = np.lexsort((cell[:, 1], cell[:, 0], shading))
        key = key[order]
        starts = np.flatnonzero(np.concatenate(([len(key) > 0], np.any(key[1:] != key[:-1], axis=1))))
        corners = mesh.vertices_m[mesh.triangles[order]]
        self._low = np.minimum.reduceat(corners.min(axis=1), starts, axis=0) if len(starts) else np.empty((0, 3))
        self._high = np.maximum.reduceat(corners.max(axis=1), starts, axis=0) if len(starts) else np.empty((0, 3))
        self._first = (3 * starts).astype(np.uint32)
        self._count = (3 * np.diff(np.append(starts, len(key)))).astype(np.uint32)
        self._shading = key[starts, 0]
        indexed = index_mesh(mesh, SEMANTIC_CLASS_OF_MATERIAL)
        self._vertices = context.buffer(indexed.vertices.tobytes() or bytes(VERTEX.itemsize))
        self._indices = context.buffer(np.ascontiguousarray(indexed.triangles[order]).tobytes() or bytes(12))
        self.programs = {
            shading: context.program(vertex_shader=shaders.STATIC_VERTEX, fragment_shader=fragment)
            for shading, fragment in _FRAGMENT.items()
        }
        names = ((self._vertices, VERTEX_FORMAT, *VERTEX_NAMES),)
        self._arrays = {
            shading: context.vertex_array(program, names, self._indices) for shading, program in self.programs.items()
        }
        self._indirect = context.buffer(reserve=20 * max(1, len(self._first)))
        self._lamps = _Lamps(context, scene.signal_lamps, indexed, self._vertices)

    @property
    def all_programs(self) -> list[Any]:
        """Every program that needs the frame's uniforms."""
        return [*self.programs.values(), self._lamps.program]

    @property
    def heights_m(self) -> tuple[float, float]:
        """Lowest and highest z of the scene."""
        if not len(self._low):
            return 0.0, 1.0
        return float(self._low[:, 2].min()), float(self._high[:, 2].max())

    def shadow_array(self, program: Any) -> Any:
        """All static triangles, positions alone, for a shadow program."""
        return self._context.vertex_array(program, ((self._vertices, "3f 12x", "in_position"),), self._indices)

    def visible(self, clip_from_map: Floats, eye_m: Floats) -> npt.NDArray[np.intp]:
        """Chunks within the view frustum and their program's reach, nearest first."""
        nearest = np.clip(eye_m, self._low, self._high)
        distance = np.linalg.norm(nearest - eye_m, axis=1)
        inside = distance < _REACH_M[self._shading]
        for sign in (1.0, -1.0):
            for row in range(2):
                plane = clip_from_map[3] + sign * clip_from_map[row]
                inside &= _reaches(plane, self._low, self._high)
        inside &= _reaches(clip_from_map[3] + clip_from_map[2], self._low, self._high)
        chosen = np.flatnonzero(inside)
        return chosen[np.argsort(distance[chosen], kind="stable")]

    def chunks_near(self, low_m: Floats, high_m: Floats) -> npt.NDArray[np.intp]:
        """Chunks that meet a rectangle of the ground, corners of shape ``(2,)``."""
        return np.flatnonzero(np.all((self._high[:, :2] >= low_m) & (self._low[:, :2] <= high_m), axis=1))

    def commands(self, chunks: npt.NDArray[np.intp]) -> npt.NDArray[np.uint32]:
        """Indirect draw commands (``DrawElementsIndirectCommand``) of chunks, shape ``(K, 5)``."""
        commands = np.zeros((len(chunks), 5), np.uint32)
        commands[:, 0] = self._count[chunks]
        commands[:, 1] = 1
        commands[:, 2] = self._first[chunks]
        return commands

    def draw(self, chunks: npt.NDArray[np.intp], only: Shading) -> None:
        """Draw the chunks of one program."""
        self.draw_array(self._arrays[only], chunks[self._shading[chunks] == only])

    def draw_array(self, array: Any, chunks: npt.NDArray[np.intp]) -> None:
        """Draw chunks with a vertex array over this scene's buffer."""
        if len(chunks) == 0:
            return
        self._indirect.write(self.commands(chunks).tobytes())
        array.render_indirect(self._indirect, moderngl.TRIANGLES, count=len(chunks))

    def draw_lamps(self, signals: Mapping[str, str], step: int) -> None:
        """Draw the lamps that shine, over their dark lenses."""
        self._lamps.draw(signals, step)


def _reaches(plane: Floats, low: npt.NDArray[Any], high: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Whether boxes reach the positive side of a plane ``(a, b, c, d)``."""
    far = np.where(plane[:3] > 0.0, high, low)
    return far @ plane[:3] + plane[3] > 0.0


class _Lamps:
    """The lit lenses of signals; their buffer changes only when a signal does."""

    def __init__(
        self, context: moderngl.Context, lamps: tuple[SignalLamp, ...], scene: IndexedMesh, vertices: Any
    ) -> None:
        self._lamps = lamps
        self._parts = [scene.triangles[lamp.start : lamp.stop] for lamp in lamps]
        self._indices = context.buffer(reserve=max(12, sum(part.nbytes for part in self._parts)))
        lit = shaders.STATIC_VERTEX.replace("#version 330 core\n", "#version 330 core\n#define LIT\n")
        self.program = context.program(vertex_shader=lit, fragment_shader=shaders.PLAIN_FRAGMENT)
        self._array = context.vertex_array(self.program, ((vertices, VERTEX_FORMAT, *VERTEX_NAMES),), self._indices)
        self._shown: tuple[bool, ...] = ()
        self._count = 0

    def draw(self, signals: Mapping[str, str], step: int) -> None:
        dark = time_ns_of_step(step) % _BLINK_PERIOD_NS >= _BLINK_PERIOD_NS // 2
        shown = tuple(_shines(lamp, signals.get(lamp.signal_id), dark) for lamp in self._lamps)
        if shown != self._shown:
            lit = [part for part, shines in zip(self._parts, shown, strict=True) if shines]
            if lit:
                self._indices.write(np.concatenate(lit).tobytes())
            self._shown, self._count = shown, 3 * sum(len(part) for part in lit)
        if self._count:
            self._array.render(moderngl.TRIANGLES, vertices=self._count)


def _shines(lamp: SignalLamp, state: str | None, dark: bool) -> bool:
    """Whether a lamp shines; ``o`` (blinking) only while not ``dark``."""
    if state is None or lamp.link >= len(state) or not lamp.is_lit(state):
        return False
    return not (dark and state[lamp.link] == "o")
