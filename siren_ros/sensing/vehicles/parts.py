"""Parts of a shape file: boxes, blocks, rods, rounded bodies, mirrors, light bars and wheels, with their finishes.

Points are ``x, y, z`` in metres in ``base_link``. ``docs/sensors.md`` has the keys. Wheels have a rim and a hub for
cars and larger vehicles, and spokes for two-wheelers.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.params.parameters import FILES_ON_DISK, StrictMapping
from siren_ros.errors import InputError
from siren_ros.sensing.meshes.mesh import Material, Mesh, Wheel
from siren_ros.sensing.meshes.solids import Axle, Finish, box, from_quads, frustum, hexahedron, sphere_points

Finishes = Mapping[str, Finish]
"""Material and colour by the names that shape files use."""
REACH_M: Final = 30.0
"""Farthest place of a part from the vehicle's middle that is accepted."""
_NEEDED: Final = (
    "tyre",
    "rim",
    "rim_gap",
    "wheel_inside",
    "steel",
    "plastic",
    "white_paint",
    "red_beacon",
    "blue_beacon",
)
"""Finishes of wheels and light bars, whose colours no shape file names."""
_MATERIALS: Final = {material.name.lower(): material for material in Material}


@cache
def load_finishes() -> Finishes:
    """The finishes of ``params/shapes/finishes.yaml``; InputError for an unusable file."""
    top = FILES_ON_DISK.read("finishes", "shapes", "finishes").mapping()
    finishes: dict[str, Finish] = {}
    for name in dict.fromkeys((*_NEEDED, *top.values)):
        row = top.mapping(name)
        rgb = row.numbers("rgb", 3, 0, 255)
        if any(value % 1.0 for value in rgb):
            raise InputError(row.where("rgb"), str(list(rgb)), "three whole numbers")
        red, green, blue = map(int, rgb)
        finishes[name] = _MATERIALS[row.text("material", _MATERIALS)], (red, green, blue)
        row.finish()
    return finishes


def finishes_in(row: StrictMapping, key: str, finishes: Finishes) -> tuple[Finish, ...]:
    """The finishes that a key names, one or a list; InputError for an unknown one."""
    words = row.words(key)
    for word in words:
        if word not in finishes:
            raise InputError(row.where(key), word, f"finishes of params/shapes/finishes.yaml: {', '.join(finishes)}")
    return tuple(finishes[word] for word in words)


def on_side(finish: Finish, side: float) -> Finish:
    """The finish on the left (positive) or right side: an indicator's lens is that of its side."""
    material, colour = finish
    right = material is Material.INDICATOR_LEFT_LAMP and side < 0
    return Material.INDICATOR_RIGHT_LAMP if right else material, colour


@dataclass(frozen=True, eq=False)
class _Solid:
    """One solid before it is placed: the points that decide where it is, and what is built on them."""

    points_m: Floats
    build: Callable[[Floats, Finish], Mesh]
    finish: str = ""
    """Its own finish, for a part that has several."""


def solids(rows: Iterable[StrictMapping], finishes: Finishes, side: int = 1) -> list[Mesh]:
    """The meshes of rows of parts, with their copies, in order; with ``side`` −1 their mirror images.

    Raises:
        InputError: a key or value is missing, unknown or out of range; names file and line.
    """
    meshes: list[Mesh] = []
    for row in rows:
        sides = (side, -side) if row.flag("mirrored", default=False) else (side,)
        if row.has("parts"):
            meshes += [mesh for hand in sides for mesh in solids(row.mappings("parts"), finishes, hand)]
        else:
            meshes += _copies(row, finishes, sides)
        row.finish()
    return meshes


def _copies(row: StrictMapping, finishes: Finishes, sides: tuple[int, ...]) -> list[Mesh]:
    """A part as often as ``repeat`` says, each one ``step_m`` from the one before; its finishes take turns."""
    kinds = [kind for kind in _KINDS if row.has(kind)]
    if len(kinds) != 1:
        raise InputError(row.where(kinds[-1] if kinds else "box"), ", ".join(kinds), f"one of {', '.join(_KINDS)}")
    pieces = _KINDS[kinds[0]](row)
    count = row.integer("repeat", 2, 100) if row.has("repeat") else 1
    step = row.numbers("step_m", 3, -REACH_M, REACH_M) if count > 1 else (0.0, 0.0, 0.0)
    turns = () if pieces[0].finish else finishes_in(row, "finish", finishes)
    meshes = []
    for k, side, piece in itertools.product(range(count), sides, pieces):
        points = (piece.points_m + np.multiply(step, k)) * (1.0, side, 1.0)
        finish = finishes[piece.finish] if piece.finish else turns[k % len(turns)]
        meshes.append(piece.build(points, on_side(finish, float(points[:, 1].mean()))))
    return meshes


