"""Certificates of an exam as page, JSON and JUnit XML, and two of them compared."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from defusedxml import ElementTree
from hand_made_record import Driven
from made_encounters import CAR, IN_LANE, arc, record_of

from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.plain_files import sha256_of
from siren_ros.errors import InputError
from siren_ros.reports.exam.certificate import (
    Certificate,
    as_json,
    as_junit,
    compared,
    page_of,
    read_certificate,
    violations_of,
)
from siren_ros.reports.exam.grading import FOLDER, Grade, Sitting, examine, load_rulebook
from siren_ros.reports.study_report.page import EpisodePages, html_of
from siren_ros.running.generation.closed_loop import AnswerTimes

WHOLE = load_rulebook("california")
BOOK = replace(WHOLE, coverage={})
"""The book without the least number of episodes."""


@pytest.fixture(scope="module")
def certificate():
    """A driver who stays in front of an EMV for 12 s, and one without any EMV behind."""
    blocks = record_of(arc((10.0, 4.0), (0.0, 12.0)), {CAR: Driven(IN_LANE, arc((0.0, 16.0), start_m=50.0))})
    alone = record_of(arc((10.0, 4.0)), {CAR: Driven(IN_LANE, arc((0.0, 4.0), start_m=50.0))}, siren=False)
    sittings = tuple(examine(record, CAR, BOOK, f"bags/{k} <b>") for k, record in enumerate((blocks, alone)))
    return Certificate("a <driver>", BOOK, sittings)


def marks(sitting):
    return {mark.clause.clause_id: mark.grade for mark in sitting.marks}


def test_the_driver_in_the_way_does_not_pass_and_the_same_exam_gives_the_same_json(certificate):
    first, second = map(marks, certificate.sittings)
    assert first["obstruction"] is Grade.MAJOR
    assert second["obstruction"] is Grade.NOT_APPLICABLE
    assert certificate.grade is Grade.MAJOR
    assert not certificate.passed
    assert Certificate("x", BOOK, certificate.sittings[1:]).passed  # it touched nobody
    assert not Certificate("x", BOOK, ()).passed
    again = Certificate(certificate.driver, BOOK, certificate.sittings)
    assert as_json(certificate) == as_json(again)
    content = json.loads(as_json(certificate))
    (mark,) = [one for one in content["episodes"][0]["marks"] if one["clause"] == "obstruction"]
    assert mark["grade"] == "major"
    assert mark["value"] == pytest.approx(12.0, abs=0.1)
    assert mark["time_s"] is not None


def test_a_certificate_needs_enough_episodes_and_few_violations(certificate):
    kept = certificate.sittings[1]
    (made_way,) = [clause for clause in WHOLE.clauses if clause.clause_id == "yield"]

    def sitting(grade):
        marks = tuple(replace(mark, grade=grade) if mark.clause == made_way else mark for mark in kept.marks)
        return replace(kept, marks=marks)

    def lacks(passes, minors):
        sittings = (*(sitting(Grade.PASS),) * passes, *(sitting(Grade.MINOR),) * minors)
        whole = Certificate("x", WHOLE, sittings)
        assert whole.passed is not bool(whole.lacks)
        return whole.lacks

    # Traffic's clauses apply in all of them.
    assert lacks(30, 0) == ()
    assert lacks(29, 0) == tuple(f"{name}: applied in 29 episodes, at least 30 are needed" for name in WHOLE.coverage)
    assert "making way: applied in 0" in Certificate("x", WHOLE, (kept,) * 30).lacks[0]
    # Wilson's interval of 6 of 30 begins at 9.5 %, that of 7 of 30 at 11.8 %.
    assert lacks(24, 6) == ()
    assert lacks(23, 7) == ("Responds at once: violated in 7 of 30 episodes",)


def test_junit_counts_failures_and_skipped_cases(certificate):
    root = ElementTree.fromstring(as_junit(certificate))
    last = root[-1]  # what else keeps the driver from passing
    assert [case.get("name") for case in last] == [*certificate.lacks]
    assert last.get("failures") == str(len(certificate.lacks))
    for suite, sitting in zip(root[:-1], certificate.sittings, strict=True):
        grades = [mark.grade for mark in sitting.marks]
        assert suite.get("tests") == str(len(suite)) == str(len(grades))
        assert suite.get("failures") == str(len(suite.findall("testcase/failure"))) == str(grades.count(Grade.MAJOR))
        assert suite.get("skipped") == str(len(suite.findall("testcase/skipped")))
    failure = root[0].find("testcase/failure")
    assert "siren view" in failure.text
    assert "--actor 2" in failure.text


def test_junit_can_be_read_whatever_a_program_or_a_rulebook_says(certificate):
    """A CI loses the whole report otherwise, just when the program crashes."""
    first = certificate.sittings[0]
    marked = replace(
        first.marks[0],
        grade=Grade.MAJOR,
        clause=replace(first.marks[0].clause, text="\x07 \ufffe \ud800", source="\x00"),
    )
    said = "exit code 1: \x1b[31mTraceback\x1b[0m \x00"
    lacking = Sitting("bags/\x1b", "S2_L3_seed0_\x1bmap", -1, (), said)
    sittings = (replace(first, marks=(marked, *first.marks[1:])), lacking)
    root = ElementTree.fromstring(as_junit(replace(certificate, sittings=sittings)).encode())
    assert root[1][0][0].get("message") == r"exit code 1: \x1b[31mTraceback\x1b[0m \x00"
    assert r"\x07 \ufffe \ud800" in root[0][0][0].text


def test_violations_are_told_with_the_place_and_the_worst_first(certificate):
    sitting = certificate.sittings[0]
    kept = [mark for mark in sitting.marks if mark.clause.clause_id == "obstruction"]
    minor = replace(kept[0], grade=Grade.MINOR, finding=replace(kept[0].finding, about="bus 7"))
    sittings = (replace(sitting, marks=(minor,)), replace(sitting, marks=tuple(kept), episode="second"))
    told = [(mark.grade, line) for _, mark, line in violations_of(sittings)]
    assert [grade for grade, _ in told] == [Grade.MAJOR, Grade.MINOR]
    assert told[0][1].startswith("second: major, ")
    assert "(bus 7)" in told[1][1]
    assert violations_of(certificate.sittings[1:]) == []


def test_the_page_escapes_names_and_links_the_moments(certificate, tmp_path):
    page = html_of(page_of(certificate, "./env siren exam bags"))
    assert "a &lt;driver&gt; does not pass" in page
    assert "<driver>" not in page
    assert "siren view" in page
    nothing = page_of(replace(certificate, sittings=certificate.sittings[1:], rulebook=WHOLE), "./env siren exam bags")
    assert "There is none." in html_of(nothing)
    titles = ["Why there is no certificate", "Clauses", "Violations", "Episodes"]
    assert [section.title for section in nothing.sections] == titles
    bags = {Path(sitting.bag) for sitting in certificate.sittings}
    page = html_of(page_of(certificate, "./env siren exam", EpisodePages(tmp_path / "pages", 5, bags)))
    assert "pages/0%20%3Cb%3E.html#t=" in page


def test_an_episode_without_a_result_fails_the_exam_and_loses_no_other(certificate):
    lacking = Sitting("out/episodes/S2 <x>", "S2_L2_seed7_town", 0, (), "the <program> hangs")
    good = certificate.sittings[1]
    assert Certificate("x", BOOK, (good,)).passed
    whole = Certificate("x", BOOK, (good, lacking))
    assert not whole.passed
    assert whole.without_result == (lacking,)
    assert whole.graded == (good,)
    assert whole.summary() == Certificate("x", BOOK, (good,)).summary()
    suite = ElementTree.fromstring(as_junit(whole))[1]
    assert (suite.get("errors"), suite.get("failures"), suite.get("tests")) == ("1", "0", "1")
    assert suite.find("testcase/error").get("message") == "the <program> hangs"
    page = html_of(page_of(whole, "./env siren exam"))
    assert "S2_L2_seed7_town: no result: the &lt;program&gt; hangs" in page
    assert json.loads(as_json(whole))["episodes"][1]["no_result"] == "the <program> hangs"


def test_effects_are_means_with_intervals_and_real_time_has_its_latency(certificate):
    good = certificate.sittings[1]
    assert Certificate("x", BOOK, (good,)).effects() is None
    delays = (1.0, 2.0, 3.0, 2.0, 2.0)
    paired = tuple(replace(good, others={"emv_delay_s": delay, "braked_hard": 0.0}) for delay in delays)
    table = Certificate("x", BOOK, paired).effects()
    assert table.rows[0][1].value == pytest.approx(2.0)
    assert table.rows[0][1].low < 2.0 < table.rows[0][1].high
    assert table.rows[1][1].value == 0.0
    content = json.loads(as_json(Certificate("x", BOOK, paired)))["means"]
    assert content["emv_delay_s"]["value"] == pytest.approx(2.0)
    violated = sum(mark.grade in {Grade.MINOR, Grade.MAJOR} for mark in good.marks)
    assert content["violations"]["value"] == violated
    (good, *_) = certificate.graded
    assert Certificate("x", BOOK, (good,)).latency() is None
    timed = tuple(replace(good, answers=AnswerTimes(median, p95, 90.0)) for median, p95 in ((2.0, 4.0), (4.0, 60.0)))
    table = Certificate("x", BOOK, timed).latency()
    assert [value for _, value in table.rows] == [3.0, 60.0, 90.0, 1.0]
    assert json.loads(as_json(Certificate("x", BOOK, timed)))["episodes"][1]["answers"]["p95_ms"] == 60.0


def made_certificate(driver, grades, delays=(), rulebook="california"):
    """A certificate of one clause, with its grade and the EMV's delay in each episode."""
    return {
        "driver": driver,
        "rulebook": rulebook,
        "rulebook_sha256": f"hash of {rulebook}",
        "clauses": [{"title": "Stands"}],
        "episodes": [
            {
                "episode": f"S2_L2_seed{seed}_town",
                "marks": [{"grade": grade}] if grade else [],
                "others": {"emv_delay_s": delays[seed], "braked_hard": 0.0} if delays else {},
            }
            for seed, grade in enumerate(grades)
        ],
    }


