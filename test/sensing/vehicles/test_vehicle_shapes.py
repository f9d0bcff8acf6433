"""Vehicles' shapes: drawings and their faults, fitted sizes, and looks that every vehicle keeps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_outputs import assert_known
from solids import by_material

from siren_ros.errors import InputError
from siren_ros.sensing.meshes.mesh import Material
from siren_ros.sensing.vehicles.vehicle_shapes import read_drawing, scaled, vehicle_shape
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.world.actors import TWO_WHEELED, VEHICLE_CLASSES, ActorClass

CARS = [ActorClass.HATCHBACK, ActorClass.SEDAN, ActorClass.ESTATE, ActorClass.SUV, ActorClass.VAN, ActorClass.PICKUP]
cars_and_larger = pytest.mark.parametrize(
    "actor_class", [kind for kind in VEHICLE_CLASSES if kind not in TWO_WHEELED], ids=lambda c: c.name.lower()
)
every_class = pytest.mark.parametrize("actor_class", VEHICLE_CLASSES, ids=lambda c: c.name.lower())


def cast(mesh, rays):
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(o3d.core.Tensor(mesh.vertices_m), o3d.core.Tensor(mesh.triangles))
    answer = scene.cast_rays(o3d.core.Tensor(rays.astype(np.float32)))
    return answer["t_hit"].numpy(), answer["primitive_ids"].numpy()


@every_class
def test_body_and_wheels_fill_exactly_the_parameters_box(actor_class):
    shape, size = vehicle_shape(actor_class), load_vehicle_parameters()[actor_class]
    low, high = shape.at_rest.bounds_m
    half = np.float32([size.length_m / 2, size.width_m / 2, size.height_m])
    np.testing.assert_array_equal(high, half)
    np.testing.assert_array_equal(low[:2], -half[:2])
    assert abs(low[2]) < 1e-6
    assert (shape.length_m, shape.width_m, shape.height_m) == (size.length_m, size.width_m, size.height_m)


@every_class
def test_rays_from_outside_meet_front_faces_only(actor_class):
    mesh = vehicle_shape(actor_class).at_rest
    rng = np.random.default_rng(5)
    direction = rng.normal(size=(6000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    target = rng.uniform(-0.45, 0.45, (6000, 3)) * (mesh.bounds_m[1] - mesh.bounds_m[0]) + mesh.vertices_m.mean(axis=0)
    distance, triangle = cast(mesh, np.concatenate((target - 30.0 * direction, direction), axis=1))
    hit = np.isfinite(distance)
    facing = np.einsum("ij,ij->i", mesh.normals[triangle[hit]], direction[hit])
    assert hit.sum() > (2000 if actor_class in TWO_WHEELED else 3000)  # much of a bicycle is air
    # Grazing rays may slip through the edge between two faces.
    assert (facing > 1e-3).mean() < 0.002


def test_somebody_smaller_is_smaller_in_all_parts():
    size = load_vehicle_parameters()[ActorClass.PEDESTRIAN]
    child = replace(size, length_m=size.length_m / 2.0, height_m=0.75 * size.height_m)
    drawing = read_drawing("pedestrian")
    adult, small = (scaled(ActorClass.PEDESTRIAN, drawing, each) for each in (size, child))
    assert (small.length_m, small.width_m, small.height_m) == (child.length_m, size.width_m, child.height_m)
    stretch = (0.5, 1.0, 0.75)
    np.testing.assert_allclose(small.at_rest.vertices_m, adult.at_rest.vertices_m * stretch, atol=1e-6)
    for limb, whole in zip(small.limbs, adult.limbs, strict=True):
        assert limb.joint_m == pytest.approx(np.multiply(whole.joint_m, stretch))


CART = """
length_m: 2.0
wheels:
- {s_m: 0.4, radius_m: 0.2, width_m: 0.1, outer_y_m: 0.5}
- {s_m: 1.5, radius_m: 0.2, width_m: 0.1, outer_y_m: 0.5}
shell:
  paint: red_paint
  top_m: [0.0, 0.8, 1.0, 0.9]
  belt_m: [0.0, 0.5, 1.0, 0.5]
  bottom_m: [0.0, 0.2, 1.0, 0.2]
  half_width_m: [0.0, 0.5, 1.0, 0.5]
  roof_half_width_m: [0.0, 0.4, 1.0, 0.4]
  sides:
  - {bands: [upper_side, lower_side], s_m: [0.0, 0.5], finish: indicator}
  - {bands: upper_side, finish: glass}
  front:
    window: [glass, paint, head_lamp]
parts:
- {box: [-1.0, -0.5, 0.3, 0.0, 0.5, 0.5], finish: plastic}
limbs:
- swing: arm
  joint_m: [0.0, 0.3, 0.5]
  mirrored: true
  parts:
  - {rod: [0.0, 0.3, 0.5, 0.1, 0.4, 0.3], radii_m: [0.05, 0.04], finish: jacket}