def _points(row: StrictMapping, kind: str, count: int) -> Floats:
    return np.array(row.numbers(kind, 3 * count, -REACH_M, REACH_M)).reshape(-1, 3)


def _box(row: StrictMapping) -> list[_Solid]:
    (x0, y0, z0), (x1, y1, z1) = low, high = _points(row, "box", 2)
    if (low > high).any():
        raise InputError(row.where("box"), f"from {low.tolist()} to {high.tolist()}", "the lower corner first")
    return [_Solid(_corners((x0, x1, z0), (x0, x1, z1), y0, y1), _block)]


def _corners(below: tuple[float, float, float], above: tuple[float, float, float], y0: float, y1: float) -> Floats:
    """Corners of a block whose lower and upper faces, each ``x0, x1, z``, have the same y range."""
    return np.array([(x, y, z) for x0, x1, z in (below, above) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))])


def _block(corners: Floats, finish: Finish) -> Mesh:
    """A box with free corners; those of a mirror image, which run clockwise, are turned around."""
    turned = corners[3, 1] < corners[0, 1]
    return hexahedron(corners[[3, 2, 1, 0, 7, 6, 5, 4]] if turned else corners, *finish)


def _mirror(row: StrictMapping) -> list[_Solid]:
    x, inner, outer, z, height = row.numbers("mirror", 5, -REACH_M, REACH_M)
    corners = _corners((x - 0.05, x + 0.05, z), (x - 0.06, x + 0.02, z + height), inner, outer)
    return [_Solid(corners, _block)]


def _light_bar(row: StrictMapping) -> list[_Solid]:
    """A roof light bar across the vehicle: red and blue domes beside a dark middle."""
    x, z, w, depth, height = row.numbers("light_bar", 5, -REACH_M, REACH_M)
    x0, x1, base, lens, inset = x - depth / 2, x + depth / 2, z + 0.25 * height, z + height, 0.15 * depth
    foot = _corners((x0 + 0.02, x1 - 0.02, z), (x0 + 0.02, x1 - 0.02, base), -w, w)
    pieces = [_Solid(foot, _block, "plastic")]
    edges = (-1.0, -0.62, -0.24, 0.24, 0.62, 1.0)
    colours = ("blue_beacon", "red_beacon", "white_paint", "red_beacon", "blue_beacon")
    for (low, high), colour in zip(itertools.pairwise(edges), colours, strict=True):
        top = lens if colour != "white_paint" else lens - 0.2 * height
        dome = _corners((x0, x1, base), (x0 + inset, x1 - inset, top), low * w, high * w)
        pieces.append(_Solid(dome, _block, colour))
    return pieces


def _rod(row: StrictMapping) -> list[_Solid]:
    points = np.array(row.numbers("rod", 3, -REACH_M, REACH_M, times=True)).reshape(-1, 3)
    if len(points) < 2 or (np.diff(points, axis=0) == 0.0).all(axis=1).any():
        raise InputError(row.where("rod"), f"{len(points)} points", "two points or more, each at another place")
    radii = row.numbers("radii_m", len(points), 0.0, 2.0)
    sides = row.integer("sides", 3, 32) if row.has("sides") else 7
    return [_Solid(points, lambda placed, finish: _rods(placed, radii, sides, finish))]


def _rods(points: Floats, radii_m: tuple[float, ...], sides: int, finish: Finish) -> Mesh:
    """Round bars from point to point, with a radius at each."""
    bars = []
    for start, end, low, high in zip(points[:-1], points[1:], radii_m[:-1], radii_m[1:], strict=True):
        length = float(np.linalg.norm(end - start))
        up = (end - start) / length
        aside = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.9 else (0.0, 1.0, 0.0))
        aside /= np.linalg.norm(aside)
        upright = frustum((0.0, 0.0, 0.0), length, (low, high), sides, *finish)
        bars.append(upright.transformed(np.column_stack((aside, np.cross(up, aside), up)), start))
    return Mesh.joined(*bars)


def _arc(row: StrictMapping) -> list[_Solid]:
    """A curved strip in the middle plane between two angles, measured upward from the forward direction."""
    x, z, radius, from_deg, to_deg, thickness = row.numbers("arc", 6, -360.0, 360.0)
    angle = np.radians(np.linspace(from_deg, to_deg, 7))
    points = np.column_stack((x + radius * np.cos(angle), np.zeros_like(angle), z + radius * np.sin(angle)))
    return [_Solid(points, lambda placed, finish: _rods(placed, (thickness,) * 7, 4, finish))]


