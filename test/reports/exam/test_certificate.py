"""Certificates of an exam as page, JSON and JUnit XML, and two of them compared."""

import copy
import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from defusedxml import ElementTree

from siren_ros import __version__
from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.plain_files import sha256_of
from siren_ros.base.tables import Interval, Measure
from siren_ros.errors import InputError
from siren_ros.reports.exam.certificate import (
    Certificate,
    as_json,
    as_junit,
    compared,
    page_of,
    read_certificate,
)
from siren_ros.reports.exam.finding import Finding
from siren_ros.reports.exam.grading import FOLDER, Clause, Grade, Mark, Rulebook, Sitting, load_rulebook
from siren_ros.reports.study_report.page import EpisodePages, html_of
from siren_ros.running.generation.closed_loop import AnswerTimes

BRAKES = Clause("brakes", "Brakes", "Brake softly.", "Law 1", "braking", {"lasting_s": 0.3}, 4.0, 6.0, "traffic")
GAP = Clause("gap", "Gap", "Let others go.", "Law 2", "right_of_way", {}, 3.0, 1.5, "making way")
BOX = Clause("box", "Box", "Leave the box.", "Law 3", "blocks_junction", {}, 2.0, 5.0)
MADE = Rulebook(
    "own", "Own book", 61.0, 23.0, 1.7, (BRAKES, GAP, BOX), "f0", {"traffic": 6, "making way": 3}, 0.1, {"base": "b0"}
)
NA, PASS, MINOR, MAJOR = Grade


NONE, AWAY = Measure.lacking("no box"), Measure.lacking("nobody came")


def made(number, *found, **more):
    """A sitting with a value (or what is lacking), a grade, a step and whom it is about for each clause."""
    marks = tuple(
        Mark(clause, grade, Finding(value if isinstance(value, Measure) else Measure(value), *rest))
        for clause, (value, grade, *rest) in zip(MADE.clauses, found, strict=bool(found))
    )
    return Sitting(f"bags/{number}", f"S{number}_town", 10 + number, marks, map_sha256=f"m{number}", **more)


def paired(number, delay_s, hard):
    return {"others": {"emv_delay_s": delay_s, "braked_hard": hard}, "paper": f"paper/{number}"}


AT_LEAST = Measure(7.5, at_least=True)
TIMES = AnswerTimes(2.0, 70.0, 91.0), AnswerTimes(5.0, 51.0, 58.0), AnswerTimes(3.0, 20.0, 95.5)
SITTINGS = (
    made(1, (3.25, PASS, 32), (1.25, MAJOR, 78, "sedan 3"), (NONE, NA)),
    made(2, (4.5, MINOR, 12), (4.75, PASS), (AT_LEAST, MAJOR, 140, "bus 4"), answers=TIMES[0], **paired(2, 1.5, 4.0)),
    made(3, lack="it hangs"),
    made(4, (5.5, MINOR, 10), (AWAY, NA), (0.5, PASS, 50), answers=TIMES[1], **paired(4, -0.25, 1.0)),
    made(5, (1.5, PASS, 4), (AWAY, NA), (NONE, NA)),
    made(6, (4.25, MINOR, 42), (9.0, PASS, 8), (NONE, NA), answers=TIMES[2]),
)
WHOLLY = Certificate("d", MADE, SITTINGS, {"versions": {"a": "1"}})
HASHES = {f"{folder}/{k}": f"{folder[0]}{k}" for folder in ("bags", "paper") for k in (1, 2, 4, 5, 6)}
LACKS = ("traffic: applied in 5 episodes, at least 6 are needed", "Brakes: violated in 3 of 5 episodes")
VIOLATIONS = (1.0, 2.0, 1.0, 0.0, 1.0)
MEAN_HALF = 2.776445 * math.sqrt(sum((one - 1.0) ** 2 for one in VIOLATIONS) / 4.0 / 5.0)
"""Half of the interval of 5 values with the mean 1: Student's 97.5 % quantile of 4 degrees of freedom."""


def test_a_certificate_needs_enough_episodes_and_few_violations():
    book = replace(MADE, coverage={"traffic": 30, "making way": 0})

    def lacks(passes, minors):
        kept, broken = SITTINGS[4], replace(SITTINGS[4], marks=(*SITTINGS[3].marks[:1], *SITTINGS[4].marks[1:]))
        whole = Certificate("x", book, (*(kept,) * passes, *(broken,) * minors))
        assert whole.passed is not bool(whole.lacks)
        return whole.lacks

    assert lacks(30, 0) == ()
    assert lacks(29, 0) == ("traffic: applied in 29 episodes, at least 30 are needed",)
    # Wilson's interval of 6 of 30 begins at 9.5 %, that of 7 of 30 at 11.8 %.
    assert lacks(24, 6) == ()
    assert lacks(23, 7) == ("Brakes: violated in 7 of 30 episodes",)


