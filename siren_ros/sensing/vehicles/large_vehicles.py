"""Shapes of bus, box truck, ambulance and fire truck, with liveries, light bars and beacons.

Drawn in metres after published side views of a 12 m city bus (Mercedes-Benz Citaro), a 12 t box truck (MAN TGL), a
box-bodied ambulance on a van chassis (EN 1789 type C) and a two-axle municipal fire engine (HLF 20); scaled to their
classes' exact sizes afterwards.
"""

import itertools
from functools import partial

from siren_ros.sensing.meshes.mesh import Material, Mesh
from siren_ros.sensing.meshes.solids import Axle, Band, BodyProfile, Finish, box, loft
from siren_ros.sensing.vehicles.vehicle_parts import (
    BLUE_BEACON,
    BLUE_LIVERY,
    BRAKE_LAMP,
    GLASS,
    GRILLE,
    HEAD_LAMP,
    PAINT,
    PLASTIC,
    RED_BEACON,
    RED_LIVERY,
    RED_PAINT,
    STEEL,
    WHITE_LIVERY,
    WHITE_PAINT,
    YELLOW_LIVERY,
    Drawn,
    beacon,
    car_front,
    indicator,
    knots,
    light_bar,
    mirrors,
    plates,
    side_panels,
    vehicle_wheels,
)


def flat_shell(paint: Finish, windows: tuple[tuple[float, float], ...], band: Band, s_m: float, side: int) -> Finish:
    """Finish of a flat-sided body: paint above dark wells, glass at the given stations, and indicators at the front."""
    if band <= Band.WELL_ROOF:
        return PLASTIC
    if band is Band.WINDOW and any(low < s_m < high for low, high in windows):
        return GLASS
    return indicator(side) if band is Band.UPPER_SIDE and s_m < 0.09 else paint


def cab_front(paint: Finish, band: Band, zone: int) -> Finish:
    """The front of a cab: lamps below, grille and windscreen."""
    if band is Band.LOWER_SIDE:
        return PLASTIC if zone == 0 else HEAD_LAMP if abs(zone) == 1 else indicator(zone)
    if band is Band.WINDOW:
        return GLASS
    return GRILLE if band is Band.UPPER_SIDE and zone == 0 else paint


def rear_lamps(x_m: float, half_width_m: float, z_m: float, height_m: float = 0.2) -> Mesh:
    """Brake lamps with indicators above them at both rear corners."""
    parts = []
    for side in (1, -1):
        y0, y1 = sorted((side * (half_width_m - 0.28), side * (half_width_m - 0.04)))
        parts.append(box((x_m - 0.012, y0, z_m), (x_m + 0.05, y1, z_m + height_m), *BRAKE_LAMP))
        parts.append(box((x_m - 0.012, y0, z_m + height_m), (x_m + 0.05, y1, z_m + 1.6 * height_m), *indicator(side)))
    return Mesh.joined(*parts)


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

    shell = loft(profile, partial(flat_shell, PAINT, (*windows, (0.0, 0.5))), partial(cab_front, PAINT), rear)
    doors = [box((6 - s - 1.25, -half - 0.004, 0.36), (6 - s, -half + 0.02, 2.5), *GLASS) for s in (0.62, 5.0)]
    leaf = [box((6 - s - 0.66, -half - 0.008, 0.36), (6 - s - 0.6, -half + 0.02, 2.5), *PLASTIC) for s in (0.62, 5.0)]
    sign = box((5.9, -0.8, 2.66), (5.975, 0.8, 2.84), *GRILLE)
    roof = box((-2.5, -0.85, 3.0), (1.2, 0.85, 3.1), *PAINT)
    body = Mesh.joined(shell, *doors, *leaf, sign, roof, rear_lamps(-6, 1.2, 0.95, 0.3), plates(6, -6, 0.5, 0.62),
         mirrors(5.8, 1.17, half, 2.0, PLASTIC, 0.32))  # fmt: skip
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
        partial(flat_shell, PAINT, ((0.45, 1.35),)),
        partial(cab_front, PAINT),
        lambda _band, _zone: PAINT,
    )
    x = length / 2
    cargo: Finish = (Material.FLEET_PAINT, (226, 228, 230))
    frame: Finish = (Material.FLEET_PAINT, (120, 124, 130))
    body = Mesh.joined(
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
    )
    return body, vehicle_wheels(axles, length, 0.97 * half)


def _battenburg(
    x_m: tuple[float, float], z_m: tuple[float, float], half_width_m: float, finishes: tuple[Finish, Finish], count: int
) -> Mesh:
    """Two rows of alternating squares along both sides."""
    step = (x_m[1] - x_m[0]) / count
    middle = (z_m[0] + z_m[1]) / 2
    rows = ((z_m[0], middle), (middle, z_m[1]))
    return Mesh.joined(
        *[
            side_panels((x_m[0] + k * step, x_m[0] + (k + 1) * step), rows[row], half_width_m, finishes[(k + row) % 2])
            for row in (0, 1)
            for k in range(count)
        ]
    )


