"""What is changed, and what is left alone."""

import pytest

from mutants.mutations import changed_lines, mutants_of
from mutants.operators import ForgetField, TurnName, operators


def changes(source):
    return {changed_lines(mutant, source)[1] for mutant in mutants_of("code.py", source)}


@pytest.mark.parametrize("operator", [TurnName, ForgetField])
def test_the_examples_hold(operator):
    for example in operator.examples():
        texts = {mutant.text(example.pre_mutation_code) for mutant in mutants_of("x", example.pre_mutation_code)}
        assert example.post_mutation_code in texts


@pytest.mark.parametrize(
    ("source", "changed"),
    [
        ("x = a - b", "x = a + b"),
        ("x = a * b", "x = a / b"),
        ("x = a < b", "x = a <= b"),
        ("x = a < b", "x = a >= b"),
        ("x = gap_m < b", "x = gap_m >= b"),
        ("x = step < end_step", "x = step <= end_step"),
        ("SPEED_MPS: Final = 50.0 / 3.6", "SPEED_MPS: Final = 50.0 * 3.6"),
        ("x = -a", "x = +a"),
        ("x = not a", "x =  a"),
        ("x = a and b", "x = a or b"),
        ("f(True)", "f(False)"),
        ("f(3)", "f( 4)"),
        ("x = np.minimum(a, b)", "x = np.maximum(a, b)"),
        ("x = all(a)", "x = any(a)"),
        ("x = replace(unit, count=0, side=side)", "x = replace(unit, side=side)"),
    ],
)
def test_mistakes_of_a_tired_programmer_are_made(source, changed):
    assert changed in changes(source)


@pytest.mark.parametrize(
    "source",
    [
        "class Config:\n    width_m: float = 3.5",
        "def number(a: int | None) -> int | None: ...",
        "@dataclass(frozen=True)\nclass A: ...",
        "raise ValueError(f'{a + 1}')",
        "def min(a): ...",
        "def number(a, *, b): ...",
        "zip(a, b, strict=True)",
        "minimum = maximum",
        "LENGTH_M: Final = 3.5",
        "read(section.number('length_m', 0.5, 9.0))",
    ],
)
def test_settings_annotations_and_messages_are_left_alone(source):
    assert not changes(source)


def test_each_change_gives_another_program_and_says_where():
    source = "def f(a, b):\n    return max(a - b, 2.0) if a < b else -b\n"
    mutants = mutants_of("code.py", source)
    assert {mutant.line for mutant in mutants} == {2}
    texts = [mutant.text(source) for mutant in mutants]
    assert len(set(texts)) == len(texts)
    assert source not in texts
    for text in texts:
        compile(text, "code.py", "exec")


def test_the_operators_have_names_of_their_own():
    assert all(name == factory.__name__ for name, factory in operators().items())


@pytest.mark.parametrize("source", ["x = gap_m < b", "x = seen.speed_mps[row] < limit", "x = share < 0.5"])
def test_whether_a_limit_counts_as_inside_is_left_alone_where_measured_numbers_are_compared(source):
    assert source.replace("<", "<=") not in changes(source)
    assert source.replace("<", ">=") in changes(source)
