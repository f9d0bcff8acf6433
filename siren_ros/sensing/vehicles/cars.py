"""Shapes of cars: shells lofted along outlines, with glass, lamps, mirrors, plates and wheels.

The outlines of hatchback, sedan, estate, SUV, van, pickup and police car (side profile, plan view and glass) are drawn
in metres for typical European vehicles of each class (published dimensions of, in this order, VW Golf, BMW 3 series,
Škoda Octavia Combi, VW Tiguan, Ford Transit, Ford Ranger, Škoda Octavia Combi); they are scaled to the class's exact
length, width and height afterwards.
"""

import itertools
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

from siren_ros.sensing.meshes.mesh import Mesh
from siren_ros.sensing.meshes.solids import Axle, Band, BodyProfile, Finish, Knots, box, loft
from siren_ros.sensing.vehicles.vehicle_parts import (
    BLUE_LIVERY,
    BRAKE_LAMP,
    GLASS,
    GRILLE,
    HEAD_LAMP,
    PAINT,
    PLASTIC,
    WHITE_PAINT,
    YELLOW_LIVERY,
    Drawn,
    car_front,
    indicator,
    knots,
    light_bar,
    mirrors,
    plates,
    vehicle_wheels,
)

Span = tuple[float, float]
"""A range in metres behind the front bumper: from, to."""


@dataclass(frozen=True)
class CarDesign:
    """Profile of a car and the places of its glass."""

    profile: BodyProfile
    windscreen: Span
    rear_screen: Span
    side_windows: tuple[Span, ...]
    mirror_s_m: float
    paint: Finish = PAINT
    sill: Finish = PAINT
    """Finish of the lowest part of the flanks."""
    chequers: bool = False
    """Blue and yellow Battenburg markings on the flanks."""


def _plan(length_m: float, half_width_m: float) -> Knots:
    w, end = half_width_m, length_m
    return knots(0, 0.72 * w, 0.07, 0.86 * w, 0.22, 0.94 * w, 0.6, 0.985 * w, 1.2, w,
                  end - 1.0, w, end - 0.4, 0.97 * w, end - 0.1, 0.88 * w, end, 0.76 * w)  # fmt: skip


_SEDAN_PROFILE: Final = BodyProfile(
    length_m=4.7,
    top_m=knots(0, 0.66, 0.06, 0.74, 0.3, 0.82, 0.9, 0.91, 1.5, 0.985, 1.62, 1.0, 2.3, 1.37, 2.6, 1.435,
                 2.95, 1.45, 3.4, 1.41, 4.1, 1.115, 4.3, 1.09, 4.62, 1.06, 4.7, 0.93),
    belt_m=knots(0, 0.6, 0.06, 0.66, 0.3, 0.75, 0.9, 0.83, 1.62, 0.91, 3.0, 0.945, 4.1, 0.99, 4.6, 0.97,
                 4.7, 0.86),
    bottom_m=knots(0, 0.3, 0.1, 0.22, 0.4, 0.19, 4.3, 0.2, 4.6, 0.27, 4.7, 0.36),
    half_width_m=_plan(4.7, 0.915),
    roof_half_width_m=knots(0, 0.6, 0.1, 0.7, 1.5, 0.79, 1.62, 0.77, 2.3, 0.62, 3.4, 0.6, 4.1, 0.72, 4.7, 0.66),
    axles=(Axle(0.86, 0.33, 0.22), Axle(3.7, 0.33, 0.22)),
)  # fmt: skip
SEDAN: Final = CarDesign(_SEDAN_PROFILE, (1.62, 2.3), (3.4, 4.1), ((1.9, 2.72), (2.8, 3.7)), 1.95)
"""A four-door saloon with a boot."""