@pytest.mark.parametrize(
    "change", [{"clauses": 2}, {"episodes": [1]}, {"episodes": [{"episode": "a", "marks": [1]}]}], ids=str
)
def test_a_certificate_of_something_else_is_refused(change):
    other = made_certificate("a", ["pass"]) | change
    with pytest.raises(InputError, match="certificate"):
        compared({}, {})
    with pytest.raises(InputError, match="certificate"):
        compared(other, other)


def test_the_share_of_violations_in_common_episodes_where_the_clause_applies_to_both():
    first = made_certificate("a", ["major", "minor", "pass", "not applicable", "", "pass", "minor"])
    second = made_certificate("b", ["pass", "minor", "pass", "pass", "pass", "pass", "pass"])
    row = compared(first, second).rows[0]
    assert row[0] == "violated: Stands"
    assert row[1] == 5  # seed 3 does not apply, seed 4 has no result
    assert row[2] == pytest.approx(3 / 5)
    assert row[3] == pytest.approx(1 / 5)
    assert row[4].value == pytest.approx(2 / 5)
    assert row[4].low < 2 / 5 < row[4].high
    mirrored = compared(second, first).rows[0][4]
    assert (mirrored.value, mirrored.low) == (pytest.approx(-2 / 5), pytest.approx(-row[4].high))


