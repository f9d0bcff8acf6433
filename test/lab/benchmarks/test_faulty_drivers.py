"""A lawful driver passes, a faulty one breaks what was written down for it; the benchmark judges all of them."""

import pytest

from siren_ros.lab.benchmarks.faulty_drivers import LAWFUL, broken_by, written_down
from siren_ros.reports.exam.rulebook import load_rulebook

SCENES, CASES = written_down()
QUICK = {
    *((LAWFUL, place) for place in ("california", "international")),
    ("no-indicator", "international"),
    ("brakes-hard", "germany"),
    ("creeps", "california"),
}


def test_what_is_written_down_are_clauses_of_the_rulebooks():
    for case in CASES:
        assert case.breaks <= {clause.clause_id for clause in load_rulebook(case.place).clauses}, case
    by_fault = {case.fault for case in CASES if case.breaks}
    assert by_fault == {case.fault for case in CASES} - {LAWFUL}


@pytest.mark.parametrize(
    "case", [case for case in CASES if (case.fault, case.place) in QUICK], ids=lambda one: one.driver
)
def test_it_breaks_what_was_written_down_and_nothing_else(case):
    scenes = ("platoon",) if case.fault == LAWFUL else case.scenes
    assert {clause for name in scenes for clause in broken_by(case.driver, case.place, SCENES[name])} == case.breaks
