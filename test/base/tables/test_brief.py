"""How objects with long content show themselves."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from siren_ros.base.tables.brief import Brief, brief
from siren_ros.simulation.world.actors import Owner


@dataclass(frozen=True)
class Thing(Brief):
    name: str
    values: np.ndarray
    items: tuple[int, ...] = ()
    hidden: str = field(default="hidden", repr=False)


@dataclass(frozen=True)
class Named(Thing):
    def facts(self) -> dict[str, object]:
        return {"name": self.name}


def test_fields_are_the_facts_and_a_class_may_have_others() -> None:
    assert repr(Thing("a", np.zeros((3, 2)), (1, 2))) == "Thing(name='a', values=<float64 3×2>, items=(1, 2))"
    assert repr(Named("a", np.zeros(3))) == "Named(name='a')"
    assert repr(Thing("a", np.zeros(3), tuple(range(10_000)))).endswith("items=<tuple of 10000>)")


def test_a_notebook_shows_text_and_no_markup() -> None:
    shown = Named("<script>", np.zeros(3))._repr_html_()
    assert shown == (
        '<table><caption>Named</caption><tbody><tr><th scope="row">name</th>'
        "<td>&#x27;&lt;script&gt;&#x27;</td></tr></tbody></table>"
    )


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (1.23456789, "1.23457"),
        (Owner.SUMO, "SUMO"),
        (Path("a/b"), "'a/b'"),
        ({"a": 1}, "{'a': 1}"),
        ({"a": [1]}, "<dict of 1>"),
        (b"0123456789", "<bytes of 10>"),
        (["x" * 50] * 2, "<list of 2>"),
        (np.zeros(2, [("x", np.float32)]), "<record 2>"),
        (object(), "<object>"),
        (None, "None"),
    ],
)
def test_values_are_short(value: object, shown: str) -> None:
    assert brief(value) == shown


def test_long_text_ends_in_dots() -> None:
    assert len(brief("x" * 1000)) == 74
    assert brief("x" * 1000).endswith("…'")
    many = type("Many", (Brief,), {"facts": lambda _: {f"name_{number}": number for number in range(1000)}})
    assert len(repr(many())) < 820
