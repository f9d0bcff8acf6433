"""Every vehicle keeps its looks: areas, places and colours of its materials are those that were looked at.

Bags and detectors depend on the shapes. Whoever changes one on purpose looks at its picture, and then prints the
figures anew: ``python test/sensing/vehicles/test_shape_figures.py > test/sensing/vehicles/shape_figures.json``.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from siren_ros.sensing.meshes.mesh import Material
from siren_ros.sensing.vehicles.vehicle_shapes import vehicle_shape
from siren_ros.simulation.world.actors import VEHICLE_CLASSES, ActorClass

FIGURES = Path(__file__).with_name("shape_figures.json")


def figures(actor_class):
    """Of each material: area in m², its middle's x and z in metres, and its mean colour."""
    mesh = vehicle_shape(actor_class).at_rest
    corners = mesh.vertices_m.astype(np.float64)[mesh.triangles]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    values = np.column_stack((corners.mean(axis=1)[:, [0, 2]], mesh.colour_rgb))
    by_material = {}
    for code in np.unique(mesh.material):
        part = mesh.material == code
        means = np.average(values[part], axis=0, weights=area[part])
        by_material[Material(code).name.lower()] = [round(float(value), 3) for value in (area[part].sum(), *means)]
    return by_material


@pytest.mark.parametrize("actor_class", list(ActorClass), ids=lambda kind: kind.name.lower())
def test_materials_keep_their_areas_places_and_colours(actor_class):
    expected = json.loads(FIGURES.read_text(encoding="utf-8"))[actor_class.name.lower()]
    measured = figures(actor_class)
    assert measured.keys() == expected.keys()
    for material, values in expected.items():
        assert measured[material] == pytest.approx(values, rel=1e-3, abs=2e-3), material


@pytest.mark.parametrize(
    "actor_class",
    [kind for kind in VEHICLE_CLASSES if kind is not ActorClass.BICYCLE],
    ids=lambda kind: kind.name.lower(),
)
def test_indicators_are_as_large_on_both_sides(actor_class):
    measured = figures(actor_class)
    assert measured["indicator_left_lamp"] == pytest.approx(measured["indicator_right_lamp"], abs=2e-3)


if __name__ == "__main__":
    by_class = {kind.name.lower(): figures(kind) for kind in ActorClass}
    rows = (
        f' "{name}": {{\n' + ",\n".join(f'  "{part}": {json.dumps(row)}' for part, row in of.items()) + "\n }"
        for name, of in by_class.items()
    )
    print("{\n" + ",\n".join(rows) + "\n}")  # noqa: T201 - a development command