_HATCHBACK_PROFILE: Final = BodyProfile(
    length_m=4.2,
    top_m=knots(0, 0.7, 0.06, 0.78, 0.28, 0.87, 0.8, 0.97, 1.25, 1.03, 1.38, 1.045, 2.05, 1.4, 2.4, 1.46,
                 2.8, 1.47, 3.45, 1.43, 3.72, 1.37, 4.04, 1.0, 4.16, 0.93, 4.2, 0.8),
    belt_m=knots(0, 0.62, 0.06, 0.69, 0.28, 0.79, 0.8, 0.88, 1.38, 0.95, 2.8, 0.98, 3.72, 1.03, 4.04,
                 0.95, 4.2, 0.76),
    bottom_m=knots(0, 0.3, 0.1, 0.23, 0.4, 0.2, 3.8, 0.21, 4.1, 0.28, 4.2, 0.36),
    half_width_m=_plan(4.2, 0.9),
    roof_half_width_m=knots(0, 0.6, 0.1, 0.7, 1.25, 0.78, 1.38, 0.76, 2.05, 0.62, 3.45, 0.6, 3.72, 0.6,
                 4.04, 0.7, 4.2, 0.66),
    axles=(Axle(0.83, 0.315, 0.2), Axle(3.45, 0.315, 0.2)),
)  # fmt: skip
HATCHBACK: Final = CarDesign(
    _HATCHBACK_PROFILE, (1.38, 2.05), (3.72, 4.04), ((1.65, 2.45), (2.54, 3.2), (3.27, 3.6)), 1.7
)
"""A five-door compact car."""

_ESTATE_PROFILE: Final = replace(
    _SEDAN_PROFILE,
    length_m=4.75,
    top_m=(
        *_SEDAN_PROFILE.top_m[:8],
        *knots(2.95, 1.46, 3.5, 1.465, 4.15, 1.44, 4.3, 1.42, 4.62, 1.0, 4.71, 0.95, 4.75, 0.82),
    ),
    belt_m=(*_SEDAN_PROFILE.belt_m[:6], *knots(4.15, 0.985, 4.3, 0.99, 4.62, 0.94, 4.75, 0.77)),
    bottom_m=knots(0, 0.3, 0.1, 0.22, 0.4, 0.19, 4.3, 0.2, 4.65, 0.27, 4.75, 0.36),
    half_width_m=_plan(4.75, 0.915),
    roof_half_width_m=(*_SEDAN_PROFILE.roof_half_width_m[:5], *knots(4.15, 0.6, 4.3, 0.6, 4.62, 0.7, 4.75, 0.66)),
)
ESTATE: Final = CarDesign(_ESTATE_PROFILE, (1.62, 2.3), (4.3, 4.62), ((1.9, 2.72), (2.8, 3.5), (3.58, 4.12)), 1.95)
"""A station wagon."""

_SUV_PROFILE: Final = BodyProfile(
    length_m=4.65,
    top_m=knots(0, 0.84, 0.06, 0.93, 0.25, 1.02, 0.9, 1.1, 1.35, 1.14, 1.47, 1.155, 2.1, 1.58, 2.45, 1.66,
                 2.9, 1.68, 3.7, 1.65, 4.05, 1.6, 4.42, 1.17, 4.58, 1.08, 4.65, 0.9),
    belt_m=knots(0, 0.76, 0.06, 0.84, 0.25, 0.93, 0.9, 1.02, 1.47, 1.07, 2.9, 1.1, 4.05, 1.16, 4.42, 1.1,
                 4.65, 0.86),
    bottom_m=knots(0, 0.38, 0.1, 0.3, 0.4, 0.25, 4.2, 0.26, 4.55, 0.36, 4.65, 0.44),
    half_width_m=_plan(4.65, 0.94),
    roof_half_width_m=knots(0, 0.64, 0.1, 0.74, 1.35, 0.82, 1.47, 0.8, 2.1, 0.67, 3.7, 0.65, 4.05, 0.65,
                 4.42, 0.74, 4.65, 0.7),
    axles=(Axle(0.9, 0.365, 0.235), Axle(3.6, 0.365, 0.235)),
)  # fmt: skip
SUV: Final = CarDesign(
    _SUV_PROFILE, (1.47, 2.1), (4.05, 4.42), ((1.75, 2.6), (2.69, 3.35), (3.43, 3.95)), 1.8, sill=PLASTIC
)
"""A sport utility vehicle with dark sills."""

