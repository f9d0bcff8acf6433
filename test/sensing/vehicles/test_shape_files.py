"""Shape files: glass of the shipped cars lies in order, a file alone makes a new body, and faults name their lines."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml

from siren_ros.base.params.resources import params_dir
from siren_ros.errors import InputError
from siren_ros.sensing.meshes.mesh import Material
from siren_ros.sensing.meshes.solids import Band
from siren_ros.sensing.vehicles.shape_files import Shell, read_drawing

CARS = ("hatchback", "sedan", "estate", "suv", "van", "pickup", "police")


def shell_of(name: str) -> Shell:
    shell = read_drawing(name).shell
    assert shell is not None
    return shell


def glass(shell: Shell, band: Band) -> tuple[tuple[float, float], ...]:
    """Where a band has glass."""
    found = [row for row in shell.stripes if row.bands == (band,) and row.finish[0] is Material.CAR_GLASS]
    assert len(found) == 1
    return found[0].spans_m


@pytest.mark.parametrize("name", CARS)
def test_glass_lies_in_order(name: str) -> None:
    """Windscreen, side windows with pillars of 4 to 20 cm between them, and the rear screen."""
    shell = shell_of(name)
    spans, (windscreen, rear_screen) = glass(shell, Band.WINDOW), glass(shell, Band.ROOF)
    assert all(low < high for low, high in (windscreen, rear_screen, *spans))
    assert all(0.04 <= after[0] - before[1] <= 0.2 for before, after in pairwise(spans))
    assert 0.8 < windscreen[0] < spans[0][0] < windscreen[1] + 0.6
    assert windscreen[1] < rear_screen[0] + 1e-9
    assert spans[-1][1] <= rear_screen[1] <= shell.profile.length_m
    content = yaml.safe_load((params_dir() / "shapes" / f"{name}.yaml").read_text(encoding="utf-8"))
    (mirror,) = (part["mirror"] for part in content["parts"] if "mirror" in part)
    mirror_s_m = content["length_m"] / 2 - mirror[0]
    assert windscreen[0] < mirror_s_m < spans[0][1], "the mirror is at the first window"
    assert set(np.ravel(list(pairwise(spans)))[1:-1]) <= set(shell.profile.stations_m()), "a window ends at a pillar"


@pytest.mark.parametrize("name", CARS)
def test_axles_and_outlines_are_those_of_a_car(name: str) -> None:
    profile = shell_of(name).profile
    front, rear = profile.axles
    assert 0.6 < front.s_m < 1.2
    assert 0.5 < profile.length_m - rear.s_m < 1.3
    assert front.wheel_radius_m == rear.wheel_radius_m
    assert profile.top_m[-1][0] == profile.length_m
    steep = [
        abs((b[1] - a[1]) / (b[0] - a[0]))
        for a, b in pairwise(profile.half_width_m)
        if a[0] > 0.3 and profile.length_m - b[0] > 0.3
    ]
    assert max(steep) < 0.15, "the flanks have no steps"


def test_the_police_drive_the_estate() -> None:
    police, estate = shell_of("police").profile, shell_of("estate").profile
    for outline in ("top_m", "belt_m", "bottom_m", "half_width_m", "roof_half_width_m", "axles"):
        assert getattr(police, outline) == getattr(estate, outline)


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
        ("swing: arm", "swing: wing", "21: limbs[0].swing", "walking_leg"),
        ("limbs:", "limb:", "21: limb", "limbs"),
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


def test_nothing_at_all_is_no_body(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a part at least"):
        read_drawing(cart(tmp_path, "length_m: 1.0\nwheels: []\nparts: []\n"))
