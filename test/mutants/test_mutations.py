"""Mutants of files, and the sample of a seed."""

from mutants.mutations import changed_lines, mutants_of, sample

SOURCE = "def area(a, b):\n    return a * b\n\n\ndef gap(a, b):\n    return a - b if a > b else 0\n"


def test_only_the_lines_that_are_asked_for():
    assert {mutant.line for mutant in mutants_of("f.py", SOURCE)} == {2, 6}
    assert {mutant.line for mutant in mutants_of("f.py", SOURCE, {6, 7})} == {6}
    assert mutants_of("f.py", SOURCE, {1}) == []


def test_a_seed_draws_the_same_sample_each_time_and_another_seed_another_one():
    every = mutants_of("f.py", SOURCE * 8)
    first = sample(every, 10, 1)
    assert first == sample(every, 10, 1)
    assert first != sample(every, 10, 2)
    assert len(set(first)) == 10
    assert set(first) <= set(every)
    assert [mutant.line for mutant in first] == sorted(mutant.line for mutant in first)
    assert sample(every, None, 1) == sample(every, 10_000, 2)
    assert set(sample(every, None, 1)) == set(every)


def test_the_difference_is_told_by_lines():
    turned = next(mutant for mutant in mutants_of("f.py", SOURCE) if mutant.operator == "ReplaceBinaryOperator_Mul_Div")
    assert changed_lines(turned, SOURCE) == ("return a * b", "return a / b")