"""


def cart(folder: Path, text: str = CART) -> str:
    file = folder / "cart.yaml"
    file.write_text(text, encoding="utf-8")
    return str(file)


def test_a_file_alone_makes_a_new_body(tmp_path: Path) -> None:
    drawing = read_drawing(cart(tmp_path))
    low, high = drawing.body.bounds_m
    np.testing.assert_allclose((low, high), [(-1.0, -0.5, 0.2), (1.0, 0.5, 0.9)], atol=1e-6)
    assert [wheel.steered for wheel in drawing.wheels] == [True, True, False, False]
    assert [round(wheel.hub_m[1], 6) for wheel in drawing.wheels] == [0.45, -0.45] * 2
    assert drawing.shell is not None
    assert [axle.s_m for axle in drawing.shell.profile.axles] == [0.4], "the shell ends before the rear axle"
    left, right = drawing.limbs
    assert (left.joint_m, right.joint_m) == ((0.0, 0.3, 0.5), (0.0, -0.3, 0.5))
    np.testing.assert_allclose(left.mesh.bounds_m[1][1], -right.mesh.bounds_m[0][1], atol=1e-3)
    with pytest.raises(InputError, match="a part at least"):
        read_drawing(cart(tmp_path, "length_m: 1.0\nwheels: []\nparts: []\n"))


def test_the_first_stripe_that_covers_a_face_gives_its_finish(tmp_path: Path) -> None:
    mesh = read_drawing(cart(tmp_path)).body
    middle = mesh.vertices_m[mesh.triangles].mean(axis=1)
    faces = {kind: middle[mesh.material == kind] for kind in map(Material, np.unique(mesh.material))}
    assert (faces[Material.INDICATOR_LEFT_LAMP][:, 1] > 0.0).all()
    assert (faces[Material.INDICATOR_RIGHT_LAMP][:, 1] < 0.0).all()
    assert faces[Material.INDICATOR_LEFT_LAMP][:, 0].min() > 0.5
    behind = faces[Material.CAR_GLASS][faces[Material.CAR_GLASS][:, 0] < 0.99]
    assert 0.0 <= behind[:, 0].min() <= behind[:, 0].max() < 0.5
    corner = np.abs(faces[Material.HEAD_LAMP])
    np.testing.assert_allclose(corner[:, 0], 1.0)
    assert corner[:, 1].min() > np.abs(faces[Material.CAR_PAINT][:, 1]).max()


@pytest.mark.parametrize(
    ("was", "becomes", "place", "allowed"),
    [
        ("length_m: 2.0", "length_m: 0.0", "2: length_m", "from 0.1"),
        ("outer_y_m: 0.5}\nshell", "outer_y: 0.5}\nshell", "5: wheels[1].outer_y_m", "missing"),
        ("s_m: 1.5", "s_m: 0.3", "4: wheels", "the front axle first"),
        ("paint: red_paint", "paint: crimson", "7: shell.paint", "red_paint"),
        ("top_m: [0.0, 0.8, 1.0, 0.9]", "top_m: [0.0, 0.8, 1.0]", "8: shell.top_m", "a multiple"),
        ("top_m: [0.0, 0.8, 1.0, 0.9]", "top_m: [0.0, 0.8]", "8: shell.top_m", "two knots or more"),
        ("top_m: [0.0, 0.8, 1.0, 0.9]", "top_m: [0.0, 0.1, 1.0, 0.1]", "8: shell.top_m", "roof above the belt"),
        ("[upper_side, lower_side]", "[upper_side, bonnet]", "14: shell.sides[0].bands", "well_roof"),
        ("[glass, paint, head_lamp]", "[glass, paint]", "17: shell.front.window", "from the middle outward"),
        ("front:", "nose:", "17: shell.nose", "front"),
        *[("swing: arm", "swing: wing", "21: limbs[0].swing", "walking_leg"), ("limbs:", "limb:", "21: limb", "limbs")],
    ],
)
def test_a_fault_is_named_with_its_line_and_what_is_allowed(
    was: str, becomes: str, place: str, allowed: str, tmp_path: Path
) -> None:
    assert CART.count(was) == 1
    with pytest.raises(InputError) as raised:
        read_drawing(cart(tmp_path, CART.replace(was, becomes)))
    assert f"cart.yaml:{place}" in str(raised.value)
    assert allowed in str(raised.value)


def figures(actor_class):
    """Of each material: triangles, area in m², the middle in metres, mean normal and mean colour; wheels and limbs."""
    shape = vehicle_shape(actor_class)
    wheels = [[*wheel.hub_m, wheel.radius_m, wheel.steered, len(wheel.mesh)] for wheel in shape.wheels]
    limbs = [[*limb.joint_m, limb.swing, len(limb.mesh)] for limb in shape.limbs]
    return {**by_material(shape.at_rest), "wheels": wheels, "limbs": limbs}


def test_shapes_have_their_materials_wheels_and_limbs() -> None:
    known = {kind.name: figures(kind) for kind in ActorClass}
    assert_known(Path(__file__).parent / "known" / "shapes.json", known, digits=5, decimals=3)