def _ellipsoid(row: StrictMapping) -> list[_Solid]:
    centre, radii = _points(row, "ellipsoid", 2)
    directions, triangles = sphere_points(1)
    return [_Solid(centre[None], lambda at, finish: Mesh.uniform(directions * radii + at, triangles, *finish))]


_KINDS: Final[Mapping[str, Callable[[StrictMapping], list[_Solid]]]] = {
    "box": _box,
    "block": lambda row: [_Solid(_points(row, "block", 8), _block)],
    "rod": _rod,
    "arc": _arc,
    "ellipsoid": _ellipsoid,
    "mirror": _mirror,
    "light_bar": _light_bar,
}
"""What a part can be, by the key that has its numbers."""


_SECTORS: Final = 16
_ANGLE_RAD: Final = -np.pi / 2 + np.arange(_SECTORS + 1) * (2 * np.pi / _SECTORS)
_CIRCLE: Final = np.stack((np.cos(_ANGLE_RAD), np.zeros_like(_ANGLE_RAD), np.sin(_ANGLE_RAD)), axis=1)


def pair_of_wheels(
    axle: Axle, x_m: float, outer_y_m: float, finishes: Finishes, *, steered: bool
) -> tuple[Wheel, Wheel]:
    """The left and the right wheel of an axle at ``x_m`` in ``base_link``, with their outer faces at ``±outer_y_m``."""
    y, radius = outer_y_m - axle.tyre_width_m / 2, axle.wheel_radius_m
    left, right = (
        Wheel(_wheel_mesh(radius, axle.tyre_width_m, side, finishes), (x_m, side * y, radius), radius, steered)
        for side in (1, -1)
    )
    return left, right


def _wheel_mesh(radius_m: float, width_m: float, side: int, finishes: Finishes) -> Mesh:
    """A wheel about its hub, axle along y, rim towards ``side`` (+1 left, −1 right); lowest corner at −radius."""
    out, across = np.array((0.0, 1.0, 0.0)) * side, width_m / 2
    rings = [
        _CIRCLE * radius_m - across * out,
        _CIRCLE * radius_m + 0.85 * across * out,
        _CIRCLE * 0.7 * radius_m + across * out,
    ]
    hub, back = 0.75 * across * out, -across * out
    faces: list[tuple[Floats, Finish]] = []
    for i in range(_SECTORS):
        for inner, outer in itertools.pairwise(rings):
            faces.append((np.stack((inner[i], inner[i + 1], outer[i + 1], outer[i])), finishes["tyre"]))
        # Every fourth sector is dark, so that a turning wheel shows that it turns.
        rim = finishes["rim_gap" if i % 4 in {0, 1} else "rim"]
        faces.append((np.stack((rings[2][i], rings[2][i + 1], hub, hub)), rim))
        faces.append((np.stack((rings[0][i + 1], rings[0][i], back, back)), finishes["wheel_inside"]))
    return from_quads([(quad[::-1], finish) for quad, finish in faces] if side > 0 else faces)


def spoked_wheel(axle: Axle, x_m: float, hole: float, finishes: Finishes, *, steered: bool) -> Wheel:
    """A wheel in the middle of the vehicle: a tyre around a hole of that share of its radius, with spokes across it."""
    radius, width = axle.wheel_radius_m, axle.tyre_width_m
    side = np.array((0.0, width / 2, 0.0))
    outer, inner = _CIRCLE * radius, _CIRCLE * (hole * radius)
    rings = (inner - side, outer - side, outer + side, inner + side, inner - side)
    faces = [
        (np.stack((a[i], a[i + 1], b[i + 1], b[i]))[::-1], finishes["steel" if k == 3 else "tyre"])
        for k, (a, b) in enumerate(itertools.pairwise(rings))
        for i in range(_SECTORS)
    ]
    reach, thin = (hole + 0.02) * radius, 0.25 * width
    bar = box((-thin, -thin, -reach), (thin, thin, reach), *finishes["steel"])
    bars = [bar.transformed(_turned(turn)) for turn in np.arange(3) * (np.pi / 3)]
    return Wheel(Mesh.joined(from_quads(faces), *bars), (x_m, 0.0, radius), radius, steered)


def _turned(angle_rad: float) -> Floats:
    """Rotation matrix about the axle."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array(((cos, 0.0, sin), (0.0, 1.0, 0.0), (-sin, 0.0, cos)))
