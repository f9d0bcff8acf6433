"""The shape of each vehicle class, fitted to the exact dimensions and axle positions of the vehicle parameters."""

from dataclasses import replace
from functools import cache

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Floats32
from siren_ros.sensing.meshes.mesh import Limb, VehicleShape, Wheel
from siren_ros.sensing.vehicles.shape_files import Drawing, read_drawing
from siren_ros.simulation.dynamics.parameters import VehicleParameters, load_vehicle_parameters
from siren_ros.simulation.world.actors import ActorClass


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
