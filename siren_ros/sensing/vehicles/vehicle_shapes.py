"""The shape of each vehicle class, read from its drawing and fitted to the vehicle parameters.

A drawing is ``params/shapes/NAME.yaml``; ``docs/sensors.md`` has the keys. Fitted are the exact dimensions and the
positions of the axles.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Floats32
from siren_ros.base.params.parameters import FILES_ON_DISK, StrictMapping
from siren_ros.errors import InputError
from siren_ros.sensing.meshes.mesh import Limb, Mesh, Swing, VehicleShape, Wheel
from siren_ros.sensing.meshes.solids import Axle, Band, BodyProfile, Finish, Knots, loft
from siren_ros.sensing.vehicles.parts import (
    REACH_M,
    Finishes,
    finishes_in,
    load_finishes,
    on_side,
    pair_of_wheels,
    solids,
    spoked_wheel,
)
from siren_ros.simulation.dynamics.vehicle_model import VehicleParameters, load_vehicle_parameters
from siren_ros.simulation.world.actors import ActorClass

_OUTLINES: Final = ("top_m", "belt_m", "bottom_m", "half_width_m", "roof_half_width_m")
_SHARES: Final = {"roof_drop_m": (0.0, 2.0), "tuck": (0.0, 1.0), "crease": (0.0, 1.0)}
"""Optional numbers of a profile, with their limits."""
_BANDS: Final = {band.name.lower(): band for band in Band}
_SWINGS: Final = {swing.name.lower(): swing for swing in Swing}
_ZONES: Final = 3
"""Zones of an end face from the middle outward: middle, beside it, corner."""


@dataclass(frozen=True)
class Stripe:
    """Faces of a shell that have a finish: bands, and ranges behind the front bumper (none: the whole length)."""

    bands: tuple[Band, ...]
    spans_m: tuple[tuple[float, float], ...]
    finish: Finish

    def covers(self, band: Band, s_m: float) -> bool:
        """Whether a face with its middle at ``s_m`` belongs to the stripe."""
        return band in self.bands and (not self.spans_m or any(low < s_m < high for low, high in self.spans_m))


@dataclass(frozen=True)
class Shell:
    """A lofted shell: its outlines, and the finishes of its faces. Where nothing else is said it has its paint."""

    profile: BodyProfile
    paint: Finish
    stripes: tuple[Stripe, ...]
    """The first one that covers a face decides."""
    front: Mapping[Band, tuple[Finish, ...]]
    """Finishes of the front by band, each from the middle outward."""
    rear: Mapping[Band, tuple[Finish, ...]]

    def mesh(self) -> Mesh:
        """The closed shell in ``base_link``."""
        return loft(self.profile, self._side, partial(self._end, self.front), partial(self._end, self.rear))

    def _side(self, band: Band, s_m: float, side: int) -> Finish:
        found = (stripe.finish for stripe in self.stripes if stripe.covers(band, s_m))
        return on_side(next(found, self.paint), side)

    def _end(self, zones: Mapping[Band, tuple[Finish, ...]], band: Band, zone: int) -> Finish:
        return on_side(zones.get(band, (self.paint,) * _ZONES)[abs(zone)], zone)


@dataclass(frozen=True, eq=False)
class Drawing:
    """A body as its file draws it in ``base_link``, not yet fitted to a vehicle's size."""

    shell: Shell | None
    body: Mesh
    """The shell and all parts that do not move."""
    wheels: tuple[Wheel, ...]
    limbs: tuple[Limb, ...]
    size_m: tuple[float, ...]
    """Length, width and height for which a body without wheels is drawn; empty for the others."""


def read_drawing(name_or_path: str) -> Drawing:
    """Read a shape file by its name in ``params/shapes``, or by the path of a YAML file.

    Raises:
        InputError: there is no such file, or a key or value is missing, unknown or out of range; names file, line and
            what is allowed.
    """
    top = FILES_ON_DISK.read("shape", "shapes", name_or_path).mapping()
    finishes = load_finishes()
    length_m = top.number("length_m", 0.1, REACH_M)
    axles, wheels = _wheels(top, length_m, finishes)
    shell = _shell(top.mapping("shell"), length_m, axles, finishes) if top.has("shell") else None
    meshes = [] if shell is None else [shell.mesh()]
    meshes += solids(top.mappings("parts"), finishes)
    if not meshes:
        raise InputError(top.where("parts"), "no part", "a part at least, or a shell")
    size = () if wheels else (length_m, *(top.number(key, 0.1, REACH_M) for key in ("width_m", "height_m")))
    rows = top.mappings("limbs") if top.has("limbs") else ()
    limbs = tuple(limb for row in rows for limb in _limbs(row, finishes))
    top.finish()
    return Drawing(shell, Mesh.joined(*meshes), wheels, limbs, size)


