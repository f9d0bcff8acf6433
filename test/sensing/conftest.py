import numpy as np
import pytest

from siren_ros.sensing.camera.renderer import Renderer, RendererUnavailableError
from siren_ros.sensing.meshes.mesh import Catalogue, LampColour, Material, Mesh, SignalLamp, StaticScene, VehicleShape
from siren_ros.sensing.specification import map_from_base
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorClass, ActorDescription, ActorStates

CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6),
     (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
)  # fmt: skip


class Boxes:
    """Hand-made worlds of axis-aligned boxes."""

    @staticmethod
    def box(centre, size, material=Material.BUILDING_WALL):
        return Mesh.uniform(CORNERS * size + centre, FACES, material, (200, 180, 160))

    @classmethod
    def crossroads(cls):
        """The red lamp of a signal, 20 m ahead, and houses."""
        lamp = cls.box((20.0, -8.0, 5.0), (0.1, 1.0, 1.0), Material.SIGNAL_RED)
        houses = [cls.box((40.0, y, 5.0), (10.0, 10.0, 10.0)) for y in (-30.0, 30.0)]
        return StaticScene(cls.scene(lamp, *houses).mesh, (SignalLamp("s", 0, LampColour.RED, 12, 24),))

    @classmethod
    def scene(cls, *meshes):
        ground = cls.box((0.0, 0.0, -0.5), (300.0, 300.0, 1.0), Material.ASPHALT)
        return StaticScene(Mesh.joined(ground, *meshes), ())

    @classmethod
    def shapes(cls):
        sizes = {ActorClass.SEDAN: (4.6, 1.8, 1.4), ActorClass.BUS: (12.0, 2.5, 3.0)}
        return {
            kind: VehicleShape(kind, cls.box((0.0, 0.0, h / 2), (length, w, h), Material.CAR_PAINT), (), length, w, h)
            for kind, (length, w, h) in sizes.items()
        }

    @classmethod
    def actors(cls, *rows, **fields):
        """Actors 1, 2, … of (class, x, y, yaw); further state fields by name."""
        places = {name: [float(row[k]) for row in rows] for k, name in enumerate(("x_m", "y_m", "yaw_rad"), start=1)}
        known = {"actor_id": range(1, len(rows) + 1), **places, **fields}
        arrays = {
            name: np.array(known.get(name, np.zeros(len(rows))), dtype) for name, dtype in ACTOR_STATE_DTYPES.items()
        }
        descriptions = {}
        for actor_id, (kind, *_) in enumerate(rows, start=1):
            shape = cls.shapes()[kind]
            size = (shape.length_m, shape.width_m, shape.height_m)
            descriptions[actor_id] = ActorDescription(actor_id, f"v{actor_id}", kind, *size, (200, 20, 20))
        return ActorStates(step=0, **arrays), descriptions

    @classmethod
    def placed(cls, *rows, **fields):
        return Catalogue(cls.shapes()).place(*cls.actors(*rows, **fields))

    @classmethod
    def with_vehicles(cls, static, placement):
        """One scene of the static world and the vehicles."""
        parts = [static.mesh]
        for row, kind in enumerate(placement.actor_class):
            pose = map_from_base(placement.x_m[row], placement.y_m[row], 0.0, placement.yaw_rad[row])
            parts.append(cls.shapes()[ActorClass(int(kind))].body.transformed(pose[:3, :3], pose[:3, 3]))
        return StaticScene(Mesh.joined(*parts), ())

    @classmethod
    def renderer(cls, scene, look=None):
        """Skips the test on a machine without OpenGL."""
        try:
            return Renderer(scene, cls.shapes(), look)
        except RendererUnavailableError as error:
            pytest.skip(str(error))


@pytest.fixture(name="boxes", scope="session")
def _boxes():
    return Boxes