_VAN_PROFILE: Final = BodyProfile(
    length_m=5.9,
    top_m=knots(0, 0.86, 0.06, 0.96, 0.25, 1.08, 0.8, 1.24, 0.92, 1.27, 1.72, 2.06, 1.95, 2.3, 2.3, 2.44,
                 3.0, 2.5, 5.7, 2.48, 5.82, 2.38, 5.9, 2.1),
    belt_m=knots(0, 0.74, 0.06, 0.82, 0.25, 0.94, 0.8, 1.08, 0.92, 1.12, 1.72, 1.22, 5.82, 1.24, 5.9, 1.2),
    bottom_m=knots(0, 0.36, 0.1, 0.29, 0.4, 0.25, 5.5, 0.26, 5.8, 0.32, 5.9, 0.4),
    half_width_m=knots(0, 0.76, 0.07, 0.88, 0.25, 0.96, 0.7, 0.995, 1.2, 1.01, 5.6, 1.01, 5.85, 0.99, 5.9, 0.95),
    roof_half_width_m=knots(0, 0.64, 0.1, 0.74, 0.8, 0.86, 0.92, 0.87, 1.72, 0.84, 2.3, 0.84, 5.7, 0.85,
                 5.82, 0.83, 5.9, 0.78),
    axles=(Axle(1.0, 0.345, 0.225), Axle(4.66, 0.345, 0.225)),
    roof_drop_m=0.2,
)  # fmt: skip
VAN: Final = CarDesign(_VAN_PROFILE, (0.92, 1.72), (5.89, 5.9), ((1.3, 2.15),), 1.4, sill=PLASTIC)
"""A panel van."""

_PICKUP_PROFILE: Final = BodyProfile(
    length_m=5.3,
    top_m=knots(0, 0.92, 0.06, 1.02, 0.22, 1.1, 1.0, 1.16, 1.4, 1.19, 1.52, 1.2, 2.15, 1.7, 2.6, 1.8,
                 3.45, 1.76, 3.62, 1.66, 3.72, 1.2, 3.78, 0.84, 5.22, 0.84, 5.3, 0.74),
    belt_m=knots(0, 0.84, 0.06, 0.92, 0.22, 1.0, 1.0, 1.07, 1.52, 1.12, 3.62, 1.14, 3.72, 1.1, 3.78, 0.82,
                 5.22, 0.82, 5.3, 0.72),
    bottom_m=knots(0, 0.42, 0.1, 0.35, 0.4, 0.3, 4.9, 0.32, 5.2, 0.4, 5.3, 0.46),
    half_width_m=_plan(5.3, 0.95),
    roof_half_width_m=knots(0, 0.66, 0.1, 0.76, 1.4, 0.83, 1.52, 0.81, 2.15, 0.68, 3.45, 0.66, 3.62, 0.7,
                 3.78, 0.86, 5.3, 0.8),
    axles=(Axle(0.98, 0.39, 0.255), Axle(4.2, 0.39, 0.255)),
)  # fmt: skip
PICKUP: Final = CarDesign(_PICKUP_PROFILE, (1.52, 2.15), (3.62, 3.72), ((1.8, 2.6), (2.7, 3.45)), 1.9, sill=PLASTIC)
"""A double-cab pickup with an open bed."""

_CHEQUERS: Final = tuple(0.55 * k + 0.3 for k in range(1, 8))
POLICE: Final = replace(
    ESTATE,
    profile=replace(ESTATE.profile, extra_stations_m=_CHEQUERS),
    paint=WHITE_PAINT,
    sill=WHITE_PAINT,
    chequers=True,
)
"""A police estate with Battenburg markings."""


def _shell(design: CarDesign, band: Band, s_m: float, side: int) -> Finish:
    """Finish of a car's faces: dark wheel wells, flanks, windows with the dark pillars between them, and the roof."""
    if band <= Band.WELL_ROOF:
        return PLASTIC
    if band <= Band.UPPER_SIDE:
        return _flank(design, band, s_m, side)
    screens = design.side_windows if band is Band.WINDOW else (design.windscreen, design.rear_screen)
    if band in {Band.WINDOW, Band.ROOF} and any(low < s_m < high for low, high in screens):
        return GLASS
    pillars = band is Band.WINDOW and design.side_windows[0][0] < s_m < design.side_windows[-1][1]
    return GRILLE if pillars else design.paint