def test_what_they_do_to_others_is_compared_where_both_know_it():
    grades = ["pass"] * 6
    table = compared(
        made_certificate("a", grades, [1.0, 2, 3, 1, 2, 3]), made_certificate("b", grades, [0.0, 1, 2, 0, 1, 3])
    )
    by_name = {str(row[0]): row for row in table.rows}
    delay = next(row for name, row in by_name.items() if "later arrival" in name)
    assert delay[4].value == pytest.approx(5 / 6)
    without = compared(made_certificate("a", grades), made_certificate("b", grades))
    assert without.rows[-1][1] == 0


def test_a_rulebook_with_other_limits_passes_for_no_shipped_one(tmp_path):
    forged = tmp_path / "california.yaml"
    shipped = (params_dir() / FOLDER / "california.yaml").read_text()
    forged.write_text(shipped.replace("minor: 4", "minor: 4000", 1).replace("major: 8", "major: 8000", 1))
    own = load_rulebook(str(forged))
    assert own.name == "own rulebook california.yaml"
    assert own.sha256 != BOOK.sha256 == sha256_of(params_dir() / FOLDER / "california.yaml")
    told = json.loads(as_json(Certificate("d", own, ())))
    assert (told["rulebook"], told["rulebook_sha256"]) == (own.name, own.sha256)
    assert [clause["major"] for clause in told["clauses"]] == [clause.major for clause in own.clauses]
    assert {clause["applied"] for clause in told["clauses"]} == {0}
    first, second = made_certificate("a", ["pass"]), made_certificate("b", ["pass"])
    with pytest.raises(InputError, match="same rulebook"):
        compared(first, second | {"rulebook_sha256": own.sha256})


def test_certificates_that_cannot_be_compared_are_refused(tmp_path):
    first = made_certificate("a", ["pass"])
    with pytest.raises(InputError, match="california"):
        compared(first, made_certificate("b", ["pass"], rulebook="germany"))
    with pytest.raises(InputError, match="common episodes"):
        compared(first, made_certificate("b", [""]))
    file = tmp_path / "certificate.json"
    for content in ("", "[]", json.dumps({"driver": "a"})):
        file.write_text(content)
        with pytest.raises(InputError, match=r"certificate\.json"):
            read_certificate(file)