def _wheels(top: StrictMapping, length_m: float, finishes: Finishes) -> tuple[tuple[Axle, ...], tuple[Wheel, ...]]:
    """The axles, front axle first, and their wheels: none for somebody who walks, else two axles."""
    axles: list[Axle] = []
    wheels: list[Wheel] = []
    for row in top.mappings("wheels"):
        s_m, radius_m = row.number("s_m", 0.0, length_m), row.number("radius_m", 0.05, 2.0)
        axle = Axle(s_m, radius_m, row.number("width_m", 0.01, 2.0))
        x_m, steered = length_m / 2 - s_m, not axles
        if row.has("hole"):
            wheels.append(spoked_wheel(axle, x_m, row.number("hole", 0.1, 0.95), finishes, steered=steered))
        else:
            wheels += pair_of_wheels(axle, x_m, row.number("outer_y_m", 0.1, 3.0), finishes, steered=steered)
        axles.append(axle)
        row.finish()
    if axles and (len(axles) != 2 or axles[0].s_m >= axles[1].s_m):
        places = ", ".join(f"{axle.s_m:g}" for axle in axles)
        raise InputError(top.where("wheels"), f"axles at {places} m", "two axles, the front axle first, or none")
    return tuple(axles), tuple(wheels)


def _shell(row: StrictMapping, length_m: float, axles: tuple[Axle, ...], finishes: Finishes) -> Shell:
    values: dict[str, Any] = {key: _pairs(row, key) for key in _OUTLINES}
    values |= {key: row.number(key, *limits) for key, limits in _SHARES.items() if row.has(key)}
    if row.has("zone_splits"):
        values["zone_splits"] = row.numbers("zone_splits", 2, 0.0, 1.0)
    if row.has("stations_m"):
        values["extra_stations_m"] = row.numbers("stations_m", 1, 0.0, REACH_M, times=True)
    end_m = values["top_m"][-1][0]
    try:
        profile = BodyProfile(length_m, axles=tuple(axle for axle in axles if axle.s_m < end_m), **values)
    except ValueError as error:
        raise InputError(row.where("top_m"), "the outlines of the shell", str(error)) from error
    paint, *_ = finishes_in(row, "paint", finishes)
    stripes = tuple(_stripe(stripe, finishes) for stripe in row.mappings("sides"))
    front, rear = (_end(row.mapping(key), finishes) if row.has(key) else {} for key in ("front", "rear"))
    row.finish()
    return Shell(profile, paint, stripes, front, rear)


def _pairs(row: StrictMapping, key: str) -> Knots:
    values = row.numbers(key, 2, 0.0, REACH_M, times=True)
    return tuple(zip(values[::2], values[1::2], strict=True))


def _stripe(row: StrictMapping, finishes: Finishes) -> Stripe:
    bands = row.words("bands")
    if not _BANDS.keys() >= set(bands):
        raise InputError(row.where("bands"), ", ".join(bands), f"some of {', '.join(_BANDS)}")
    spans = _pairs(row, "s_m") if row.has("s_m") else ()
    finish, *_ = finishes_in(row, "finish", finishes)
    row.finish()
    return Stripe(tuple(_BANDS[band] for band in bands), spans, finish)


def _end(row: StrictMapping, finishes: Finishes) -> Mapping[Band, tuple[Finish, ...]]:
    zones = {band: finishes_in(row, name, finishes) for name, band in _BANDS.items() if row.has(name)}
    row.finish()
    for band, found in zones.items():
        if len(found) != _ZONES:
            allowed = f"{_ZONES} finishes, from the middle outward"
            raise InputError(row.where(band.name.lower()), f"{len(found)} finishes", allowed)
    return zones


def _limbs(row: StrictMapping, finishes: Finishes) -> list[Limb]:
    swing = _SWINGS[row.text("swing", _SWINGS)]
    x, y, z = row.numbers("joint_m", 3, -REACH_M, REACH_M)
    parts, limbs = row.mappings("parts"), []
    for side in (1, -1) if row.flag("mirrored", default=False) else (1,):
        joint = x, side * y, z
        limbs.append(Limb(Mesh.joined(*solids(parts, finishes, side)).translated(*np.negative(joint)), joint, swing))
    row.finish()
    return limbs


