"""Shapes of bus and box truck, and what they share with other large vehicles.

Drawn in metres after published side views of a 12 m city bus (Mercedes-Benz Citaro) and a 12 t box truck (MAN TGL);
scaled to their classes' exact sizes afterwards.
"""

import itertools

from siren_ros.sensors.meshes.loft import Axle, Band, BodyProfile, EndFinish, Finish, Knots, ShellFinish, loft
from siren_ros.sensors.meshes.material import Material
from siren_ros.sensors.meshes.mesh import Mesh, Wheel
from siren_ros.sensors.meshes.primitives import box
from siren_ros.sensors.vehicles.vehicle_parts import (
    BRAKE_LAMP,
    GLASS,
    GRILLE,
    HEAD_LAMP,
    PAINT,
    PLASTIC,
    STEEL,
    indicator,
    mirrors,
    plates,
)
from siren_ros.sensors.vehicles.wheels import axle_wheels

Drawn = tuple[Mesh, tuple[Wheel, ...]]


def knots(*values: float) -> Knots:
    """An outline from alternating distances behind the front bumper and values."""
    return tuple(zip(values[::2], values[1::2], strict=True))


def flat_shell(
    paint: Finish, window: tuple[tuple[float, float], ...], screen: tuple[float, float] | None = None
) -> ShellFinish:
    """Paint with glass in the window band between given stations, and in the roof band over a raked windscreen."""

    def finish(band: Band, s_m: float, side: int) -> Finish:
        if band <= Band.WELL_ROOF:
            return PLASTIC
        if band is Band.WINDOW and any(low < s_m < high for low, high in window):
            return GLASS
        if band is Band.ROOF and screen is not None and screen[0] < s_m < screen[1]:
            return GLASS
        if band is Band.UPPER_SIDE and s_m < 0.09:
            return indicator(side)
        return paint

    return finish


def cab_front(paint: Finish, *, glazed: bool) -> EndFinish:
    """The front of a cab: lamps below, grille, and a windscreen where ``glazed``."""

    def finish(band: Band, zone: int) -> Finish:
        if band is Band.LOWER_SIDE:
            return PLASTIC if zone == 0 else HEAD_LAMP if abs(zone) == 1 else indicator(zone)
        if band is Band.WINDOW and glazed:
            return GLASS
        if band is Band.UPPER_SIDE and zone == 0:
            return GRILLE
        return paint

    return finish


def plain_end(paint: Finish) -> EndFinish:
    """An end of one finish."""

    def finish(_band: Band, _zone: int) -> Finish:
        return paint

    return finish


def rear_lamps(x_m: float, half_width_m: float, z_m: float, height_m: float = 0.2) -> Mesh:
    """Brake lamps with indicators above them at both rear corners."""
    parts = []
    for side in (1, -1):
        y0, y1 = sorted((side * (half_width_m - 0.28), side * (half_width_m - 0.04)))
        parts.append(box((x_m - 0.012, y0, z_m), (x_m + 0.05, y1, z_m + height_m), *BRAKE_LAMP))
        parts.append(box((x_m - 0.012, y0, z_m + height_m), (x_m + 0.05, y1, z_m + 1.6 * height_m), *indicator(side)))
    return Mesh.concatenate(parts)


def vehicle_wheels(axles: tuple[Axle, ...], length_m: float, half_width_m: float) -> tuple[Wheel, ...]:
    """Wheels of all axles, the first one steered, their outer faces at ``±half_width_m``."""
    return tuple(
        wheel
        for number, axle in enumerate(axles)
        for wheel in axle_wheels(axle, length_m, half_width_m, steered=number == 0)
    )


