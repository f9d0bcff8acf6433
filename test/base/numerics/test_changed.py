from dataclasses import dataclass, replace

import pytest

from siren_ros.base.numerics.changed import changed


@dataclass(frozen=True)
class Place:
    x_m: float
    y_m: float = 0.0
    name: str = ""


def test_the_given_fields_change_and_the_structure_itself_does_not():
    place = Place(1.0, name="a")
    moved = changed(place, x_m=2.0, name="b")
    assert moved == replace(place, x_m=2.0, name="b")
    assert place == Place(1.0, name="a")
    assert changed(moved) == moved


def test_a_field_that_does_not_exist_is_refused():
    with pytest.raises(TypeError, match="Place has no field z_m"):
        changed(Place(1.0), z_m=3.0)
