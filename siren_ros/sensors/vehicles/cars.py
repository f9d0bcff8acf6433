"""Shapes of cars: shells lofted along the outlines of ``car_designs`` with glass, lamps, mirrors, plates and wheels."""

import itertools
from dataclasses import replace

from siren_ros.sensors.meshes.loft import Band, EndFinish, Finish, ShellFinish, loft
from siren_ros.sensors.meshes.mesh import Mesh, Wheel
from siren_ros.sensors.meshes.primitives import box
from siren_ros.sensors.vehicles.car_designs import (
    CarDesign,
    Span,
    estate_design,
    hatchback_design,
    pickup_design,
    police_design,
    sedan_design,
    suv_design,
    van_design,
)
from siren_ros.sensors.vehicles.vehicle_parts import (
    BLUE_LIVERY,
    BRAKE_LAMP,
    GLASS,
    GRILLE,
    HEAD_LAMP,
    PLASTIC,
    YELLOW_LIVERY,
    indicator,
    light_bar,
    mirrors,
    plates,
)
from siren_ros.sensors.vehicles.wheels import axle_wheels


def _within(s_m: float, spans: tuple[Span, ...]) -> bool:
    return any(low < s_m < high for low, high in spans)


def _shell_finish(design: CarDesign) -> ShellFinish:
    def finish(band: Band, s_m: float, side: int) -> Finish:
        if band <= Band.WELL_ROOF:
            return PLASTIC
        return _flank(design, band, s_m, side) if band <= Band.UPPER_SIDE else _greenhouse(design, band, s_m)

    return finish


def _greenhouse(design: CarDesign, band: Band, s_m: float) -> Finish:
    """Windows, the dark pillars between them, and the roof."""
    if band is Band.WINDOW and _within(s_m, design.side_windows):
        return GLASS
    if band is Band.WINDOW and _within(s_m, ((design.side_windows[0][0], design.side_windows[-1][1]),)):
        return GRILLE
    if band is Band.ROOF and _within(s_m, (design.windscreen, design.rear_screen)):
        return GLASS
    return design.paint


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


def _front_finish(design: CarDesign) -> EndFinish:
    def finish(band: Band, zone: int) -> Finish:
        if band is Band.UPPER_SIDE:
            return GRILLE if zone == 0 else HEAD_LAMP if abs(zone) == 1 else indicator(zone)
        if band is Band.LOWER_SIDE:
            return GRILLE if abs(zone) < 2 else design.paint
        return design.paint

    return finish


def _rear_finish(design: CarDesign) -> EndFinish:
    tall = design.profile.top_m[-1][1] > 1.5

    def finish(band: Band, zone: int) -> Finish:
        if band is Band.UPPER_SIDE:
            return design.paint if zone == 0 else BRAKE_LAMP if abs(zone) == 1 else indicator(zone)
        if band is Band.LOWER_SIDE:
            return design.sill
        if band is Band.WINDOW and tall:
            return GLASS if abs(zone) < 2 else design.paint
        return design.paint

    return finish


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
    return Mesh.concatenate([*sides, gate, floor, *lamps, *signals])


def car(design: CarDesign, extras: tuple[Mesh, ...] = ()) -> tuple[Mesh, tuple[Wheel, ...]]:
    """Body and wheels of a car in ``base_link``, as drawn (not yet scaled)."""
    profile = replace(design.profile, extra_stations_m=(*design.profile.extra_stations_m, *_pillars(design)))
    half = max(w for _, w in profile.half_width_m)
    belt = dict(profile.belt_m)
    x_mirror = profile.length_m / 2 - design.mirror_s_m
    z_mirror = max(z for s, z in profile.belt_m if s <= design.mirror_s_m) + 0.02
    z_front = 0.5 * (profile.bottom_m[0][1] + profile.belt_m[0][1])
    z_rear = 0.35 * profile.bottom_m[-1][1] + 0.65 * belt[profile.length_m]
    body = Mesh.concatenate(
        [
            loft(profile, _shell_finish(design), _front_finish(design), _rear_finish(design)),
            mirrors(x_mirror, 0.8 * half, half, z_mirror, design.paint),
            plates(profile.length_m / 2, -profile.length_m / 2, z_front, z_rear),
            *extras,
        ]
    )
    front, rear = profile.axles
    wheels = (
        *axle_wheels(front, profile.length_m, 0.97 * half, steered=True),
        *axle_wheels(rear, profile.length_m, 0.97 * half, steered=False),
    )
    return body, wheels


def _pillars(design: CarDesign) -> tuple[float, ...]:
    """Where a side window ends and the next one begins."""
    windows = design.side_windows
    return tuple(s for one, following in itertools.pairwise(windows) for s in (one[1], following[0]))


def hatchback() -> tuple[Mesh, tuple[Wheel, ...]]:
    """A five-door compact car."""
    return car(hatchback_design())


def sedan() -> tuple[Mesh, tuple[Wheel, ...]]:
    """A four-door saloon with a boot."""
    return car(sedan_design())


def estate() -> tuple[Mesh, tuple[Wheel, ...]]:
    """A station wagon."""
    return car(estate_design())


def suv() -> tuple[Mesh, tuple[Wheel, ...]]:
    """A sport utility vehicle with dark sills."""
    return car(suv_design())


def van() -> tuple[Mesh, tuple[Wheel, ...]]:
    """A panel van."""
    return car(van_design())


def pickup() -> tuple[Mesh, tuple[Wheel, ...]]:
    """A double-cab pickup with an open bed."""
    design = pickup_design()
    return car(design, (_pickup_bed(design),))


def police() -> tuple[Mesh, tuple[Wheel, ...]]:
    """A police estate with Battenburg markings and a light bar."""
    design = police_design()
    bar = light_bar(design.profile.length_m / 2 - 2.75, 1.455, 0.58, 0.3, 0.145)
    return car(design, (bar,))
