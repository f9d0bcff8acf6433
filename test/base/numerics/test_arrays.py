"""Units, random streams, and structures: how they change and how they show themselves."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from siren_ros.base.numerics import units
from siren_ros.base.numerics.arrays import (
    Brief,
    Columns,
    Floats,
    Ids,
    brief,
    chances,
    changed,
    drawn,
    dtypes_of,
    random_stream,
)
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


def test_fields_are_the_facts_and_a_class_may_have_others_and_long_text_ends_in_dots() -> None:
    assert repr(Thing("a", np.zeros((3, 2)), (1, 2))) == "Thing(name='a', values=<float64 3×2>, items=(1, 2))"
    assert repr(Named("a", np.zeros(3))) == "Named(name='a')"
    assert "&lt;script&gt;" in Named("<script>", np.zeros(3))._repr_html_()
    assert repr(Thing("a", np.zeros(3), tuple(range(10_000)))).endswith("items=<tuple of 10000>)")
    assert len(brief("x" * 1000)) == 74
    assert brief("x" * 1000).endswith("…'")
    many = type("Many", (Brief,), {"facts": lambda _: {f"name_{number}": number for number in range(1000)}})
    assert len(repr(many())) < 820


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        *[(1.23456789, "1.23457"), (Owner.SUMO, "SUMO"), (Path("a/b"), "'a/b'"), ({"a": 1}, "{'a': 1}")],
        *[({"a": [1]}, "<dict of 1>"), (b"0123456789", "<bytes of 10>"), (["x" * 50] * 2, "<list of 2>")],
        *[(np.zeros(2, [("x", np.float32)]), "<record 2>"), (object(), "<object>"), (None, "None")],
    ],
)
def test_values_are_short(value: object, shown: str) -> None:
    assert brief(value) == shown


def test_twenty_steps_make_a_second():
    assert (units.STEP_NS, units.STEP_S, units.STEPS_PER_S) == (50_000_000, 0.05, 20)
    assert [units.steps_from_s(duration) for duration in (0.0, 0.05, 0.5, 1.0, 0.12, 0.13)] == [0, 1, 10, 20, 2, 3]
    assert units.mps_from_kmh(36.0) == pytest.approx(10.0)
    assert units.NEVER + units.steps_from_s(3600.0 * 24.0) < 0, "longer before a start than an episode lasts"
    for step in (0, 1, 7, 10**6):
        assert units.time_ns_of_step(step) == step * 50_000_000
        assert units.step_of_time_ns(units.time_ns_of_step(step)) == step
    for time_ns in (1, units.STEP_NS - 1, units.STEP_NS + 1):
        with pytest.raises(ValueError, match="not a multiple"):
            units.step_of_time_ns(time_ns)


@pytest.mark.parametrize(
    ("time_ns", "text"),
    [(0, "0"), (2_000_000_000, "2"), (2_000_000_001, "2.000000001"), (150_000_000, "0.15"), (-50_000_000, "-0.05")],
)
def test_seconds_are_told_to_the_nanosecond(time_ns, text):
    assert units.exact_s(time_ns) == text


def test_a_stream_depends_on_seed_purpose_and_index_alone():
    def first(*key):
        return random_stream(*key).random(4).tolist()

    assert first(3, "demand", 5) == first(3, "demand", 5)
    keys = [*((seed, "demand", 5) for seed in (0, 1, 3, 4)), (3, "driver", 5), (3, "demand", 6), (5, "demand", 3)]
    keys.append((3, "demand"))
    assert len({tuple(first(*key)) for key in keys}) == len(keys)
    assert first(3, "demand") == first(3, "demand", 0)
    assert np.mean(random_stream(1, "mean").random(10_000)) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("weights", [(1.0,), (0.3, 0.0, 0.7), (5.0, 1.0, 2.5, 0.1), tuple(range(1, 30))])
def test_choices_by_weight_are_those_of_numpy_and_take_as_much_from_the_generator(weights):
    own, numpys = random_stream(7, "choice"), random_stream(7, "choice")
    shares = np.array(weights) / np.sum(weights)
    ends = chances(weights)
    assert [drawn(ends, own) for _ in range(300)] == [numpys.choice(len(weights), p=shares) for _ in range(300)]
    assert own.random() == numpys.random()


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
    with pytest.raises(TypeError, match="Place has no field z_m"):
        changed(Place(1.0), z_m=3.0)


@dataclass(frozen=True, eq=False)
class Bodies(Columns):
    x_m: Floats
    actor_id: Ids


def test_columns_are_selected_joined_and_mixed_row_by_row():
    first, other = (Bodies(np.array(ids, float), np.array(ids, np.uint32)) for ids in ([1, 2, 3], [7, 8, 9]))
    mask = np.array([True, False, True])
    for made, ids in (
        *[(first.select(mask), [1, 3]), (first.select(np.array([2, 0])), [3, 1]), (first.select(mask & ~mask), [])],
        *[(Bodies.joined([other, first]), [7, 8, 9, 1, 2, 3]), (Bodies.where(mask, first, other), [1, 8, 3])],
        (Bodies.of_columns(first.columns), [1, 2, 3]),
    ):
        assert (made.actor_id.tolist(), made.x_m.tolist(), len(made)) == (ids, ids, len(ids))
    assert dtypes_of(Bodies) == {"x_m": np.float64, "actor_id": np.uint32}
