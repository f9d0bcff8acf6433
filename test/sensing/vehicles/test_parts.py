"""Parts of shape files: copies, mirror images and finishes, and faults with their lines."""

import numpy as np
import pytest
from solids import volume

from siren_ros.base.params.parameters import parse_strict_yaml
from siren_ros.errors import InputError
from siren_ros.sensing.meshes.mesh import Material, Mesh
from siren_ros.sensing.vehicles.parts import load_finishes, solids


def drawn(*rows: str) -> list[Mesh]:
    text = "parts:\n" + "".join(f"- {row}\n" for row in rows)
    return solids(parse_strict_yaml(text, "file.yaml").mappings("parts"), load_finishes())


def test_a_mirrored_part_stands_on_both_sides_with_its_normals_outward() -> None:
    for row in (
        "{box: [0.0, 0.2, 0.0, 1.0, 0.5, 1.0], finish: steel, mirrored: true}",
        (
            "{block: [0, 0.2, 0, 1, 0.2, 0, 1, 0.6, 0, 0, 0.6, 0, 0, 0.2, 1, 1, 0.2, 1, 1, 0.5, 1, 0, 0.5, 1],"
            " finish: steel, mirrored: true}"
        ),
        "{mirror: [1.0, 0.6, 0.9, 1.0, 0.2], finish: steel, mirrored: true}",
        "{rod: [0, 0.2, 0, 0, 0.5, 0.3, 0, 0.5, 0.9], radii_m: [0.1, 0.05, 0.1], finish: steel, mirrored: true}",
        "{ellipsoid: [0.0, 0.5, 1.0, 0.1, 0.2, 0.3], finish: steel, mirrored: true}",
    ):
        left, right = drawn(row)
        assert volume(left) > 0.0
        assert volume(right) == pytest.approx(volume(left), rel=1e-5)
        (low, high), (mirrored_low, mirrored_high) = left.bounds_m, right.bounds_m
        np.testing.assert_allclose((mirrored_low[1], mirrored_high[1]), (-high[1], -low[1]), atol=0.02)


def test_copies_stand_one_step_apart_and_their_finishes_take_turns() -> None:
    meshes = drawn("{box: [0, 0, 0, 1, 1, 1], finish: [red_livery, white_livery], repeat: 3, step_m: [2.0, 0.0, 0.5]}")
    np.testing.assert_allclose([mesh.bounds_m[0] for mesh in meshes], [(0, 0, 0), (2, 0, 0.5), (4, 0, 1)])
    red, white = (load_finishes()[name][1] for name in ("red_livery", "white_livery"))
    assert [tuple(mesh.colour_rgb[0]) for mesh in meshes] == [red, white, red]
    (strip,) = drawn("{arc: [0.5, 0.3, 0.4, 0.0, 120.0, 0.02], finish: plastic}")
    distance = np.hypot(strip.vertices_m[:, 0] - 0.5, strip.vertices_m[:, 2] - 0.3)
    assert 0.36 < distance.min() < distance.max() < 0.43
    assert strip.bounds_m[0][2] > 0.27


def test_a_mirrored_group_is_drawn_side_by_side() -> None:
    meshes = drawn("mirrored: true\n  parts:\n  - {box: [0, 0.2, 0, 1, 0.4, 1], finish: indicator}\n"
                   "  - {box: [0, 0.2, 2, 1, 0.4, 3], finish: brake_lamp}")  # fmt: skip
    assert [Material(int(mesh.material[0])) for mesh in meshes] == [
        *(Material.INDICATOR_LEFT_LAMP, Material.BRAKE_LAMP, Material.INDICATOR_RIGHT_LAMP, Material.BRAKE_LAMP)
    ]
    assert [float(mesh.bounds_m[0][1]) for mesh in meshes] == pytest.approx([0.2, 0.2, -0.4, -0.4])


@pytest.mark.parametrize(
    ("row", "allowed"),
    [
        ("{finish: steel}", "one of box"),
        ("{box: [0, 0, 0, 1, 1, 1], rod: [0, 0, 0, 1, 1, 1], finish: steel}", "one of box"),
        ("{box: [0, 0, 0, 1, -1, 1], finish: steel}", "the lower corner first"),
        ("{box: [0, 0, 0, 1, 1, 1], finish: brass}", "steel"),
        ("{box: [0, 0, 0, 1, 1, 1], finish: steel, colour: red}", "mirrored"),
        ("{box: [0, 0, 0, 1, 1, 1], finish: steel, repeat: 1, step_m: [1, 0, 0]}", "from 2 to 100"),
        ("{rod: [0, 0, 0, 0, 0, 0], radii_m: [0.1, 0.1], finish: steel}", "another place"),
        ("{rod: [0, 0, 0, 0, 0, 1], radii_m: [0.1], finish: steel}", "a list of 2 numbers"),
    ],
)
def test_a_part_that_cannot_be_drawn_is_refused(row: str, allowed: str) -> None:
    with pytest.raises(InputError, match=r"file.yaml:2: parts\[0\]") as raised:
        drawn(row)
    assert allowed in str(raised.value)