def _flank(design: CarDesign, band: Band, s_m: float, side: int) -> Finish:
    length = design.profile.length_m
    if band is Band.LOWER_SIDE:
        return _chequer(s_m, 0) if design.chequers and 1.25 < s_m < length - 1.5 else design.sill
    if s_m < 0.22:
        return indicator(side) if s_m < 0.07 else HEAD_LAMP
    if s_m > length - 0.16:
        return BRAKE_LAMP
    if design.chequers and 0.6 < s_m < length - 0.45:
        return _chequer(s_m, 1)
    return design.paint


def _chequer(s_m: float, row: int) -> Finish:
    return BLUE_LIVERY if (int((s_m - 0.3) / 0.55) + row) % 2 else YELLOW_LIVERY


def _rear(design: CarDesign, band: Band, zone: int) -> Finish:
    if band is Band.UPPER_SIDE:
        return design.paint if zone == 0 else BRAKE_LAMP if abs(zone) == 1 else indicator(zone)
    if band is Band.LOWER_SIDE:
        return design.sill
    tall = design.profile.top_m[-1][1] > 1.5
    return GLASS if band is Band.WINDOW and tall and abs(zone) < 2 else design.paint


def _pickup_bed(design: CarDesign) -> Mesh:
    half, wall = 0.94, 0.06
    x_front, x_rear = (design.profile.length_m / 2 - s for s in (3.74, 5.28))
    sides = [box((x_rear, low, 0.7), (x_front, low + wall, 1.13), *design.paint) for low in (-half, half - wall)]
    gate = box((x_rear, -half + 0.02, 0.62), (x_rear + wall, half - 0.02, 1.12), *design.paint)
    floor = box((x_rear + wall, -half + wall, 0.8), (x_front, half - wall, 0.86), *PLASTIC)
    lamps = [
        box((x_rear - 0.012, low, 0.78), (x_rear + 0.05, low + 0.16, 1.06), *BRAKE_LAMP) for low in (-half, half - 0.16)
    ]
    signals = [
        box((x_rear - 0.016, side * 0.86 - 0.07, 0.78), (x_rear + 0.04, side * 0.86 + 0.07, 0.86), *indicator(side))
        for side in (1, -1)
    ]
    return Mesh.joined(*sides, gate, floor, *lamps, *signals)


def car(design: CarDesign, extras: tuple[Mesh, ...] = ()) -> Drawn:
    """Body and wheels of a car in ``base_link``, as drawn (not yet scaled)."""
    # A side window ends at a pillar, and the next one begins there.
    pillars = (s for before, after in itertools.pairwise(design.side_windows) for s in (before[1], after[0]))
    profile = replace(design.profile, extra_stations_m=(*design.profile.extra_stations_m, *pillars))
    half = max(w for _, w in profile.half_width_m)
    belt = dict(profile.belt_m)
    x_mirror = profile.length_m / 2 - design.mirror_s_m
    z_mirror = max(z for s, z in profile.belt_m if s <= design.mirror_s_m) + 0.02
    z_front = 0.5 * (profile.bottom_m[0][1] + profile.belt_m[0][1])
    z_rear = 0.35 * profile.bottom_m[-1][1] + 0.65 * belt[profile.length_m]
    body = Mesh.joined(
        loft(profile, partial(_shell, design), partial(car_front, design.paint), partial(_rear, design)),
        mirrors(x_mirror, 0.8 * half, half, z_mirror, design.paint),
        plates(profile.length_m / 2, -profile.length_m / 2, z_front, z_rear),
        *extras,
    )
    return body, vehicle_wheels(profile.axles, profile.length_m, 0.97 * half)


def pickup() -> Drawn:
    """A double-cab pickup with an open bed."""
    return car(PICKUP, (_pickup_bed(PICKUP),))


def police() -> Drawn:
    """A police estate with Battenburg markings and a light bar."""
    return car(POLICE, (light_bar(POLICE.profile.length_m / 2 - 2.75, 1.455, 0.58, 0.3, 0.145),))