def _ambulance_cab(length_m: float, axles: tuple[Axle, ...]) -> BodyProfile:
    return BodyProfile(
        length_m=length_m,
        top_m=knots(0, 0.88, 0.06, 0.98, 0.25, 1.1, 0.85, 1.27, 0.97, 1.3, 1.72, 2.05, 1.95, 2.2, 2.3, 2.25, 2.6, 2.25),
        belt_m=knots(0, 0.76, 0.06, 0.84, 0.25, 0.96, 0.85, 1.1, 0.97, 1.14, 1.72, 1.22, 2.6, 1.24),
        bottom_m=knots(0, 0.38, 0.1, 0.3, 0.4, 0.27, 2.6, 0.28),
        half_width_m=knots(0, 0.76, 0.07, 0.86, 0.25, 0.94, 0.7, 0.975, 1.2, 0.985, 2.6, 0.985),
        roof_half_width_m=knots(0, 0.64, 0.1, 0.74, 0.85, 0.85, 0.97, 0.86, 1.72, 0.82, 2.6, 0.82),
        axles=axles[:1],
        roof_drop_m=0.12,
        extra_stations_m=(1.3, 2.1),
        zone_splits=(0.52, 0.86),
    )


def ambulance() -> Drawn:
    """An ambulance with a box body, chequered flanks and light bars at both ends of the roof."""
    length, half = 6.5, 1.05
    x = length / 2
    axles = (Axle(1.0, 0.35, 0.225), Axle(4.9, 0.35, 0.3))

    def side(band: Band, s_m: float, hand: int) -> Finish:
        if band is Band.UPPER_SIDE and s_m < 0.22:
            return indicator(hand) if s_m < 0.07 else HEAD_LAMP
        if band is Band.UPPER_SIDE and s_m > 1.3:
            return YELLOW_LIVERY
        windscreen = band is Band.ROOF and 0.97 < s_m < 1.72
        return GLASS if windscreen else flat_shell(WHITE_PAINT, ((1.3, 2.1),), band, s_m, hand)

    cab = loft(_ambulance_cab(length, axles), side, partial(car_front, WHITE_PAINT), lambda _band, _zone: WHITE_PAINT)
    wall, back, nose = half - 0.006, -x + 0.02, x - 2.3
    green: Finish = (Material.LIVERY, (16, 124, 62))
    body = Mesh.joined(cab,
            box((back, -wall, 0.78), (nose, wall, 2.6), *WHITE_PAINT),
            box((nose - 0.01, -0.8 * wall, 2.2), (nose + 0.32, 0.8 * wall, 2.42), *WHITE_PAINT),  # over the cab's roof
            box((back + 0.2, -0.6, 0.42), (x - 2.2, 0.6, 0.82), *PLASTIC),
            *[box((x0, y0, 0.34), (x1, y0 + 0.05, 0.8), *WHITE_PAINT) for x0, x1 in _skirts(x, axles[1], 2.35)
              for y0 in (-wall, wall - 0.05)],
            _battenburg((back + 0.1, x - 2.4), (1.0, 1.5), wall, (YELLOW_LIVERY, green), 7),
            side_panels((back + 0.1, x - 2.4), (2.28, 2.38), wall, RED_LIVERY),
            side_panels((back + 1.0, back + 2.3), (1.65, 2.15), wall, GLASS),
            *_ambulance_rear(back, wall),
            light_bar(x - 2.2, 2.24, 0.72, 0.34, 0.17),
            box((x - 2.62, -0.95, 2.6), (x - 2.32, 0.95, 2.72), *WHITE_PAINT),
            light_bar(x - 2.62, 2.6, 0.9, 0.3, 0.2),
            light_bar(back + 0.3, 2.6, 0.9, 0.3, 0.2),
            *[beacon(x - 0.02, y, 0.98, 0.07, BLUE_BEACON) for y in (-0.25, 0.25)],
            *[beacon(x0, y, 2.5, 0.09, RED_BEACON) for x0 in (back + 0.6, x - 2.9) for y in (-1.0, 1.0)],
            plates(x, back, 0.56, 0.62),
            mirrors(x - 1.45, 0.85, half, 1.24, WHITE_PAINT, 0.26))  # fmt: skip
    return body, vehicle_wheels(axles, length, 0.985 * half)


