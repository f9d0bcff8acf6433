"""Rulebooks: what they may say, and that the shipped ones can be read."""

from dataclasses import replace

import pytest
from hand_made_record import Driven
from made_encounters import CAR, IN_LANE, arc, record_of

from siren_ros.base.params.folders import names_in_params
from siren_ros.base.tables import Measure
from siren_ros.errors import InputError
from siren_ros.reports.exam.grading import FOLDER, Clause, Grade, examine, grade_of, load_rulebook, worst_of
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


CLAUSE = WRITTEN.splitlines()[-1]


@pytest.mark.parametrize(
    ("before", "after", "named"),
    [
        (CLAUSE, f"{CLAUSE}\n{CLAUSE}", "an id of its own"),
        ("reaction_s: 3", "reaction_s: 3\nincludes: california", "includes none itself"),
        ("reaction_s: 3", "reaction_s: 3\nincludes: atlantis", "base"),
        ("reaction_s: 3", "reaction_s: 3\nheard_late_m: 41", "heard_late_m"),
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


def test_a_book_has_the_clauses_of_the_one_that_it_includes(tmp_path):
    file = tmp_path / "book.yaml"
    file.write_text(WRITTEN.replace("reaction_s: 3", "reaction_s: 3\nincludes: base"), encoding="utf-8")
    own, base = load_rulebook(str(file)), load_rulebook("base")
    assert own.clauses[:-1] == base.clauses
    assert (own.included, own.coverage, own.most_minor) == ({"base": base.sha256}, base.coverage, base.most_minor)
    assert own.heard_late_m == own.heard_m  # where the book names one distance
    # A clause of its own replaces one, and figures of its own count.
    changed = WRITTEN.replace("reaction_s: 3", "reaction_s: 3\nincludes: base\ncoverage: {traffic: 2}\nmost_minor: 0.5")
    file.write_text(changed.replace("id: one", "id: limit"), encoding="utf-8")
    own = load_rulebook(str(file))
    assert [clause.monitor for clause in own.clauses if clause.clause_id == "limit"] == ["braking"]
    assert (own.coverage, own.most_minor) == ({"traffic": 2}, 0.5)


def test_a_violation_of_a_duty_to_act_is_grave_if_it_is_one_by_the_latest_notice_too():
    # The EMV is heard at 36 m from the first step on, and at 8 m when its front is there: 21 m later, with 5 m/s more.
    late = Driven(IN_LANE, arc((5.0, 9.0), start_m=41.0))
    record = record_of(arc((10.0, 6.0), (5.0, 3.0)), {CAR: late})
    book = load_rulebook("international")

    def grade(**distances):
        marks = examine(record, CAR, replace(book, **distances)).marks
        return next(mark.grade for mark in marks if mark.clause.clause_id == "yield")

    assert grade(heard_m=50.0, heard_late_m=50.0) is Grade.MAJOR
    assert grade(heard_m=50.0, heard_late_m=8.0) is Grade.MINOR


def test_the_latest_notice_excuses_no_violation_but_those_of_duties_to_act():
    record = record_of(arc((10.0, 3.6), (0.0, 6.0)), {CAR: Driven(IN_LANE, arc((0.0, 10.0), start_m=50.0))})
    numbers = {"gap_m": 10.0, "slow_mps": 2.0, "left_line_m": 0.5}
    stuck = Clause("one", "One", "Do so.", "A law", "obstruction", numbers, 1.0, 3.0)
    book = replace(load_rulebook("international"), clauses=(stuck,), heard_m=50.0, heard_late_m=8.0)
    (mark,) = examine(record, CAR, book).marks  # the EMV stands 9 m behind it, where it is heard early alone
    assert mark.grade is Grade.MAJOR
