from collections.abc import Mapping

import numpy as np
import pytest

from siren_ros.sensors.meshes.mesh import Material, Mesh, StaticScene, VehicleShape
from siren_ros.sensors.meshes.placement import Catalogue, Placement
from siren_ros.world.actors import ACTOR_STATE_DTYPES, ActorClass, ActorDescription, ActorStates

CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
FACES = np.array(
    [
        *[(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5)],
        *[(0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6)],
        *[(0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)],
    ]
)


class Boxes:
    """Hand-made worlds of axis-aligned boxes."""

    @staticmethod
    def box(
        centre: tuple[float, float, float],
        size: tuple[float, float, float],
        material: Material = Material.BUILDING_WALL,
    ) -> Mesh:
        return Mesh.uniform(CORNERS * size + centre, FACES, material, (200, 180, 160))

    @classmethod
    def scene(cls, *meshes: Mesh) -> StaticScene:
        ground = cls.box((0.0, 0.0, -0.5), (300.0, 300.0, 1.0), Material.ASPHALT)
        return StaticScene(Mesh.joined(ground, *meshes), ())

    @classmethod
    def shapes(cls) -> Mapping[ActorClass, VehicleShape]:
        sizes = {ActorClass.SEDAN: (4.6, 1.8, 1.4), ActorClass.BUS: (12.0, 2.5, 3.0)}
        return {
            kind: VehicleShape(kind, cls.box((0.0, 0.0, h / 2), (length, w, h), Material.CAR_PAINT), (), length, w, h)
            for kind, (length, w, h) in sizes.items()
        }

    @classmethod
    def actors(
        cls, *rows: tuple[ActorClass, float, float, float], **fields: list[float]
    ) -> tuple[ActorStates, dict[int, ActorDescription]]:
        """Actors 1, 2, … of (class, x, y, yaw); further state fields by name."""
        arrays = {name: np.zeros(len(rows), dtype) for name, dtype in ACTOR_STATE_DTYPES.items()}
        arrays["actor_id"] = np.arange(1, len(rows) + 1, dtype=np.uint32)
        for name, column in (("x_m", 1), ("y_m", 2), ("yaw_rad", 3)):
            arrays[name] = np.array([float(row[column]) for row in rows])
        for name, values in fields.items():
            arrays[name] = np.array(values, ACTOR_STATE_DTYPES[name])
        shapes = cls.shapes()
        descriptions = {}
        for actor_id, (kind, *_) in enumerate(rows, start=1):
            shape = shapes[kind]
            size = (shape.length_m, shape.width_m, shape.height_m)
            descriptions[actor_id] = ActorDescription(actor_id, f"v{actor_id}", kind, *size, (200, 20, 20))
        return ActorStates(step=0, **arrays), descriptions

    @classmethod
    def placed(cls, *rows: tuple[ActorClass, float, float, float], **fields: list[float]) -> Placement:
        return Catalogue(cls.shapes()).place(*cls.actors(*rows, **fields))


@pytest.fixture(name="boxes", scope="session")
def _boxes() -> type[Boxes]:
    return Boxes