def _skirts(x_m: float, rear: Axle, front_s_m: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Sills between the cab and the rear wheel, and behind it."""
    hub, reach = x_m - rear.s_m, rear.wheel_radius_m + 0.06
    return (-x_m + 0.04, hub - reach), (hub + reach, x_m - front_s_m)


def _ambulance_rear(back_m: float, half_m: float) -> list[Mesh]:
    stripes = [
        box((back_m - 0.008, y0, 0.95), (back_m + 0.02, y0 + 0.24, 1.5), *(RED_LIVERY if k % 2 else YELLOW_LIVERY))
        for k, y0 in enumerate(-0.84 + 0.24 * k for k in range(7))
    ]
    windows = [box((back_m - 0.008, y0, 1.6), (back_m + 0.02, y0 + 0.55, 2.2), *GLASS) for y0 in (-0.62, 0.07)]
    seam = box((back_m - 0.01, -0.015, 0.85), (back_m + 0.02, 0.015, 2.45), *PLASTIC)
    bumper = box((back_m - 0.02, -half_m, 0.4), (back_m + 0.2, half_m, 0.56), *PLASTIC)
    return [*stripes, *windows, seam, bumper, rear_lamps(back_m, half_m, 0.62, 0.16)]


def fire_truck() -> Drawn:
    """A fire engine: crew cab, lockers behind roller shutters, ladder and light bars."""
    length, half = 8.3, 1.25
    x = length / 2
    axles = (Axle(1.45, 0.5, 0.32), Axle(5.95, 0.5, 0.5))
    cab = loft(
        forward_cab(length, 3.2, 2.85, 1.22, axles[0]),
        partial(flat_shell, RED_PAINT, ((0.45, 1.35), (1.5, 2.7))),
        partial(cab_front, RED_PAINT),
        lambda _band, _zone: RED_PAINT,
    )
    wall, back, nose = half - 0.006, -x + 0.02, x - 3.25
    hub = x - axles[1].s_m
    shutter: Finish = (Material.RIM, (176, 180, 184))
    lockers = ((back + 0.12, hub - 0.62), (hub - 0.5, hub + 0.5), (hub + 0.62, nose - 0.08))
    body = Mesh.joined(
        cab,
        box((back, -wall, 1.12), (nose, wall, 2.95), *RED_PAINT),
        *[box((x0, -wall, 0.5), (x1, wall, 1.14), *RED_PAINT) for x0, x1 in _skirts(x, axles[1], 3.25)],
        box((back + 0.2, -0.7, 0.55), (x - 2.0, 0.7, 1.14), *PLASTIC),
        *[side_panels(span, (1.25 if k == 1 else 0.85, 2.5), wall, shutter) for k, span in enumerate(lockers)],
        side_panels((back + 0.05, nose), (2.6, 2.74), wall, WHITE_LIVERY),
        side_panels((back + 0.05, hub - 0.62), (0.6, 0.76), wall, YELLOW_LIVERY),
        side_panels((hub + 0.62, nose), (0.6, 0.76), wall, YELLOW_LIVERY),
        side_panels((x - 3.1, x - 2.0), (0.86, 1.02), 1.215, WHITE_LIVERY),
        box((x - 0.02, -1.02, 0.98), (x + 0.008, 1.02, 1.1), *WHITE_LIVERY),
        *_fire_rear(back),
        *_ladder(back, nose),
        light_bar(x - 0.75, 2.84, 0.95, 0.36, 0.24),
        *[beacon(back + 0.15, y, 3.02, 0.16, BLUE_BEACON) for y in (-1.05, 1.05)],
        *[beacon(x, y, 1.28, 0.08, BLUE_BEACON) for y in (-0.4, 0.4)],
        box((-0.4, -0.5, 2.9), (0.2, 0.5, 3.2), *RED_PAINT),
        plates(x, back, 0.66, 0.7),
        mirrors(x - 0.25, 1.08, half, 1.8, PLASTIC, 0.45),
    )
    return body, vehicle_wheels(axles, length, 0.975 * half)


def _fire_rear(back_m: float) -> list[Mesh]:
    stripes = [
        box((back_m - 0.008, y0, 0.8), (back_m + 0.02, y0 + 0.29, 1.25), *(YELLOW_LIVERY if k % 2 else RED_LIVERY))
        for k, y0 in enumerate(-1.02 + 0.29 * k for k in range(7))
    ]
    shutter = box((back_m - 0.008, -0.8, 1.35), (back_m + 0.02, 0.8, 2.65), *STEEL)
    bumper = box((back_m - 0.02, -1.2, 0.5), (back_m + 0.2, 1.2, 0.62), *PLASTIC)
    blue = box((back_m - 0.008, -0.8, 2.72), (back_m + 0.02, 0.8, 2.82), *BLUE_LIVERY)
    return [*stripes, shutter, bumper, blue, rear_lamps(back_m, 1.24, 0.64, 0.14)]


def _ladder(back_m: float, nose_m: float) -> list[Mesh]:
    low, high = 3.0, 3.08
    rails = [box((back_m + 0.3, y0, low), (nose_m - 0.1, y0 + 0.06, high), *STEEL) for y0 in (-0.95, -0.55)]
    count = 9
    step = (nose_m - back_m - 0.6) / count
    rungs = [
        box((back_m + 0.4 + k * step, -0.93, low + 0.02), (back_m + 0.45 + k * step, -0.5, high - 0.02), *STEEL)
        for k in range(count)
    ]
    feet = [box((x0, -0.9, 2.94), (x0 + 0.1, -0.55, low), *STEEL) for x0 in (back_m + 0.5, nose_m - 0.5)]
    return [*rails, *rungs, *feet]