@cache
def vehicle_shape(actor_class: ActorClass) -> VehicleShape:
    """The shape of a class: the drawing of ``params/shapes`` with the sizes and axles of ``params/vehicles``.

    Raises:
        InputError: one of the two files is missing or unusable.
    """
    size = load_vehicle_parameters()[actor_class]
    drawing = read_drawing(actor_class.name.lower())
    return fitted(actor_class, drawing, size) if drawing.wheels else scaled(actor_class, drawing, size)


def scaled(actor_class: ActorClass, drawing: Drawing, size: VehicleParameters) -> VehicleShape:
    """Stretch a body without wheels, and its limbs, from the size for which it is drawn to the given size."""
    stretch = np.divide((size.length_m, size.width_m, size.height_m), drawing.size_m)
    limbs = []
    for limb in drawing.limbs:
        x, y, z = (stretch * limb.joint_m).tolist()
        limbs.append(Limb(limb.mesh.transformed(np.diag(stretch)), (x, y, z), limb.swing))
    body = drawing.body.transformed(np.diag(stretch))
    return VehicleShape(actor_class, body, (), size.length_m, size.width_m, size.height_m, tuple(limbs))


def fitted(actor_class: ActorClass, drawing: Drawing, size: VehicleParameters) -> VehicleShape:
    """Stretch a drawn body so that it has exactly the given size and its axles are where the parameters say.

    Around the axles the body is moved and not stretched, and below the arches' height it keeps its height, so that
    the arches stay round. Wheels and limbs keep their drawn size.
    """
    body, wheels = drawing.body, drawing.wheels
    low, high = (bound.astype(np.float64) for bound in body.bounds_m)
    vertices = body.vertices_m.astype(np.float64)
    x_drawn, x_fitted = _axle_map(wheels, float(low[0]), float(high[0]), size)
    arch = min(2.0 * max(wheel.radius_m for wheel in wheels) + 0.1, 0.9 * float(high[2]))
    half = np.array((low[1], high[1]))
    x = _exact(np.interp(vertices[:, 0], x_drawn, x_fitted), -size.length_m / 2, size.length_m / 2)
    y = _exact(
        np.interp(vertices[:, 1], half, (-size.width_m / 2, size.width_m / 2)), -size.width_m / 2, size.width_m / 2
    )
    z = _exact(np.interp(vertices[:, 2], (0.0, arch, high[2]), (0.0, arch, size.height_m)), 0.0, size.height_m)
    moved = tuple(
        replace(
            wheel,
            hub_m=(
                float(np.interp(wheel.hub_m[0], x_drawn, x_fitted)),
                wheel.hub_m[1] + np.sign(wheel.hub_m[1]) * (size.width_m / 2 - float(high[1])),
                wheel.radius_m,
            ),
        )
        for wheel in wheels
    )
    return VehicleShape(
        actor_class=actor_class,
        body=replace(body, vertices_m=np.column_stack((x, y, z))),
        wheels=moved,
        length_m=size.length_m,
        width_m=size.width_m,
        height_m=size.height_m,
        limbs=drawing.limbs,
    )


def _axle_map(
    wheels: tuple[Wheel, ...], rear_m: float, front_m: float, size: VehicleParameters
) -> tuple[Floats, Floats]:
    """Knots of the map from drawn x to fitted x: ends to ends, axles to axles, without stretch near the wheels."""
    hubs = sorted({wheel.hub_m[0] for wheel in wheels})
    rear_axle = size.length_m / 2 - size.front_overhang_m - size.wheelbase_m
    targets = (rear_axle, rear_axle + size.wheelbase_m)
    reach = max(wheel.radius_m for wheel in wheels) + 0.06
    drawn = [rear_m, *(hub + side * reach for hub in hubs for side in (-1, 1)), front_m]
    to = [-size.length_m / 2, *(hub + side * reach for hub in targets for side in (-1, 1)), size.length_m / 2]
    return np.array(drawn), np.array(to)


def _exact(values: Floats, low: float, high: float) -> Floats32:
    """Convert to single precision, limited to the bounds in single precision."""
    return np.clip(values.astype(np.float32), np.float32(low), np.float32(high))
