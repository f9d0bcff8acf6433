"""Rulebooks: what they may say, and that the shipped ones can be read."""

import pytest

from siren_ros.base.params.folders import names_in_params
from siren_ros.base.tables import Measure
from siren_ros.errors import InputError
from siren_ros.reports.exam.grading import FOLDER, Clause, Grade, grade_of, load_rulebook, worst_of
from siren_ros.reports.exam.monitors import MONITORS, Finding


def test_every_rulebook_can_be_read_and_together_they_use_every_monitor():
    books = [load_rulebook(name) for name in names_in_params(FOLDER)]
    assert {"california", "germany", "international"} <= {book.name for book in books}
    assert {clause.monitor for book in books for clause in book.clauses} == {*MONITORS}


WRITTEN = """\
title: Somewhere
heard_m: 40
reaction_s: 3
clauses:
  - {id: one, title: One, text: Do so., source: A law, monitor: braking, numbers: {lasting_s: 0.3}, minor: 4, major: 6}
"""


@pytest.mark.parametrize(
    ("before", "after", "named"),
    [
        ("monitor: braking", "monitor: breaking", "monitor"),
        ("lasting_s: 0.3", "lasting_s: -1", "lasting_s"),
        ("numbers: {lasting_s: 0.3}, ", "", "numbers"),
        ("major: 6", "major: 4", "major"),
        ("minor: 4", "minor: 4, extra: 1", "extra"),
        ("heard_m: 40", "heard_m: none", "heard_m"),
        ("source: A law, ", "", "source"),
    ],
)
def test_what_is_wrong_in_a_rulebook_is_named(tmp_path, before, after, named):
    file = tmp_path / "book.yaml"
    file.write_text(WRITTEN, encoding="utf-8")
    assert load_rulebook(str(file)).clauses[0].numbers == {"lasting_s": 0.3}
    file.write_text(WRITTEN.replace(before, after), encoding="utf-8")
    with pytest.raises(InputError, match=named):
        load_rulebook(str(file))


def test_two_clauses_need_two_ids(tmp_path):
    file = tmp_path / "book.yaml"
    file.write_text(WRITTEN + WRITTEN.splitlines()[-1] + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="an id of its own"):
        load_rulebook(str(file))


def clause(minor, major):
    return Clause("one", "One", "Do so.", "A law", "braking", {}, minor, major)


@pytest.mark.parametrize(
    ("minor", "major", "value", "grade"),
    [
        (4.0, 6.0, 4.0, Grade.PASS),
        (4.0, 6.0, 4.1, Grade.MINOR),
        (4.0, 6.0, 6.1, Grade.MAJOR),
        (1.0, 0.5, 1.0, Grade.PASS),
        (1.0, 0.5, 0.9, Grade.MINOR),
        (1.0, 0.5, 0.4, Grade.MAJOR),
    ],
)
def test_which_values_are_worse_follows_from_the_limits(minor, major, value, grade):
    assert grade_of(clause(minor, major), Finding(Measure(value))) is grade


def test_a_missing_value_is_not_applicable_and_the_worst_grade_counts():
    assert grade_of(clause(4.0, 6.0), Finding(Measure.lacking("nobody came"))) is Grade.NOT_APPLICABLE
    assert worst_of([Grade.PASS, Grade.MAJOR, Grade.MINOR]) is Grade.MAJOR
    assert worst_of([Grade.NOT_APPLICABLE, Grade.PASS]) is Grade.PASS
    assert worst_of([]) is Grade.NOT_APPLICABLE
