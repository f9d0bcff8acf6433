"""Parts of shape files: copies, mirror images and finishes, and faults with their lines."""

import pytest

from siren_ros.base.params.parameters import parse_strict_yaml
from siren_ros.errors import InputError
from siren_ros.sensing.meshes.mesh import Mesh
from siren_ros.sensing.vehicles.parts import load_finishes, solids


def drawn(*rows: str) -> list[Mesh]:
    text = "parts:\n" + "".join(f"- {row}\n" for row in rows)
    return solids(parse_strict_yaml(text, "file.yaml").mappings("parts"), load_finishes())


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