def test_junit_can_be_read_whatever_a_program_or_a_rulebook_says():
    """A CI loses the whole report otherwise, just when the program crashes."""
    first = SITTINGS[0]
    marked = replace(first.marks[1], clause=replace(GAP, text="\x07 \ufffe \ud800", source="\x00"))
    said = "exit code 1: \x1b[31mTraceback\x1b[0m \x00"
    lacking = Sitting("bags/\x1b", "S2_L3_seed0_\x1bmap", -1, (), said)
    sittings = (replace(first, marks=(first.marks[0], marked, first.marks[2])), lacking)
    root = ElementTree.fromstring(as_junit(replace(WHOLLY, sittings=sittings)).encode())
    assert root[1][0][0].get("message") == r"exit code 1: \x1b[31mTraceback\x1b[0m \x00"
    assert r"\x07 \ufffe \ud800" in root[0][1][0].text


def test_the_page_escapes_names_and_links_the_moments(tmp_path):
    named = replace(WHOLLY, driver="a <driver>", sittings=(replace(SITTINGS[0], bag="bags/0 <b>"),))
    page = html_of(page_of(named, "made so"))
    assert "a &lt;driver&gt; does not pass" in page
    assert "<driver>" not in page
    assert "siren view" in page
    assert "There is none." in html_of(page_of(replace(named, sittings=SITTINGS[4:5]), "made so"))
    page = html_of(page_of(named, "made so", EpisodePages(tmp_path / "pages", 5, {Path("bags/0 <b>")})))
    assert "pages/0%20%3Cb%3E.html#t=" in page


def made_certificate(driver, *grades, rulebook="california", **others):
    """A certificate with the grades of its clauses, by a letter each, and the effects on others in each episode."""
    names = {"-": "not applicable", "p": "pass", "m": "minor", "M": "major"}
    return {
        "driver": driver,
        "rulebook": rulebook,
        "rulebook_sha256": f"hash of {rulebook}",
        "clauses": [{"title": title} for title in ("Stands", "Waits")],
        "episodes": [
            {
                "episode": f"S2_L2_seed{seed}_town",
                "marks": [{"grade": names[letter]} for letter in letters],
                "others": {key: values[seed] for key, values in others.items() if values[seed] is not None},
            }
            for seed, letters in enumerate(grades)
        ],
    }


@pytest.mark.parametrize(
    "change", [{"clauses": 2}, {"episodes": [1]}, {"episodes": [{"episode": "a", "marks": [1]}]}], ids=str
)
def test_a_certificate_of_something_else_is_refused(change):
    other = made_certificate("a", "pp") | change
    with pytest.raises(InputError, match="certificate"):
        compared({}, {})
    with pytest.raises(InputError, match="certificate"):
        compared(other, other)


def test_two_drivers_are_compared_in_the_episodes_and_clauses_that_apply_to_both():
    """Seed 3 does not apply in one clause, seed 4 has no result, and seed 6 is of one exam alone."""
    delays, hard = [3.0, 1.5, None, 2.0, 9.0, 0.5, 9.0], [1.0, 0.0, None, 2.0, 9.0, 4.0, 9.0]
    first = made_certificate("a", "Mp", "mm", "pp", "-M", "", "pp", "MM", emv_delay_s=delays, braked_hard=hard)
    delays, hard = [*[1.0] * 5, None], [0.0, 3.0, 1.0, 1.0, 1.0, None]
    second = made_certificate("b", "pp", "mM", "pp", "pp", "pp", "-m", emv_delay_s=delays, braked_hard=hard)
    second["episodes"].reverse()
    table = compared(first, second)
    assert (table.head, table.caption) == (
        ("figure", "episodes", "a", "b", "difference"),
        "a and b, by the rulebook california",
    )
    pairs = {
        "violated: Stands": [(1, 0), (1, 1), (0, 0)],
        "violated: Waits": [(0, 0), (1, 1), (0, 0), (1, 0), (0, 1)],
        "later arrival of the first emergency vehicle, s": [(3.0, 1.0), (1.5, 1.0), (2.0, 1.0)],
        "others who braked harder than 4 m/s²": [(1.0, 0.0), (0.0, 3.0), (2.0, 1.0)],
    }
    means = [[sum(one) / len(one) for one in zip(*some, strict=True)] for some in pairs.values()]
    assert [row[:4] for row in table.rows] == [
        (name, len(some), *mean) for (name, some), mean in zip(pairs.items(), means, strict=True)
    ]
    for row, (one, other) in zip(table.rows, means, strict=True):
        assert (row[4].value, row[4].blocks) == (pytest.approx(one - other), row[1])
    waits = table.rows[1][4]  # the differences are 0, 0, 0, 1 and -1
    assert (waits.low, waits.high) == pytest.approx((-2.776445 * math.sqrt(0.1), 2.776445 * math.sqrt(0.1)))
    without = compared(made_certificate("a", "p-"), made_certificate("b", "m-"))
    assert [row[1:4] for row in without.rows] == [(1, 0.0, 1.0), *[(0, None, None)] * 3]