def bus() -> Drawn:
    """A low-floor city bus with doors on the right."""
    length, half = 12.0, 1.275
    axles = (Axle(2.75, 0.48, 0.3), Axle(8.65, 0.48, 0.34))
    pillars = tuple(0.5 + 1.42 * k for k in range(9))
    windows = tuple((low + 0.09, high) for low, high in itertools.pairwise(pillars))
    profile = BodyProfile(
        length_m=length,
        top_m=knots(0, 2.72, 0.06, 2.85, 0.3, 3.0, 1.0, 3.05, 11.6, 3.05, 11.9, 2.98, 12, 2.8),
        belt_m=knots(0, 1.18, 12, 1.25),
        bottom_m=knots(0, 0.34, 0.2, 0.3, 11.7, 0.32, 12, 0.4),
        half_width_m=knots(0, 1.12, 0.06, 1.19, 0.25, 1.255, 0.5, half, 11.7, half, 12, 1.22),
        roof_half_width_m=knots(0, 1.06, 0.06, 1.13, 0.3, 1.19, 11.7, 1.19, 12, 1.13),
        axles=axles,
        roof_drop_m=0.42,
        tuck=0.995,
        extra_stations_m=tuple(s for span in windows for s in span),
        zone_splits=(0.5, 0.8),
        crease=0.45,
    )

    def rear(band: Band, zone: int) -> Finish:
        return GLASS if band is Band.WINDOW and abs(zone) < 2 else PAINT

    shell = loft(profile, flat_shell(PAINT, (*windows, (0.0, 0.5))), cab_front(PAINT, glazed=True), rear)
    doors = [box((6 - s - 1.25, -half - 0.004, 0.36), (6 - s, -half + 0.02, 2.5), *GLASS) for s in (0.62, 5.0)]
    leaf = [box((6 - s - 0.66, -half - 0.008, 0.36), (6 - s - 0.6, -half + 0.02, 2.5), *PLASTIC) for s in (0.62, 5.0)]
    sign = box((5.9, -0.8, 2.66), (5.975, 0.8, 2.84), *GRILLE)
    roof = box((-2.5, -0.85, 3.0), (1.2, 0.85, 3.1), *PAINT)
    body = Mesh.concatenate(
        [shell, *doors, *leaf, sign, roof, rear_lamps(-6, 1.2, 0.95, 0.3), plates(6, -6, 0.5, 0.62),
         mirrors(5.8, 1.17, half, 2.0, PLASTIC, 0.32)]
    )  # fmt: skip
    return body, vehicle_wheels(axles, length, 0.985 * half)


def forward_cab(length_m: float, depth_m: float, height_m: float, half_m: float, axle: Axle) -> BodyProfile:
    """The outline of an upright cab over the engine."""
    h = height_m
    return BodyProfile(
        length_m=length_m,
        top_m=knots(0, h - 0.62, 0.12, h - 0.28, 0.3, h - 0.1, 0.7, h, depth_m - 0.1, h, depth_m, h - 0.08),
        belt_m=knots(0, 1.42, 0.12, 1.5, depth_m, 1.55),
        bottom_m=knots(0, 0.46, depth_m, 0.42),
        half_width_m=knots(0, 0.87 * half_m, 0.07, 0.94 * half_m, 0.3, half_m, depth_m, half_m),
        roof_half_width_m=knots(0, 0.82 * half_m, 0.3, 0.9 * half_m, depth_m, 0.9 * half_m),
        axles=(axle,),
        roof_drop_m=0.22,
        tuck=0.985,
        extra_stations_m=(0.35, 0.55, 1.35),
        zone_splits=(0.5, 0.82),
        crease=0.38,
    )


def truck() -> Drawn:
    """A two-axle truck with a forward cab and a box body."""
    length, half = 8.4, 1.25
    axles = (Axle(1.4, 0.46, 0.3), Axle(6.1, 0.46, 0.5))
    cab = loft(
        forward_cab(length, 2.05, 2.75, 1.2, axles[0]),
        flat_shell(PAINT, ((0.45, 1.35),)),
        cab_front(PAINT, glazed=True),
        plain_end(PAINT),
    )
    x = length / 2
    cargo: Finish = (Material.FLEET_PAINT, (226, 228, 230))
    frame: Finish = (Material.FLEET_PAINT, (120, 124, 130))
    body = Mesh.concatenate(
        [
            cab,
            box((-x, -half, 1.02), (x - 2.2, half, 3.4), *cargo),
            *[
                box((x0, y0, 1.0), (x0 + 0.08, y0 + 0.08, 3.402), *frame)
                for x0 in (-x - 0.004, x - 2.276)
                for y0 in (-half - 0.004, half - 0.076)
            ],
            box((-x - 0.004, -0.03, 1.1), (-x + 0.1, 0.03, 3.3), *frame),
            box((-x + 0.1, -0.45, 0.6), (x - 0.4, 0.45, 1.03), *PLASTIC),
            *[box((-0.9, y0, 0.5), (0.7, y0 + 0.5, 0.98), *STEEL) for y0 in (-1.15, 0.65)],
            *[box((-x + 0.9 - 0.75, y0, 0.55), (-x + 0.95, y0 + 0.04, 0.95), *PLASTIC) for y0 in (-1.2, 1.16)],
            box((-x + 0.02, -1.15, 0.5), (-x + 0.14, 1.15, 0.66), *PLASTIC),
            rear_lamps(-x + 0.02, 1.2, 0.68, 0.16),
            plates(x, -x + 0.02, 0.62, 0.58),
            mirrors(x - 0.25, 1.1, half, 1.75, PLASTIC, 0.42),
        ]
    )
    return body, vehicle_wheels(axles, length, 0.97 * half)
