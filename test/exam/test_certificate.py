"""The certificate as tables, JSON, JUnit XML and a page."""

import json
from dataclasses import replace

import pytest
from defusedxml import ElementTree
from hand_made_record import Driven
from made_encounters import CAR, IN_LANE, arc, record_of

from siren_ros.exam.certificate import Certificate, as_json, as_junit, page_of
from siren_ros.exam.grading import Grade, examine
from siren_ros.exam.rulebook import load_rulebook
from siren_ros.study_report.page import html_of

BOOK = load_rulebook("california")


@pytest.fixture(scope="module")
def certificate():
    """A driver who stays in front of an EMV for 12 s, and one without any EMV behind."""
    blocks = record_of(arc((10.0, 4.0), (0.0, 12.0)), {CAR: Driven(IN_LANE, arc((0.0, 16.0), start_m=50.0))})
    alone = record_of(arc((10.0, 4.0)), {CAR: Driven(IN_LANE, arc((0.0, 4.0), start_m=50.0))}, siren=False)
    sittings = tuple(examine(record, CAR, BOOK, f"bags/{k} <b>") for k, record in enumerate((blocks, alone)))
    return Certificate("a <driver>", BOOK, sittings)


def marks(sitting):
    return {mark.clause.clause_id: mark.grade for mark in sitting.marks}


def test_the_driver_in_the_way_does_not_pass(certificate):
    first, second = map(marks, certificate.sittings)
    assert first["obstruction"] is Grade.MAJOR
    assert second["obstruction"] is Grade.NOT_APPLICABLE
    assert certificate.grade is Grade.MAJOR
    assert not certificate.passed
    assert Certificate("x", BOOK, certificate.sittings[1:]).passed  # it touched nobody
    assert not Certificate("x", BOOK, ()).passed


def test_the_same_exam_gives_the_same_json(certificate):
    again = Certificate(certificate.driver, BOOK, certificate.sittings)
    assert as_json(certificate) == as_json(again)
    content = json.loads(as_json(certificate))
    (mark,) = [one for one in content["episodes"][0]["marks"] if one["clause"] == "obstruction"]
    assert mark["grade"] == "major"
    assert mark["value"] == pytest.approx(12.0, abs=0.1)
    assert mark["time_s"] is not None


def test_junit_counts_failures_and_skipped_cases(certificate):
    root = ElementTree.fromstring(as_junit(certificate))
    for suite, sitting in zip(root, certificate.sittings, strict=True):
        grades = [mark.grade for mark in sitting.marks]
        assert suite.get("tests") == str(len(suite)) == str(len(grades))
        assert suite.get("failures") == str(len(suite.findall("testcase/failure"))) == str(grades.count(Grade.MAJOR))
        assert suite.get("skipped") == str(len(suite.findall("testcase/skipped")))
    failure = root[0].find("testcase/failure")
    assert "siren view" in failure.text
    assert "--actor 2" in failure.text


def test_the_page_escapes_names_and_names_the_moment(certificate):
    page = html_of(page_of(certificate, "./env siren exam bags"))
    assert "a &lt;driver&gt; does not pass" in page
    assert "<driver>" not in page
    assert "siren view" in page
    nothing = replace(certificate, sittings=certificate.sittings[1:])
    assert "There is none." in html_of(page_of(nothing, "./env siren exam bags"))