def test_a_rulebook_with_other_limits_passes_for_no_shipped_one(tmp_path):
    forged = tmp_path / "california.yaml"
    shipped = (params_dir() / FOLDER / "california.yaml").read_text()
    forged.write_text(shipped.replace("minor: 4", "minor: 4000", 1).replace("major: 8", "major: 8000", 1))
    own = load_rulebook(str(forged))
    assert own.name == "own rulebook california.yaml"
    assert own.sha256 != load_rulebook("california").sha256 == sha256_of(params_dir() / FOLDER / "california.yaml")
    told = json.loads(as_json(Certificate("d", own, ())))
    assert (told["rulebook"], told["rulebook_sha256"]) == (own.name, own.sha256)
    first, second = made_certificate("a", "pp"), made_certificate("b", "pp")
    with pytest.raises(InputError, match="same rulebook"):
        compared(first, second | {"rulebook_sha256": own.sha256})


def test_certificates_that_cannot_be_compared_are_refused(tmp_path):
    first = made_certificate("a", "pp")
    with pytest.raises(InputError, match="california"):
        compared(first, made_certificate("b", "pp", rulebook="germany"))
    with pytest.raises(InputError, match="common episodes"):
        compared(first, made_certificate("b", ""))
    file = tmp_path / "certificate.json"
    for content in ("", "[]", json.dumps({"driver": "a"})):
        file.write_text(content)
        with pytest.raises(InputError, match=r"certificate\.json"):
            read_certificate(file)


def wilson(part, whole):
    """Its bounds solve (p - share)² = z² p (1 - p) / n."""
    z2 = 1.959964**2
    root = math.sqrt(z2**2 + 4.0 * z2 * part * (whole - part) / whole)
    low, high = ((2.0 * part + z2 + sign * root) / (2.0 * (whole + z2)) for sign in (-1.0, 1.0))
    return Interval(part / whole, pytest.approx(low), pytest.approx(high), whole)


JSON = yaml.safe_load("""
driver: d
versions: {a: "1"}
rulebook: own
rulebook_sha256: f0
included_sha256: {base: b0}
heard_m: 61.0
heard_late_m: 23.0
reaction_s: 1.7
coverage: {traffic: 6, making way: 3}
most_minor: 0.1
passed: false
grade: major
km_per_emv: 160.0
clauses:
- {id: brakes, title: Brakes, text: Brake softly., source: Law 1, group: traffic, monitor: braking,
   numbers: {lasting_s: 0.3}, minor: 4.0, major: 6.0, applied: 5, violated: 3}
- {id: gap, title: Gap, text: Let others go., source: Law 2, group: making way, monitor: right_of_way, numbers: {},
   minor: 3.0, major: 1.5, applied: 3, violated: 1}
- {id: box, title: Box, text: Leave the box., source: Law 3, group: "", monitor: blocks_junction, numbers: {},
   minor: 2.0, major: 5.0, applied: 2, violated: 1}
episodes:
- {grade: major}
- {grade: major, others: {emv_delay_s: 1.5, braked_hard: 4.0}, paper: paper/2, paper_sha256: p2,
   answers: {median_ms: 2.0, p95_ms: 70.0, worst_ms: 91.0}}
- {grade: not applicable, no_result: it hangs, bag_sha256: null}
- {grade: minor, others: {emv_delay_s: -0.25, braked_hard: 1.0}, paper: paper/4, paper_sha256: p4,
   answers: {median_ms: 5.0, p95_ms: 51.0, worst_ms: 58.0}}
- {grade: pass}
- {grade: minor, answers: {median_ms: 3.0, p95_ms: 20.0, worst_ms: 95.5}}
marks:
- [1, brakes, pass, 3.25, m/s², 1.6, "", ""]
- [1, gap, major, 1.25, s, 3.9, "", sedan 3]
- [1, box, not applicable, null, s, null, no box, ""]
- [2, brakes, minor, 4.5, m/s², 0.6, "", ""]
- [2, gap, pass, 4.75, s, null, "", ""]
- [2, box, major, 7.5, s, 7.0, "", bus 4]
- [4, brakes, minor, 5.5, m/s², 0.5, "", ""]
- [4, gap, not applicable, null, s, null, nobody came, ""]
- [4, box, pass, 0.5, s, 2.5, "", ""]
- [5, brakes, pass, 1.5, m/s², 0.2, "", ""]
- [5, gap, not applicable, null, s, null, nobody came, ""]
- [5, box, not applicable, null, s, null, no box, ""]
- [6, brakes, minor, 4.25, m/s², 2.1, "", ""]
- [6, gap, pass, 9.0, s, 0.4, "", ""]
- [6, box, not applicable, null, s, null, no box, ""]
""")
"""The content of the made certificate; its marks are in one table."""
OF_MARK = ("clause", "grade", "value", "unit", "time_s", "reason", "about")


