"""Signals, stop signs and street lamps."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.sensors.meshes.loft import from_quads
from siren_ros.sensors.meshes.material import LampColour, Material
from siren_ros.sensors.meshes.mesh import Mesh
from siren_ros.sensors.meshes.primitives import Rgb, box, frustum
from siren_ros.sensors.scene.free_space import FreeSpace

POLE_RGB: Final[Rgb] = (112, 116, 120)
HOUSING_RGB: Final[Rgb] = (30, 32, 34)
_LENS_RGB: Final[dict[LampColour, Rgb]] = {
    LampColour.RED: (92, 18, 16),
    LampColour.YELLOW: (96, 74, 14),
    LampColour.GREEN: (14, 80, 46),
}
_LENS_RADIUS_M: Final = 0.15
"""Lenses of 300 mm, the larger of the two standard sizes (EN 12368)."""
HEAD_HEIGHT_M: Final = 1.28
_LETTERS: Final = {
    "S": ("111", "100", "111", "001", "111"),
    "T": ("111", "010", "010", "010", "010"),
    "O": ("111", "101", "101", "101", "111"),
    "P": ("111", "101", "111", "100", "100"),
}


@dataclass(frozen=True, eq=False)
class SignalHead:
    """A head as a mesh, with the triangles of each lamp."""

    mesh: Mesh
    lamps: tuple[tuple[LampColour, int, int], ...]


def turned(mesh: Mesh, x_m: float, y_m: float, z_m: float, heading_rad: float) -> Mesh:
    """A mesh turned so that its x axis points along a heading, and moved."""
    c, s = float(np.cos(heading_rad)), float(np.sin(heading_rad))
    return mesh.transformed(np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)]), (x_m, y_m, z_m))


def signal_head() -> SignalHead:
    """A three-lamp head that shines along +x, its lower edge at z 0, red above yellow above green."""
    parts = [
        box((-0.2, -0.21, 0.0), (0.0, 0.21, HEAD_HEIGHT_M), Material.SIGNAL_HOUSING, HOUSING_RGB),
        box((-0.08, -0.36, -0.12), (-0.06, 0.36, HEAD_HEIGHT_M + 0.12), Material.SIGNAL_HOUSING, HOUSING_RGB),
    ]
    lamps = []
    angle = np.arange(10) * (2 * np.pi / 10)
    for row, colour in enumerate((LampColour.GREEN, LampColour.YELLOW, LampColour.RED)):
        z = 0.23 + 0.41 * row
        ring = np.column_stack((np.full(10, 0.012), _LENS_RADIUS_M * np.cos(angle), z + _LENS_RADIUS_M * np.sin(angle)))
        fan = [(0, k, k + 1) for k in range(1, 9)]
        parts.append(box((0.0, -0.17, z + 0.16), (0.2, 0.17, z + 0.18), Material.SIGNAL_HOUSING, HOUSING_RGB))
        start = sum(len(part) for part in parts)
        parts.append(Mesh.uniform(ring, fan, colour.material, _LENS_RGB[colour]))
        lamps.append((colour, start, start + len(fan)))
    return SignalHead(Mesh.concatenate(parts), tuple(lamps))


def pole(x_m: float, y_m: float, height_m: float, radius_m: float = 0.07) -> Mesh:
    """An upright metal pole on the ground, slightly tapered."""
    return frustum((x_m, y_m, 0.0), height_m, (radius_m, 0.75 * radius_m), 7, Material.METAL_POLE, POLE_RGB)


def stop_sign() -> Mesh:
    """An octagonal sign that faces +x, its middle at the origin: red with a white rim and the word STOP."""
    angle = np.pi / 8 + np.arange(8) * (np.pi / 4)
    outline = np.column_stack((np.zeros(8), np.cos(angle), np.sin(angle)))
    fan = np.array([(0, k, k + 1) for k in range(1, 7)])
    back = [-0.012, 0.0, 0.0]
    parts = [
        Mesh.uniform(outline * 0.45, fan, Material.STOP_SIGN, (236, 236, 236)),
        Mesh.uniform(outline * 0.41 + (0.006, 0.0, 0.0), fan, Material.STOP_SIGN, (178, 20, 24)),
        Mesh.uniform(outline * 0.45 + back, fan[:, ::-1], Material.METAL_POLE, (140, 142, 144)),
    ]
    cell = 0.045
    for place, letter in enumerate("STOP"):
        left = -0.33 + place * 0.175
        for row, bits in enumerate(_LETTERS[letter]):
            for column, bit in enumerate(bits):
                if bit == "1":
                    y, z = left + column * cell, 0.11 - row * cell
                    quad = np.array(
                        [(0.012, y, z - cell), (0.012, y + cell, z - cell), (0.012, y + cell, z), (0.012, y, z)]
                    )
                    parts.append(from_quads([(quad, (Material.STOP_SIGN, (240, 240, 240)))]))
    return Mesh.concatenate(parts)


def street_lamp(height_m: float) -> Mesh:
    """A street lamp at the origin whose arm reaches 1.8 m along +x."""
    arm = 1.8
    return Mesh.concatenate(
        [
            frustum((0.0, 0.0, 0.0), height_m, (0.09, 0.05), 7, Material.METAL_POLE, POLE_RGB),
            box((0.0, -0.03, height_m - 0.05), (arm, 0.03, height_m), Material.METAL_POLE, POLE_RGB),
            box(
                (arm - 0.6, -0.12, height_m - 0.13), (arm, 0.12, height_m - 0.05), Material.STREET_LAMP, (196, 198, 190)
            ),
        ]
    )


def mast_arm(from_m: tuple[float, float], to_m: tuple[float, float], z_m: float) -> Mesh:
    """A horizontal arm of square section between two places at height ``z_m``."""
    dx, dy = to_m[0] - from_m[0], to_m[1] - from_m[1]
    length = float(np.hypot(dx, dy))
    beam = box((0.0, -0.06, -0.06), (length, 0.06, 0.06), Material.METAL_POLE, POLE_RGB)
    return turned(beam, from_m[0], from_m[1], z_m, float(np.arctan2(dy, dx)))


def clear_pole(
    space: FreeSpace, x_m: float, y_m: float, direction: tuple[float, float], reach_m: float, radius_m: float
) -> tuple[float, float] | None:
    """The nearest place from a point along a direction, within a reach, with a clear radius; None without one."""
    steps = np.arange(0.0, reach_m, 0.25)[:, None]
    return space.first_clear(np.array((x_m, y_m)) + steps * np.array(direction), radius_m)