def test_the_json_has_everything_of_an_exam():
    expected = copy.deepcopy(JSON)
    marks = {k: [] for k in range(1, 7)}
    for k, *cells in expected.pop("marks"):
        marks[k].append({key: cell for key, cell in zip(OF_MARK, cells, strict=True) if cell or key != "about"})
    for k, one in enumerate(expected["episodes"], 1):
        named = {"episode": f"S{k}_town", "bag": f"bags/{k}", "bag_sha256": f"b{k}", "map_sha256": f"m{k}"}
        one.update(named | {"actor_id": 10 + k, "no_result": "", "others": {}, "marks": marks[k]} | one)
    mean = {"value": 1.0, "low": pytest.approx(1.0 - MEAN_HALF), "high": pytest.approx(1.0 + MEAN_HALF), "episodes": 5}
    few = {"low": None, "high": None, "episodes": 2}
    expected["means"] = {"violations": mean, "emv_delay_s": few | {"value": 0.625}, "braked_hard": few | {"value": 2.5}}
    assert json.loads(as_json(WHOLLY, HASHES)) == expected | {"siren": __version__, "lacks": [*LACKS]}


BRAKING, STANDING = "hardest deceleration", "time standing on a junction"
FIRST = "time before somebody with the right of way"
GRAVE_GAP = f"{FIRST} (sedan 3): 1.25 s at 3.9 s, allowed at least 1.5"
GRAVE_BOX = f"{STANDING} (bus 4): at least 7.50 s at 7.0 s, allowed at most 5"
SOFT = {
    2: f"{BRAKING}: 4.50 m/s² at 0.6 s, allowed at most 4",
    4: f"{BRAKING}: 5.50 m/s² at 0.5 s, allowed at most 4",
    6: f"{BRAKING}: 4.25 m/s² at 2.1 s, allowed at most 4",
}


def test_junit_has_a_suite_for_each_episode_with_its_cases():
    root = ElementTree.fromstring(as_junit(WHOLLY))
    found = {}
    for suite in root:
        assert {case.get("classname") for case in suite} == {suite.get("name")}
        cases = {
            case.get("name"): [
                (child.tag, *(child.get(key) for key in ("message", "type") if child.get(key)), child.text)
                for child in case
            ]
            for case in suite
        }
        counts = " ".join(suite.get(key) for key in ("tests", "failures", "errors", "skipped"))
        found[suite.get("name")] = (counts, {name: what[0] if what else () for name, what in cases.items()})
        assert all(len(what) <= 1 for what in cases.values())
    none, away = ("skipped", "no box", None), ("skipped", "nobody came", None)
    gap = "Let others go.\nLaw 2\nsiren view bags/1 --time-s 1.9 --actor 11"
    box = "Leave the box.\nLaw 3\nsiren view bags/2 --time-s 5 --actor 12"
    soft = {k: ("system-out", f"minor: {text}") for k, text in SOFT.items()}
    assert root.get("name") == "siren exam own"
    assert found == {
        "S1_town": ("3 1 0 1", {"brakes": (), "gap": ("failure", GRAVE_GAP, "gap", gap), "box": none}),
        "S2_town": ("3 1 0 0", {"brakes": soft[2], "gap": (), "box": ("failure", GRAVE_BOX, "box", box)}),
        "S3_town": ("1 0 1 0", {"episode": ("error", "it hangs", None)}),
        "S4_town": ("3 0 0 1", {"brakes": soft[4], "gap": away, "box": ()}),
        "S5_town": ("3 0 0 2", {"brakes": (), "gap": away, "box": none}),
        "S6_town": ("3 0 0 1", {"brakes": soft[6], "gap": (), "box": none}),
        "certificate": ("2 2 0 0", {lack: ("failure", lack, "certificate", None) for lack in LACKS}),
    }


class Pages:
    """Stands for the pages of episodes."""

    def address(self, bag, time_s, actor_id):
        return f"{bag}#{time_s:g} {actor_id}"


def test_the_page_has_everything_of_an_exam():
    page = page_of(WHOLLY, "made so", Pages())
    assert page.title == "Exam: Own book"
    assert page.lead == (
        "d does not pass. Episodes by their worst clause: 1 pass, 2 minor, 2 major, 1 without a result."
    )
    why, summary, without, violations, marks = page.sections
    assert (why.text, summary.commands, without.text) == (LACKS, ("made so",), ("S3_town: no result: it hangs",))
    clauses, per_way, others, latency, duties = summary.tables
    assert clauses.rows == (
        ("Brakes", 2, 3, 0, 0, wilson(3, 5), "Law 1"),
        ("Gap", 2, 0, 1, 2, wilson(1, 3), "Law 2"),
        ("Box", 1, 0, 1, 3, wilson(1, 2), "Law 3"),
    )
    often, delay, hard = (row[1] for row in per_way.rows)
    assert [row[0] for row in per_way.rows[1:]] == [*(row[0] for row in others.rows)]
    assert others.rows == ((per_way.rows[1][0], delay), (per_way.rows[2][0], hard))
    assert [(one.value, one.blocks, one.bounded) for one in (often, delay, hard)] == [
        (1.0, 5, True),
        (0.625, 2, False),
        (2.5, 2, False),
    ]
    assert [row[2] for row in per_way.rows] == [one.scaled(100_000 / 160.0) for one in (often, delay, hard)]
    assert [value for _, value in latency.rows] == [3.0, 70.0, 95.5, 2.0]
    assert duties.rows == (
        ("Brakes", "Brake softly.", f"{BRAKING}, m/s²", "4", "6", "Law 1"),
        ("Gap", "Let others go.", f"{FIRST}, s", "3", "1.5", "Law 2"),
        ("Box", "Leave the box.", f"{STANDING}, s", "2", "5", "Law 3"),
    )
    assert [(one.text, one.address, one.command) for one in violations.links] == [
        (f"S{k}_town: {text}", f"bags/{k}#{begin} {10 + k}", f"siren view bags/{k} --time-s {begin} --actor {10 + k}")
        for k, text, begin in (
            (1, f"major, Gap: {GRAVE_GAP}", "1.9"),
            (2, f"major, Box: {GRAVE_BOX}", "5"),
            (2, f"minor, Brakes: {SOFT[2]}", "0"),
            (4, f"minor, Brakes: {SOFT[4]}", "0"),
            (6, f"minor, Brakes: {SOFT[6]}", "0.1"),
        )
    ]
    assert [(table.key, table.caption) for table in marks.tables] == [
        (f"S{k}_town", f"S{k}_town: {grade}")
        for k, grade in ((1, "major"), (2, "major"), (4, "minor"), (5, "pass"), (6, "minor"))
    ]
    assert marks.tables[2].rows == (
        ("Brakes", "minor", SOFT[4]),
        ("Gap", "not applicable", "nobody came"),
        ("Box", "pass", f"{STANDING}: 0.50 s at 2.5 s, allowed at most 2"),
    )
    assert marks.tables[1].rows[1] == ("Gap", "pass", f"{FIRST}: 4.75 s, allowed at least 3")


def test_facts_and_a_frame_of_an_exam():
    alone = replace(WHOLLY, sittings=(SITTINGS[0],))
    assert (alone.effects(), alone.latency(), alone.passed) == (None, None, False)
    for passed in (True, False):
        tried = replace(WHOLLY, sittings=(SITTINGS[4], *(() if passed else SITTINGS[2:3])))
        assert replace(tried, rulebook=replace(MADE, coverage={})).passed is passed
    assert WHOLLY.facts() == {
        "driver": "d",
        "rulebook": "own",
        "passed": False,
        "episodes": 6,
        "pass": 1,
        "minor": 2,
        "major": 2,
        "no result": 1,
    }
    frame = WHOLLY.to_pandas()
    assert [*frame.columns] == ["episode", "bag", "actor_id", "clause", "grade", "value", "unit", "time_s"]
    rows = frame.fillna(-1.0).to_numpy().tolist()
    assert rows == [
        [f"S{k}_town", f"bags/{k}", 10 + k, *(-1.0 if cell is None else cell for cell in cells[:5])]
        for k, *cells in JSON["marks"]
    ]
